"""Smallest eigenpairs of generalized symmetric problems, and their derivatives. Knows nothing of meshes."""

from ._clusters import cluster_labels as cluster_labels
from ._clusters import cluster_means as cluster_means
from ._clusters import cluster_sums as cluster_sums
from ._conjugate_gradients import conjugate_gradients as conjugate_gradients
from ._dense import DenseEigh as DenseEigh
from ._factorization import AbstractFactorization as AbstractFactorization
from ._factorization import Cholmod as Cholmod
from ._factorization import SuperLU as SuperLU
from ._factorization import cholmod_is_installed as cholmod_is_installed
from ._factorization import default_factorization as default_factorization
from ._failure import DegenerateEigenvalueError as DegenerateEigenvalueError
from ._failure import DerivativeError as DerivativeError
from ._fallback import WithFallback as WithFallback
from ._lobpcg import LOBPCG as LOBPCG
from ._preconditioner import AbstractApproximateInverse as AbstractApproximateInverse
from ._preconditioner import AbstractPreconditioner as AbstractPreconditioner
from ._preconditioner import KeptInverse as KeptInverse
from ._problem import GeneralizedEigenproblem as GeneralizedEigenproblem
from ._scipy import ScipyEigsh as ScipyEigsh
from ._solution import RESULTS as RESULTS
from ._solution import EigenSolution as EigenSolution
from ._solve import eigenvalues as eigenvalues
from ._solve import eigsolve as eigsolve
from ._solve import spectral_sum as spectral_sum
from ._solver import AbstractEigensolver as AbstractEigensolver
from ._solver import AbstractStatelessEigensolver as AbstractStatelessEigensolver
