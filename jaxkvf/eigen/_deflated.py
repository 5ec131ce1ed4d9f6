"""(A − λᵢB) zᵢ = fᵢ away from known eigenvectors: the linear solve in the derivative of eigenvectors."""

from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from ._conjugate_gradients import accepted_residual, deflated_product
from ._failure import DerivativeError, raise_if
from ._problem import GeneralizedEigenproblem
from ._solver import AbstractEigensolver

_Tree = TypeVar("_Tree")

_FAILED = (
    "The linear solve for the derivative of eigenvectors did not converge. An eigenvalue beyond those asked for may be too "
    "near: ask for more eigenpairs, or pass a solver with a better preconditioner (`multigrid_solver`, ScipyEigsh)."
)


class Solved(eqx.Module):
    """An eigenproblem as it was solved, held fixed: what a solve near it may use."""

    problem: GeneralizedEigenproblem
    solver: AbstractEigensolver
    state: PyTree
    constraints: Float[Array, "n c"] | None
    """Of the solver, B-orthonormal."""
    level: Float[Array, ""]
    """The eigenvalue that stands for the constraints, see `restricted`."""
    successful: Bool[Array, ""]


def deflated_solve(
    problem: GeneralizedEigenproblem,
    X: Float[Array, "n k"],
    energies: Float[Array, "k k"],
    right: Float[Array, "n k"],
    solved: Solved,
) -> Float[Array, "n k"]:
    """Z with Pᵀ(A P Z − B P Z Λ) + BX XᵀB Z = F, P = 1 − X XᵀB the B-orthogonal projection off the columns of X.

    For F orthogonal to X this is (A − λᵢB) zᵢ = fᵢ with Z B-orthogonal to X. Positive definite where X holds all
    eigenvectors up to the largest of the λᵢ. Differentiable in everything but the solver, to any order. NaN, not an error,
    where the eigensolve had failed or F is not finite.

    Args:
        problem: A and B, `restricted` where the solver has constraints.
        X: B-orthonormal eigenvectors to stay away from; columns of zeros do nothing.
        energies: Λ, diagonal in value (its derivative need not be).
        right: F.
        solved: the eigenproblem, with the solver and what it has prepared.
    """

    def product(Z: Float[Array, "n k"]) -> Float[Array, "n k"]:
        return deflated_product(problem, X, energies, Z)

    X_held, values = jax.lax.stop_gradient((X, energies.diagonal()))
    held_problem = solved.problem if solved.constraints is None else held(problem)

    def solve(_: object, F: Float[Array, "n k"]) -> Float[Array, "n k"]:
        Z, failed = _solve(solved, held_problem, X_held, values, F)
        Z = jnp.where(solved.successful, Z, jnp.nan)
        failed &= solved.successful & jnp.isfinite(F).all()
        return raise_if(Z, failed, jnp.int32(0), (_FAILED,), DerivativeError)

    return jax.lax.custom_linear_solve(product, right, solve, symmetric=True)


@eqx.filter_jit
def _solve(
    solved: Solved,
    problem: GeneralizedEigenproblem,
    X: Float[Array, "n k"],
    values: Float[Array, " k"],
    F: Float[Array, "n k"],
) -> tuple[Float[Array, "n k"], Bool[Array, ""]]:
    """Z, and whether it is too far from solving the system."""
    Y = solved.constraints
    X_and_Y = X if Y is None else jnp.concatenate([X, Y], axis=1)
    Z = solved.solver.deflated_solve(solved.state, solved.problem, X_and_Y, values, F)
    if Y is not None:
        Z = Z + Y @ ((Y.T @ F) * (1 / (solved.level - values) - 1)[None, :])
    residual = deflated_product(problem, X, jnp.diag(values), Z) - F
    accepted = jnp.linalg.norm(residual) <= accepted_residual(F.dtype) * jnp.linalg.norm(F)
    return Z, ~accepted


def held(tree: _Tree) -> _Tree:
    """The same tree, its arrays constant to derivatives; an operator may hold functions besides."""
    arrays, others = eqx.partition(tree, eqx.is_array)
    return eqx.combine(jax.lax.stop_gradient(arrays), others)
