"""Continuous intrinsic symmetry of triangle meshes as a differentiable primitive in JAX."""

from .fields import KillingFields as KillingFields
from .fields import intrinsic_killing_eigenvalues as intrinsic_killing_eigenvalues
from .fields import killing_eigenvalues as killing_eigenvalues
from .fields import killing_fields as killing_fields
from .killing import killing_energy as killing_energy
from .killing import killing_energy_density as killing_energy_density
from .mesh import MeshError as MeshError
from .mesh import Topology as Topology
from .mesh import TriangleMesh as TriangleMesh
from .symmetry import Symmetrization as Symmetrization
from .symmetry import symmetrize as symmetrize
