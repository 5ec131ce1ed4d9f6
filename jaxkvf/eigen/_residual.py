"""What every solver measures its eigenpairs by, in the same way."""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Bool, DTypeLike, Float

from ._problem import GeneralizedEigenproblem

ROUNDINGS = 16  # a residual of this many rounding units is converged: nothing smaller can be asked for
NEGATIVE = 100  # rounding units of ‖A‖‖x‖², below which xᵀAx is negative in truth


def relative_residuals(
    A_x: Float[Array, "n k"],
    B_x: Float[Array, "n k"],
    x: Float[Array, "n k"],
    eigenvalues: Float[Array, " k"],
    A_norm: Float[Array, ""],
) -> Float[Array, " k"]:
    """‖A x − λ B x‖₂ / (‖A‖₂ ‖x‖₂) of each column, with ‖A‖₂ from `spectral_norm`; 0 where A is 0."""
    sizes = A_norm * jnp.linalg.norm(x, axis=0)
    errors = jnp.linalg.norm(A_x - B_x * eigenvalues[None, :], axis=0)
    return jnp.where(errors > 0, errors / jnp.where(sizes > 0, sizes, 1), errors)


def least_rtol(rtol: float, dtype: DTypeLike) -> float:
    """The relative residual to reach: what is asked for, as far as rounding lets."""
    return max(rtol, ROUNDINGS * float(jnp.finfo(dtype).eps))


def check_tolerances(rtol: float, atol: float, max_steps: int) -> None:
    """Whether a solver can mean these.

    Raises:
        ValueError: one of them is negative.
    """
    if not (rtol >= 0 and atol >= 0):
        raise ValueError(f"rtol and atol must not be negative, got {rtol} and {atol}")
    if max_steps < 0:
        raise ValueError(f"max_steps must not be negative, got {max_steps}")


def all_finite(problem: GeneralizedEigenproblem) -> Bool[Array, ""]:
    """Whether no number of the problem is NaN or infinite."""
    finite = jnp.bool_(True)
    for leaf in jax.tree.leaves(eqx.filter(problem, eqx.is_inexact_array)):
        finite &= jnp.isfinite(leaf).all()
    return finite


def lost_positivity(
    problem: GeneralizedEigenproblem,
    eigenvalues: Float[Array, " k"],
    x: Float[Array, "n k"],
    A_norm: Float[Array, ""],
) -> Bool[Array, ""]:
    """Whether A, declared positive semi-definite, has eigenvalues further below zero than rounding takes them.

    Args:
        problem: with the declaration.
        eigenvalues: of the problem.
        x: B-orthonormal eigenvectors.
        A_norm: ‖A‖₂.
    """
    if not lx.is_positive_semidefinite(problem.A):
        return jnp.bool_(False)
    noise = NEGATIVE * jnp.finfo(x.dtype).eps * A_norm * (x**2).sum(axis=0)
    return (eigenvalues < -noise).any()
