"""Triangle meshes: connectivity, positions, files and shapes."""

from . import shapes as shapes
from ._attributes import Attributes as Attributes
from ._check import Finding as Finding
from ._check import MeshReport as MeshReport
from ._check import check as check
from ._errors import MeshError as MeshError
from ._errors import MeshTooLargeError as MeshTooLargeError
from ._errors import check_fits as check_fits
from ._flipping import DelaunayFlips as DelaunayFlips
from ._flipping import delaunay_flips as delaunay_flips
from ._flipping import polar_angles as polar_angles
from ._io import read_attributes as read_attributes
from ._io import write_mesh as write_mesh
from ._repair import Repair as Repair
from ._repair import repair as repair
from ._topology import Topology as Topology
from ._topology import TopologyArrays as TopologyArrays
from ._triangle_mesh import TriangleMesh as TriangleMesh
from ._validation import name_first as name_first
