"""The one measure of how well an eigenpair solves its problem."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def relative_residuals(
    A_x: Float[Array, "n k"],
    B_x: Float[Array, "n k"],
    x: Float[Array, "n k"],
    eigenvalues: Float[Array, " k"],
    A_norm: Float[Array, ""],
) -> Float[Array, " k"]:
    """‖A x − λ B x‖₂ / (‖A‖₂ ‖x‖₂) of each column, with ‖A‖₂ from `spectral_norm`."""
    return jnp.linalg.norm(A_x - B_x * eigenvalues[None, :], axis=0) / (A_norm * jnp.linalg.norm(x, axis=0))
