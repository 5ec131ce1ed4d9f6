"""Dense eigensolver: exact, for small problems and for tests."""

import equinox as eqx
import jax.numpy as jnp
from jax.lax.linalg import eigh, triangular_solve
from jaxtyping import Array, Float

from ..sparse import spectral_norm
from ._problem import GeneralizedEigenproblem
from ._residual import relative_residuals
from ._solution import RESULTS, EigenSolution
from ._solver import AbstractEigensolver


class DenseEigh(AbstractEigensolver):
    """All eigenpairs by LAPACK after a Cholesky factorization of B; O(n³) time, O(n²) memory, the guess unused.

    Fully in JAX: runs under `jit` and `vmap` on any backend. Practical to a few thousand unknowns.
    """

    @eqx.filter_jit
    def compute(
        self, problem: GeneralizedEigenproblem, k: int, guess: Float[Array, "n g"] | None
    ) -> EigenSolution:
        del guess
        A, B = problem.A.as_matrix(), problem.B.as_matrix()
        factor = jnp.linalg.cholesky(B)  # NaN where B is not positive definite
        half = triangular_solve(factor, A, left_side=True, lower=True)
        standard = triangular_solve(factor, half.T, left_side=True, lower=True)
        vectors, values = eigh(0.5 * (standard + standard.T))
        values = values[:k]
        vectors = triangular_solve(factor, vectors[:, :k], left_side=True, lower=True, transpose_a=True)
        result = RESULTS.where(jnp.isfinite(factor).all(), RESULTS.successful, RESULTS.indefinite_mass)
        result = RESULTS.where(jnp.isfinite(A).all() & jnp.isfinite(B).all(), result, RESULTS.nonfinite_input)
        residuals = relative_residuals(
            A @ vectors, B @ vectors, vectors, values, spectral_norm(lambda x: A @ x, len(A), A.dtype)
        )
        return EigenSolution(values, vectors, residuals, result, stats={})
