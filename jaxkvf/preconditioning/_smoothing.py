"""Chebyshev smoothing: polynomials that make an error small in the upper part of a spectrum.

Reference: J. Lottes, Optimal polynomial smoothers for multigrid V-cycles (2023).
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, DTypeLike, Float

from ..sparse import BlockProduct, spectral_norm

_MARGIN = 1.1  # over the estimate of the largest eigenvalue, which is from below


class Smoother(eqx.Module):
    """Chebyshev iteration of the fourth kind for K x = b, at `degree` products with K; K's diagonal is about 1."""

    K: BlockProduct
    largest: Float[Array, ""]
    """Upper bound of the eigenvalues of K."""
    degree: int = eqx.field(static=True)

    @classmethod
    def prepare(cls, K: BlockProduct, size: int, dtype: DTypeLike, degree: int) -> "Smoother":
        return cls(K, _MARGIN * spectral_norm(K, size, dtype), degree)

    def around(
        self, b: Float[Array, "n k"], correction: Callable[[Float[Array, "n k"]], Float[Array, "n k"]]
    ) -> Float[Array, "n k"]:
        """K⁻¹ b, nearly: by smoothing, correction of what that leaves, and smoothing. Symmetric if the correction is.

        Args:
            b: the right-hand sides.
            correction: from a residual to a correction.
        """
        # Behind the last correction d the loop leaves the residual in its place: so the product stands in the program once.
        x, residual = self._iterated(b, jnp.zeros_like(b), 4 / 3 / self.largest * b, 2, self.degree + 2)
        return self.from_guess(b, x + correction(residual))

    def from_guess(self, b: Float[Array, "n k"], x: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """x, and a polynomial in K times its residual, as an approximation of K⁻¹ b."""
        x, d = self._iterated(b, x, jnp.zeros_like(b), 1, self.degree + 1)
        return x + d

    def _iterated(
        self, b: Float[Array, "n k"], x: Float[Array, "n k"], d: Float[Array, "n k"], first: int, end: int
    ) -> tuple[Float[Array, "n k"], Float[Array, "n k"]]:
        """x with the correction d and those from number `first` on, and, not added, number `end` − 1.

        They make the error's components in all of K's spectrum small, most so those on top. What comes behind number
        `degree` is the residual of x.
        """

        def step(i: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
            x, d = carry
            n = i.astype(b.dtype)
            a, c = (2 * n - 3) / (2 * n + 1), (8 * n - 4) / (2 * n + 1) / self.largest
            a, c = jnp.where(i <= self.degree, a, 0), jnp.where(i <= self.degree, c, 1)
            # In this order neither x nor d is copied, and XLA computes the product once: everywhere that it is used.
            x = x + d
            return x, a * d + c * (b - self.K(x))

        return jax.lax.fori_loop(first, end, step, (x, d))
