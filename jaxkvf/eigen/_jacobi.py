"""Preconditioners that need no hierarchy: block Jacobi, and Chebyshev polynomials over it."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float

from ..sparse import SymmetricBlockOperator, assembled
from ._ell import BlockProduct, block_product
from ._preconditioner import AbstractApproximateInverse, AbstractPreconditioner
from ._problem import GeneralizedEigenproblem
from ._residual import spectral_norm

_MARGIN = 1.1  # over the estimate of the largest eigenvalue, which is from below


class BlockJacobi(AbstractPreconditioner):
    """The inverse of the diagonal blocks of A, made positive definite; of its diagonal, where A has no blocks."""

    def prepare(self, problem: GeneralizedEigenproblem) -> AbstractApproximateInverse:
        """The approximate inverse.

        Raises:
            ValueError: the diagonal of A is not to be had without forming all of A.
        """
        factors = _inverse_factors(_known_diagonal_blocks(problem.A))
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
        factors = _inverse_factors(_known_diagonal_blocks(problem.A))
        A = block_product(problem.A)
        largest = spectral_norm(
            lambda x: _apply_blocks(factors, A(_apply_blocks(factors.mT, x))), problem.size, problem.dtype
        )
        jacobi = _BlockDiagonal(jnp.einsum("nca,ncb->nab", factors, factors))
        return _ChebyshevPolynomial(A, jacobi, _MARGIN * largest, self.degree)


class _BlockDiagonal(AbstractApproximateInverse):
    blocks: Float[Array, "n b b"]

    def apply(self, block: Float[Array, "nb k"]) -> Float[Array, "nb k"]:
        return _apply_blocks(self.blocks, block)

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


def _apply_blocks(blocks: Float[Array, "n b b"], block: Float[Array, "nb k"]) -> Float[Array, "nb k"]:
    n, b, _ = blocks.shape
    x = block.reshape(n, b, -1)
    columns = (blocks[:, :, c, None] * x[:, None, c, :] for c in range(b))
    return functools.reduce(jnp.add, columns).reshape(block.shape)


def _inverse_factors(blocks: Float[Array, "n b b"]) -> Float[Array, "n b b"]:
    """G = |D|^(−½) L⁻¹ for blocks L D Lᵀ: GᵀG is the inverse of a positive definite block, and definite for any other.

    Pivots of no size at all are replaced by the mean diagonal entry.
    """
    b = blocks.shape[1]
    diagonal = jnp.abs(blocks.diagonal(axis1=1, axis2=2))
    mean = jnp.where(diagonal.mean() > 0, diagonal.mean(), 1)
    least = jnp.finfo(blocks.dtype).eps * jnp.where(diagonal.max(axis=1) > 0, diagonal.max(axis=1), jnp.inf)
    rest = blocks
    inverse = jnp.broadcast_to(jnp.eye(b, dtype=blocks.dtype), blocks.shape)
    pivots = []
    for j in range(b):
        pivot = rest[:, j, j]
        usable = jnp.abs(pivot) > least
        pivot = jnp.where(usable, pivot, mean)
        below = jnp.where(usable[:, None] & (jnp.arange(b) > j)[None, :], rest[:, :, j] / pivot[:, None], 0)
        rest = rest - below[:, :, None] * rest[:, None, j, :]
        inverse = inverse - below[:, :, None] * inverse[:, None, j, :]
        pivots.append(jnp.abs(pivot))
    return inverse * jax.lax.rsqrt(jnp.stack(pivots, axis=1))[:, :, None]


def _known_diagonal_blocks(operator: lx.AbstractLinearOperator) -> Float[Array, "n b b"]:
    blocks = _diagonal_blocks(assembled(operator))
    if blocks is None:
        raise ValueError(
            f"Jacobi preconditioners need the diagonal of A, which {type(operator).__name__} does not tell: "
            "use `SymmetricBlockOperator`, or `lineax.materialise` it"
        )
    return blocks


def cheap_diagonal(operator: lx.AbstractLinearOperator) -> Float[Array, " n"] | None:
    """The diagonal, where it is to be had without forming the matrix."""
    blocks = _diagonal_blocks(operator)
    return None if blocks is None else blocks.diagonal(axis1=1, axis2=2).ravel()


@functools.singledispatch
def _diagonal_blocks(operator: lx.AbstractLinearOperator) -> Float[Array, "n b b"] | None:
    return None


@_diagonal_blocks.register
def _(operator: SymmetricBlockOperator) -> Float[Array, "n b b"]:
    return operator.diagonal


@_diagonal_blocks.register(lx.DiagonalLinearOperator)
@_diagonal_blocks.register(lx.MatrixLinearOperator)
@_diagonal_blocks.register(lx.IdentityLinearOperator)
def _(operator: lx.AbstractLinearOperator) -> Float[Array, "n 1 1"]:
    return lx.diagonal(operator)[:, None, None]


@_diagonal_blocks.register
def _(operator: lx.TaggedLinearOperator) -> Float[Array, "n b b"] | None:
    return _diagonal_blocks(operator.operator)


@_diagonal_blocks.register
def _(operator: lx.MulLinearOperator) -> Float[Array, "n b b"] | None:
    blocks = _diagonal_blocks(operator.operator)
    return None if blocks is None else blocks * operator.scalar


@_diagonal_blocks.register
def _(operator: lx.AddLinearOperator) -> Float[Array, "n b b"] | None:
    blocks, others = (_diagonal_blocks(term) for term in (operator.operator1, operator.operator2))
    if blocks is None or others is None:
        return None
    if blocks.shape != others.shape:
        blocks, others = (part.diagonal(axis1=1, axis2=2).reshape(-1, 1, 1) for part in (blocks, others))
    return blocks + others
