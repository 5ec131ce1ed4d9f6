"""Chebyshev smoothing: polynomials that make an error small in the upper part of a spectrum.

Reference: J. Lottes, Optimal polynomial smoothers for multigrid V-cycles (2023).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, DTypeLike, Float

from ._ell import BlockProduct
from ._residual import spectral_norm

_MARGIN = 1.1  # over the estimate of the largest eigenvalue, which is from below


class Smoother(eqx.Module):
    """Chebyshev iteration of the fourth kind for K x = b, at `degree` products with K less one; K's diagonal is about 1."""

    K: BlockProduct
    largest: Float[Array, ""]
    """Upper bound of the eigenvalues of K."""
    degree: int = eqx.field(static=True)

    @classmethod
    def prepare(cls, K: BlockProduct, size: int, dtype: DTypeLike, degree: int) -> "Smoother":
        return cls(K, _MARGIN * spectral_norm(K, size, dtype), degree)

    def from_zero(self, b: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """An approximation of K⁻¹ b: a polynomial in K times b."""
        return self._iterated(b, jnp.zeros_like(b), 4 / 3 / self.largest * b, 2)

    def from_guess(self, b: Float[Array, "n k"], x: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """x and that approximation for its residual, at one product more."""
        return self._iterated(b, x, jnp.zeros_like(b), 1)

    def _iterated(
        self, b: Float[Array, "n k"], x: Float[Array, "n k"], d: Float[Array, "n k"], first: int
    ) -> Float[Array, "n k"]:
        """x after the last correction d and those from number `first` on.

        They make the error's components in all of K's spectrum small, most so those on top.
        """

        def step(i: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
            x, d = carry
            i = i.astype(b.dtype)
            # In this order neither x nor d is copied, and XLA computes the product once: everywhere that it is used.
            x = x + d
            residual = b - self.K(x)
            return x, (2 * i - 3) / (2 * i + 1) * d + (8 * i - 4) / (2 * i + 1) / self.largest * residual

        x, d = jax.lax.fori_loop(first, self.degree + 1, step, (x, d))
        return x + d
