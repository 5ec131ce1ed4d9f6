"""(A − λᵢB) zᵢ = fᵢ away from known eigenvectors, by conjugate gradients."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, DTypeLike, Float

from ..sparse import cheap_diagonal, matmat
from ._preconditioner import AbstractApproximateInverse
from ._problem import GeneralizedEigenproblem

MOST_STEPS = 2000
_ACCEPTED = 1e-6  # residual relative to the right-hand side, in float64


def accepted_residual(dtype: DTypeLike) -> float:
    """Of the linear solve in a derivative, relative to its right-hand side."""
    return max(_ACCEPTED, 10 * float(jnp.finfo(dtype).eps) ** 0.5)


def deflated_product(
    problem: GeneralizedEigenproblem,
    X: Float[Array, "n m"],
    energies: Float[Array, "k k"],
    Z: Float[Array, "n k"],
) -> Float[Array, "n k"]:
    """Pᵀ(A P Z − B P Z Λ) + BX XᵀB Z, P = 1 − X XᵀB the B-orthogonal projection off the columns of X."""
    along = X.T @ matmat(problem.B, Z)
    PZ = Z - X @ along
    Y = matmat(problem.A, PZ) - matmat(problem.B, PZ) @ energies
    BX = matmat(problem.B, X)
    return Y - BX @ (X.T @ Y) + BX @ along


def conjugate_gradients(
    problem: GeneralizedEigenproblem,
    X: Float[Array, "n m"],
    values: Float[Array, " k"],
    right: Float[Array, "n k"],
    inverse: AbstractApproximateInverse | None = None,
) -> Float[Array, "n k"]:
    """A body for `AbstractEigensolver.deflated_solve`, in JAX.

    Args:
        problem: as there, like X, values and right.
        inverse: what preconditions; the diagonal of A by default.
    """
    diagonal = cheap_diagonal(problem.A)
    BX = matmat(problem.B, X)

    def approximate_inverse(R: Float[Array, "n k"]) -> Float[Array, "n k"]:
        if inverse is not None:
            return inverse.apply(R)
        if diagonal is None:
            return R
        return R / jnp.where(diagonal > 0, diagonal, jnp.abs(diagonal).mean())[:, None]

    def precondition(R: Float[Array, "n k"]) -> Float[Array, "n k"]:
        Z = approximate_inverse(R - BX @ (X.T @ R))
        return Z - X @ (BX.T @ Z) + X @ (X.T @ R)

    Z, _ = jax.scipy.sparse.linalg.cg(
        lambda Z: deflated_product(problem, X, jnp.diag(values), Z),
        right,
        tol=1e-4 * accepted_residual(right.dtype),
        maxiter=MOST_STEPS,
        M=precondition,
    )
    return Z
