"""Smallest eigenpairs of generalized symmetric problems, and their derivatives. Knows nothing of meshes."""

from ._auxiliary_space import AuxiliarySpace as AuxiliarySpace
from ._coarsening import Coarsening as Coarsening
from ._coarsening import Interpolation as Interpolation
from ._dense import DenseEigh as DenseEigh
from ._factorization import AbstractFactorization as AbstractFactorization
from ._factorization import Cholmod as Cholmod
from ._factorization import SuperLU as SuperLU
from ._factorization import cholmod_is_installed as cholmod_is_installed
from ._fallback import WithFallback as WithFallback
from ._jacobi import BlockJacobi as BlockJacobi
from ._jacobi import Chebyshev as Chebyshev
from ._lobpcg import LOBPCG as LOBPCG
from ._multigrid import Multigrid as Multigrid
from ._preconditioner import AbstractApproximateInverse as AbstractApproximateInverse
from ._preconditioner import AbstractPreconditioner as AbstractPreconditioner
from ._problem import GeneralizedEigenproblem as GeneralizedEigenproblem
from ._scipy import ScipyEigsh as ScipyEigsh
from ._solution import RESULTS as RESULTS
from ._solution import EigenSolution as EigenSolution
from ._solve import check_count as check_count
from ._solve import cluster_labels as cluster_labels
from ._solve import cluster_sums as cluster_sums
from ._solve import eigsolve as eigsolve
from ._solver import AbstractEigensolver as AbstractEigensolver
