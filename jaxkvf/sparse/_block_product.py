"""Operators prepared for many products with blocks of vectors."""

import functools
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float

from ._blocks import apply_blocks
from ._operators import SymmetricBlockOperator, TransposedRowSparseOperator, assembled, matmat
from ._rows import RowLayout

BlockProduct = Callable[[Float[Array, "n k"]], Float[Array, "n k"]]


@functools.singledispatch
def block_product(operator: lx.AbstractLinearOperator) -> BlockProduct:
    """X ↦ M X for blocks X `[n, k]` of any k, prepared for many products. Runs under `jit`."""
    matrix = assembled(operator)
    return eqx.Partial(matmat, operator) if matrix is operator else block_product(matrix)


@block_product.register
def _(operator: lx.TaggedLinearOperator) -> BlockProduct:
    return block_product(operator.operator)


@block_product.register
def _(operator: lx.AddLinearOperator) -> BlockProduct:
    return eqx.Partial(_sum, block_product(operator.operator1), block_product(operator.operator2))


@block_product.register
def _(operator: lx.ComposedLinearOperator) -> BlockProduct:
    return eqx.Partial(_composition, block_product(operator.operator1), block_product(operator.operator2))


@block_product.register
def _(operator: lx.MulLinearOperator) -> BlockProduct:
    return eqx.Partial(_multiple, operator.scalar, block_product(operator.operator))


def _sum(first: BlockProduct, second: BlockProduct, block: Float[Array, "n k"]) -> Float[Array, "m k"]:
    return first(block) + second(block)


def _composition(outer: BlockProduct, inner: BlockProduct, block: Float[Array, "n k"]) -> Float[Array, "m k"]:
    return outer(inner(block))


def _multiple(
    scalar: float | Array, product: BlockProduct, block: Float[Array, "n k"]
) -> Float[Array, "m k"]:
    return product(block) * scalar


@block_product.register
def _(operator: TransposedRowSparseOperator) -> BlockProduct:
    M = operator.of
    m, width = M.columns.shape
    row_of_each = jnp.repeat(jnp.arange(m, dtype=M.columns.dtype), width)
    return RowLayout.of_terms(M.columns.ravel(), row_of_each, M.n_columns).fill(M.values.reshape(-1, 1, 1))


@block_product.register
def _(operator: SymmetricBlockOperator) -> BlockProduct:
    if len(operator.upper) == 0:
        return eqx.Partial(apply_blocks, operator.diagonal)
    return RowLayout.of_graph(operator.graph).fill(eqx.Partial(SymmetricBlockOperator.blocks, operator))
