"""Sparse matrices laid out for fast products with a block of vectors, on CPU and GPU.

A row's entries stand in slots of fixed number (ELLPACK), and a product is a sum over slots of elementwise products with
gathered rows, which XLA fuses into one loop without a scatter. Rows with more entries keep the rest in a list.
"""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float, Int

from ..sparse import SymmetricBlockOperator, TransposedRowSparseOperator, assembled, matmat

BlockProduct = Callable[[Float[Array, "n k"]], Float[Array, "n k"]]

_CHUNK = 1024  # overflowing blocks multiplied at once


class EllProduct(eqx.Module):
    """X ↦ M X for a matrix of b × b blocks in ELLPACK layout."""

    entries: Float[Array, "width b nb"]
    """Entry [s, c, b i + a] is that of row a in row block i and column c of the block in its slot s; 0 in empty slots."""
    neighbours: Int[Array, "width n"]
    """Column block of each slot."""
    overflow_blocks: Float[Array, "rest b b"]
    """Blocks that found no slot, in front; zeros behind."""
    overflow_places: Int[Array, "rest 2"]
    """Row block and column block of each."""
    n_overflow: Int[Array, ""]

    def __call__(self, block: Float[Array, "mb k"]) -> Float[Array, "nb k"]:
        width, b, _ = self.entries.shape

        def gathered(slot: int, c: int) -> Float[Array, "nb k"]:
            rows = b * self.neighbours[slot] + c
            rows = jnp.broadcast_to(rows[:, None], (len(rows), b)).reshape(
                -1
            )  # all rows of a block read the same
            return block.at[rows].get(mode="promise_in_bounds")  # else XLA clamps every index: 3 times slower

        slots = [(s, c) for s in range(width) for c in range(b)]
        product = functools.reduce(jnp.add, (self.entries[s, c][:, None] * gathered(s, c) for s, c in slots))

        def add_chunk(chunk: Array, product: Float[Array, "nb k"]) -> Float[Array, "nb k"]:
            place = jax.lax.dynamic_slice_in_dim(self.overflow_places, chunk * _CHUNK, _CHUNK)
            blocks = jax.lax.dynamic_slice_in_dim(self.overflow_blocks, chunk * _CHUNK, _CHUNK)
            unknown = b * place[:, :, None] + jnp.arange(b, dtype=place.dtype)[None, None]
            return product.at[unknown[:, 0]].add(blocks @ block[unknown[:, 1]])

        return jax.lax.fori_loop(0, (self.n_overflow + _CHUNK - 1) // _CHUNK, add_chunk, product)


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
    slots, rest, n_overflow = _slots(M.columns.ravel(), M.n_columns, None)
    values = jnp.append(M.values.ravel(), 0)
    places = jnp.stack([jnp.append(M.columns.ravel(), 0)[rest], rest // width % m], axis=1)
    return EllProduct(
        entries=values[slots][:, None],
        neighbours=slots // width % m,
        overflow_blocks=values[rest][:, None, None],
        overflow_places=places,
        n_overflow=n_overflow,
    )


@block_product.register
def _(operator: SymmetricBlockOperator) -> BlockProduct:
    n, b, _ = operator.diagonal.shape
    # Each edge is seen from its tail and from its head; the view numbered 2m is the empty one.
    rows = operator.edges.T.reshape(-1)
    columns = jnp.append(operator.edges[:, ::-1].T.reshape(-1), 0)
    blocks = jnp.concatenate([operator.upper, operator.upper.mT, jnp.zeros((1, b, b), operator.upper.dtype)])
    view, rest, n_overflow = _slots(rows, n, operator.row_order)
    entries = jnp.concatenate([operator.diagonal[None], blocks[view]])
    return EllProduct(
        entries=entries.transpose(0, 3, 1, 2).reshape(len(entries), b, n * b),
        neighbours=jnp.concatenate([jnp.arange(n, dtype=columns.dtype)[None], columns[view]]),
        overflow_blocks=blocks[rest],
        overflow_places=jnp.stack([jnp.append(rows, 0)[rest], columns[rest]], axis=1),
        n_overflow=n_overflow,
    )


def _slots(
    rows: Int[Array, " terms"], n: int, order: Int[Array, " terms"] | None
) -> tuple[Int[Array, "width n"], Int[Array, " rest"], Int[Array, ""]]:
    """The terms of each row in slots, those that found none, and how many these are; one past the last stands for none.

    Args:
        rows: of each term.
        n: number of rows.
        order: the terms sorted by row, where that is known.
    """
    none = len(rows)
    terms = jnp.argsort(rows).astype(rows.dtype) if order is None else order
    lengths = jnp.zeros(n, terms.dtype).at[rows].add(1)
    ends = jnp.cumsum(lengths)
    starts = ends - lengths

    # A fifth above the mean length: a term that finds no slot costs as much as seven slots.
    width = max(1, 6 * none // (5 * n))
    position = starts[None] + jnp.arange(width, dtype=starts.dtype)[:, None]
    slots = jnp.append(terms, none)[jnp.where(position < ends[None], position, none)]

    left_over = jnp.arange(none, dtype=starts.dtype) - starts[rows[terms]] >= width
    place = jnp.where(left_over, jnp.cumsum(left_over) - 1, none)
    capacity = max(1, -(-none // _CHUNK)) * _CHUNK
    rest = jnp.full(capacity, none, terms.dtype).at[place].set(terms, mode="drop")
    return slots, rest, left_over.sum(dtype=jnp.int32)
