"""Preconditioners that need no hierarchy: block Jacobi, and Chebyshev polynomials over it."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..eigen import AbstractApproximateInverse, AbstractPreconditioner, GeneralizedEigenproblem
from ..sparse import (
    BlockProduct,
    apply_blocks,
    block_product,
    inverse_factors,
    known_diagonal_blocks,
    spectral_norm,
)

_MARGIN = 1.1  # over the estimate of the largest eigenvalue, which is from below


class BlockJacobi(AbstractPreconditioner):
    """The inverse of the diagonal blocks of A, made positive definite; of its diagonal, where A has no blocks."""

    def prepare(self, problem: GeneralizedEigenproblem) -> AbstractApproximateInverse:
        """The approximate inverse.

        Raises:
            ValueError: the diagonal of A is not to be had without forming all of A.
        """
        factors = inverse_factors(known_diagonal_blocks(problem.A))
        return _BlockDiagonal(jnp.einsum("nca,ncb->nab", factors, factors))


class Chebyshev(AbstractPreconditioner):
    """A polynomial of block Jacobi and A, of this degree, close to A⁻¹ on all but the lowest 1/degree² of the spectrum.

    Costs `degree` products with A; the number of LOBPCG steps falls about as fast as they grow, and the rest of a step is
    saved.
    """

    degree: int = eqx.field(default=32, static=True)

    def __check_init__(self) -> None:
        if self.degree < 1:
            raise ValueError(f"degree must be at least 1, got {self.degree}")

    def prepare(self, problem: GeneralizedEigenproblem) -> AbstractApproximateInverse:
        """The approximate inverse.

        Raises:
            ValueError: the diagonal of A is not to be had without forming all of A.
        """
        factors = inverse_factors(known_diagonal_blocks(problem.A))
        A = block_product(problem.A)
        largest = spectral_norm(
            lambda x: apply_blocks(factors, A(apply_blocks(factors.mT, x))), problem.size, problem.dtype
        )
        jacobi = _BlockDiagonal(jnp.einsum("nca,ncb->nab", factors, factors))
        return _ChebyshevPolynomial(A, jacobi, _MARGIN * largest, self.degree)


class _BlockDiagonal(AbstractApproximateInverse):
    blocks: Float[Array, "n b b"]

    def apply(self, block: Float[Array, "nb k"]) -> Float[Array, "nb k"]:
        return apply_blocks(self.blocks, block)

    def starting_vectors(self, count: int) -> None:
        return None


class _ChebyshevPolynomial(AbstractApproximateInverse):
    """Chebyshev iteration for A z = r from z = 0, on the eigenvalues [largest / degree², largest] of Jacobi times A."""

    A: BlockProduct
    jacobi: _BlockDiagonal
    largest: Float[Array, ""]
    degree: int = eqx.field(static=True)

    def apply(self, block: Float[Array, "nb k"]) -> Float[Array, "nb k"]:
        smallest = self.largest / max(4, self.degree**2)
        centre, radius = (self.largest + smallest) / 2, (self.largest - smallest) / 2

        def step(_: Array, carry: tuple[Array, ...]) -> tuple[Array, ...]:
            z, r, d, ratio = carry
            r = r - self.A(d)
            following = 1 / (2 * centre / radius - ratio)
            d = following * ratio * d + 2 * following / radius * self.jacobi.apply(r)
            return z + d, r, d, following

        first = self.jacobi.apply(block) / centre
        carry = (first, block, first, radius / centre)
        return jax.lax.fori_loop(0, self.degree, step, carry)[0]

    def starting_vectors(self, count: int) -> None:
        return None
