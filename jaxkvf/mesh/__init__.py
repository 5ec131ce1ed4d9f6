"""Triangle meshes: connectivity, positions, files and shapes."""

from . import shapes as shapes
from ._errors import MeshError as MeshError
from ._topology import Topology as Topology
from ._triangle_mesh import TriangleMesh as TriangleMesh
