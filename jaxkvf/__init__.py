"""Continuous intrinsic symmetry of triangle meshes as a differentiable primitive in JAX.

`killing_fields(mesh, k)` finds the tangent fields closest to generating a symmetry, `killing_eigenvalues` how close they
are, differentiably, and `symmetrize` moves the vertices until the symmetry is exact. `flow` follows a field, `period` and
`orbit` give the groups in it. Meshes come from `TriangleMesh.load`,
`TriangleMesh.from_arrays` or `shapes`. float64 is recommended: `jax.config.update("jax_enable_x64", True)`.
"""

from . import eigen as eigen
from . import exterior as exterior
from . import flows as flows
from . import geometry as geometry
from . import killing as killing
from . import patterns as patterns
from . import preconditioning as preconditioning
from . import reference as reference
from . import symmetrization as symmetrization
from .eigen import LOBPCG as LOBPCG
from .eigen import DenseEigh as DenseEigh
from .eigen import ScipyEigsh as ScipyEigsh
from .fields import KillingFields as KillingFields
from .fields import component_shares as component_shares
from .fields import intrinsic_killing_eigenvalues as intrinsic_killing_eigenvalues
from .fields import killing_eigenvalues as killing_eigenvalues
from .fields import killing_fields as killing_fields
from .fields import killing_spectral_sum as killing_spectral_sum
from .flows import FlowStatus as FlowStatus
from .flows import advect_vertices as advect_vertices
from .flows import flow as flow
from .flows import integral_curves as integral_curves
from .flows import isometry_error as isometry_error
from .flows import orbit as orbit
from .flows import period as period
from .geometry import SurfacePoints as SurfacePoints
from .geometry import closest_points as closest_points
from .geometry import intrinsic_delaunay as intrinsic_delaunay
from .geometry import surface_positions as surface_positions
from .geometry import vertex_points as vertex_points
from .harmonic import HarmonicFields as HarmonicFields
from .harmonic import harmonic_fields as harmonic_fields
from .killing import killing_energy as killing_energy
from .killing import killing_energy_density as killing_energy_density
from .mesh import MeshError as MeshError
from .mesh import MeshReport as MeshReport
from .mesh import MeshTooLargeError as MeshTooLargeError
from .mesh import Repair as Repair
from .mesh import Topology as Topology
from .mesh import TriangleMesh as TriangleMesh
from .mesh import check as check
from .mesh import repair as repair
from .mesh import shapes as shapes
from .parts import LocalSymmetry as LocalSymmetry
from .parts import SymmetricParts as SymmetricParts
from .parts import local_symmetry as local_symmetry
from .parts import symmetric_parts as symmetric_parts
from .patterns import Pattern as Pattern
from .patterns import pattern as pattern
from .patterns import stripes as stripes
from .solvers import multigrid_preconditioner as multigrid_preconditioner
from .solvers import multigrid_solver as multigrid_solver
from .symmetrization import Symmetrization as Symmetrization
from .symmetrization import SymmetryReport as SymmetryReport
from .symmetrization import symmetrize as symmetrize
from .symmetrization import symmetry_report as symmetry_report
