"""Approximate inverses for `jaxkvf.eigen.LOBPCG`: multigrid, auxiliary space, Chebyshev, Jacobi. Knows nothing of meshes."""

from ._auxiliary_space import AuxiliarySpace as AuxiliarySpace
from ._coarsening import Coarsening as Coarsening
from ._coarsening import Interpolation as Interpolation
from ._jacobi import BlockJacobi as BlockJacobi
from ._jacobi import Chebyshev as Chebyshev
from ._multigrid import Multigrid as Multigrid
