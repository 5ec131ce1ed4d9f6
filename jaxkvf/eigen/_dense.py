"""Dense eigensolver: exact, for small problems and for tests."""

import equinox as eqx
import jax.numpy as jnp
from jax.lax.linalg import eigh, triangular_solve
from jaxtyping import Array, Float

from ..sparse import spectral_norm
from ._problem import GeneralizedEigenproblem
from ._residual import all_finite, least_rtol, lost_positivity, relative_residuals
from ._solution import RESULTS, EigenSolution
from ._solver import AbstractEigensolver


class _Eigenpairs(eqx.Module):
    """All of them."""

    values: Float[Array, " n"]
    vectors: Float[Array, "n n"]


class DenseEigh(AbstractEigensolver):
    """All eigenpairs by LAPACK after a Cholesky factorization of B; O(n³) time, O(n²) memory, the guess unused.

    Fully in JAX: runs under `jit` and `vmap` on any backend. Practical to a few thousand unknowns.
    """

    rtol: float = eqx.field(default=1e-8, static=True)
    """Relative to ‖A‖₂, as for `LOBPCG`; a larger residual is a failure. Less than 16 n rounding units counts as that."""
    atol: float = eqx.field(default=0.0, static=True)

    @property
    def constraints(self) -> None:
        """None: `LOBPCG` takes constraints."""

    @eqx.filter_jit
    def compute(
        self, problem: GeneralizedEigenproblem, k: int, guess: Float[Array, "n g"] | None
    ) -> tuple[EigenSolution, _Eigenpairs]:
        del guess
        A, B = problem.A.as_matrix(), problem.B.as_matrix()
        n, dtype = len(A), A.dtype
        # Unit diagonal of B: what is badly scaled only is then not badly conditioned.
        scale = jnp.sqrt(B.diagonal())
        factor = jnp.linalg.cholesky(
            B / scale[:, None] / scale[None, :]
        )  # NaN where B is not positive definite
        factor_ = scale[:, None] * factor
        half = triangular_solve(factor_, A, left_side=True, lower=True)
        standard = triangular_solve(factor_, half.T, left_side=True, lower=True)
        vectors, values = eigh(0.5 * (standard + standard.T))
        vectors = triangular_solve(factor_, vectors, left_side=True, lower=True, transpose_a=True)

        norm = spectral_norm(lambda x: A @ x, n, dtype)
        x, wanted = vectors[:, :k], values[:k]
        residuals = relative_residuals(A @ x, B @ x, x, wanted, norm)
        result = RESULTS.where(
            (residuals * norm <= least_rtol(self.rtol, dtype) * n * norm + self.atol).all(),
            RESULTS.successful,
            RESULTS.stagnated,
        )
        result = RESULTS.where(lost_positivity(problem, wanted, x, norm), RESULTS.negative_energy, result)
        result = RESULTS.where(jnp.isfinite(factor).all(), result, RESULTS.indefinite_mass)
        result = RESULTS.where(all_finite(problem), result, RESULTS.nonfinite_input)
        return EigenSolution(wanted, x, residuals, result, stats={}), _Eigenpairs(values, vectors)

    def deflated_solve(
        self,
        state: _Eigenpairs,
        problem: GeneralizedEigenproblem,
        X: Float[Array, "n m"],
        values: Float[Array, " k"],
        right: Float[Array, "n k"],
    ) -> Float[Array, "n k"]:
        """By all other eigenpairs: Σⱼ vⱼ vⱼᵀfᵢ / (λⱼ − λᵢ)."""
        V = state.vectors
        deflated = ((V.T @ problem.B.as_matrix() @ X) ** 2).sum(axis=1) > 0.5
        gaps = state.values[:, None] - values[None, :]
        usable = gaps != 0  # a pair itself, where it is of a cluster cut: nothing is asked for then
        inverse = jnp.where(deflated[:, None], 1, jnp.where(usable, 1 / jnp.where(usable, gaps, 1), 0))
        return V @ (inverse * (V.T @ right))
