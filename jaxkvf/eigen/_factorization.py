"""Factorizations of A + sB on the host, the work-horse of shift-invert."""

import abc
from collections.abc import Callable

import equinox as eqx
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

Solve = Callable[[np.ndarray], np.ndarray]


class AbstractFactorization(eqx.Module):
    """A direct method for symmetric positive definite sparse systems."""

    @abc.abstractmethod
    def factorize(self, matrix: sp.csc_array) -> Solve | None:
        """The map b → matrix⁻¹ b for b `[n]`, or None where the matrix turns out not to be positive definite."""


class Cholmod(AbstractFactorization):
    """Supernodal Cholesky of CHOLMOD, as carried by cvxopt (GPL; extra `cholmod-gpl`): the fastest and leanest here."""

    def __check_init__(self) -> None:
        if not cholmod_is_installed():
            raise ImportError('Cholmod needs cvxopt: pip install "jaxkvf[cholmod-gpl]" (a GPL library)')

    def factorize(self, matrix: sp.csc_array) -> Solve | None:
        from cvxopt import cholmod, spmatrix  # noqa: PLC0415  # pyright: ignore[reportAttributeAccessIssue]
        from cvxopt import matrix as dense  # noqa: PLC0415

        lower = sp.coo_array(sp.tril(matrix))
        A = spmatrix(dense(lower.data), lower.row.astype(int), lower.col.astype(int), matrix.shape)
        cholmod.options["supernodal"] = 2
        factor = cholmod.symbolic(A)
        try:
            cholmod.numeric(A, factor)
        except ArithmeticError:
            return None

        def solve(right_side: np.ndarray) -> np.ndarray:
            x = dense(np.ascontiguousarray(right_side, np.float64))
            cholmod.solve(factor, x)
            return np.asarray(x).ravel()

        return solve


class SuperLU(AbstractFactorization):
    """SciPy's SuperLU in symmetric mode: pivots on the diagonal, minimum degree on A + Aᵀ."""

    def factorize(self, matrix: sp.csc_array) -> Solve | None:
        try:
            factor = splu(
                matrix,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                relax=1,  # relaxed supernodes go wrong on a grid with seams: 30 times slower, for no gain elsewhere
                options={"SymmetricMode": True},
            )
        except RuntimeError:  # exactly singular
            return None
        # With the same permutation of rows and columns, U's diagonal has the inertia of the matrix.
        on_diagonal = np.array_equal(factor.perm_r, factor.perm_c)
        return factor.solve if on_diagonal and (factor.U.diagonal() > 0).all() else None


def cholmod_is_installed() -> bool:
    try:
        import cvxopt.cholmod  # noqa: F401, PLC0415
    except ImportError:
        return False
    return True


def default_factorization() -> AbstractFactorization:
    """CHOLMOD where cvxopt is installed, SuperLU elsewhere."""
    return Cholmod() if cholmod_is_installed() else SuperLU()
