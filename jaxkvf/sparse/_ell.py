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

from ._blocks import apply_blocks, gathered, gathered_or_zero
from ._operators import SymmetricBlockOperator, TransposedRowSparseOperator, assembled, matmat

BlockProduct = Callable[[Float[Array, "n k"]], Float[Array, "n k"]]

_CHUNK = 1024  # overflowing blocks multiplied at once


class EllProduct(eqx.Module):
    """X ↦ M X for a matrix of b × b blocks in ELLPACK layout."""

    entries: Float[Array, "width n b b"]
    """The block in each slot of each row, 0 in empty slots."""
    neighbours: Int[Array, "width n"]
    """Its column block."""
    overflow: Int[Array, " rest"]
    """Terms that found no slot, in front."""
    n_overflow: Int[Array, ""]
    place_of: Callable[[Int[Array, " t"]], tuple[Array, Array, Array]]
    """Row block, column block and block of such terms; a block of zeros for those behind."""

    def __call__(self, block: Float[Array, "mb k"]) -> Float[Array, "nb k"]:
        width, n, b, _ = self.entries.shape

        def term(slot: int, c: int) -> Float[Array, "nb k"]:
            rows = b * self.neighbours[slot] + c
            rows = jnp.broadcast_to(rows[:, None], (n, b)).reshape(-1)  # all rows of a block read the same
            return self.entries[slot, :, :, c].reshape(-1)[:, None] * gathered(block, rows)

        product = functools.reduce(jnp.add, (term(s, c) for s in range(width) for c in range(b)))

        def add_chunk(chunk: Array, product: Float[Array, "nb k"]) -> Float[Array, "nb k"]:
            terms = jax.lax.dynamic_slice_in_dim(self.overflow, chunk * _CHUNK, _CHUNK)
            rows, columns, blocks = self.place_of(terms)
            within = jnp.arange(b, dtype=rows.dtype)[None]
            read = block[b * columns[:, None] + within]
            return product.at[b * rows[:, None] + within].add(blocks @ read)

        # XLA computes what enters a loop once, not anew wherever it is used.
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
    rows = M.columns.ravel()
    slots, overflow, n_overflow = _slots(*_by_row(rows, M.n_columns))
    values = M.values.ravel()
    return EllProduct(
        entries=gathered_or_zero(values, slots)[:, :, None, None],
        neighbours=slots // M.columns.shape[1] % len(M.columns),
        overflow=overflow,
        n_overflow=n_overflow,
        place_of=eqx.Partial(_transposed_terms, M.columns, values),
    )


def _transposed_terms(
    columns: Int[Array, "m width"], values: Float[Array, " t"], terms: Int[Array, " chunk"]
) -> tuple[Array, Array, Array]:
    blocks = gathered_or_zero(values, terms)[:, None, None]
    row = columns.ravel().at[terms].get(mode="clip")
    return row, terms // columns.shape[1] % len(columns), blocks


@block_product.register
def _(operator: SymmetricBlockOperator) -> BlockProduct:
    n, edges = len(operator.diagonal), operator.edges
    if len(edges) == 0:
        return eqx.Partial(apply_blocks, operator.diagonal)
    starts, views = _by_row(edges.T.reshape(-1), n) if operator.views is None else operator.views
    slots, overflow, n_overflow = _slots(starts, views)
    itself = jnp.arange(n, dtype=edges.dtype)[None]
    _, neighbours, blocks = _edge_terms(edges, operator.upper, slots)
    return EllProduct(
        entries=jnp.concatenate([operator.diagonal[None], blocks]),
        neighbours=jnp.concatenate([itself, neighbours]),
        overflow=overflow,
        n_overflow=n_overflow,
        place_of=eqx.Partial(_edge_terms, edges, operator.upper),
    )


def _edge_terms(
    edges: Int[Array, "m 2"], upper: Float[Array, "m b b"], views: Int[Array, "*v"]
) -> tuple[Array, Array, Array]:
    """Row block, column block and block of edges seen from their tails (e) and heads (m + e); zero for no edge."""
    m = len(edges)
    edge = jnp.where(views < m, views, views - m)
    tail, head = (gathered_or_zero(edges[:, end], edge) for end in (0, 1))
    blocks = gathered_or_zero(upper, edge)
    from_tail = views < m
    return (
        jnp.where(from_tail, tail, head),
        jnp.where(from_tail, head, tail),
        jnp.where(from_tail[..., None, None], blocks, blocks.mT),
    )


_NOTHING = int(jnp.iinfo(jnp.int32).max)


def _by_row(rows: Int[Array, " terms"], n: int) -> tuple[Int[Array, " starts"], Int[Array, " terms"]]:
    """Where each row's terms start, and the terms by row."""
    counts = jnp.zeros(n + 1, rows.dtype).at[rows + 1].add(1)
    return jnp.cumsum(counts, dtype=rows.dtype), jnp.argsort(rows).astype(rows.dtype)


def _slots(
    starts: Int[Array, " starts"], terms: Int[Array, " terms"]
) -> tuple[Int[Array, "width n"], Int[Array, " rest"], Int[Array, ""]]:
    """The terms of each row in slots, those that found none, and how many these are; out of bounds where there is none.

    Args:
        starts: where each row's terms start.
        terms: by row.
    """
    n, none = len(starts) - 1, len(terms)
    # A fifth above the mean length: a term that finds no slot costs as much as seven slots.
    width = max(1, 6 * none // (5 * n))
    position = starts[None, :-1] + jnp.arange(width, dtype=starts.dtype)[:, None]
    position = jnp.where(position < starts[None, 1:], position, none)
    slots = terms.at[position].get(mode="fill", fill_value=_NOTHING, wrap_negative_indices=False)

    n_overflow = jnp.maximum(jnp.diff(starts) - width, 0).sum(dtype=jnp.int32)
    capacity = max(1, -(-none // _CHUNK)) * _CHUNK

    def left_over() -> Int[Array, " rest"]:
        place = jnp.arange(none, dtype=starts.dtype)
        row = jnp.searchsorted(starts, place, side="right") - 1
        waits = place - starts[row] >= width
        place = jnp.where(waits, jnp.cumsum(waits) - 1, capacity)
        return jnp.full(capacity, _NOTHING, terms.dtype).at[place].set(terms, mode="drop")

    rest = jax.lax.cond(n_overflow > 0, left_over, lambda: jnp.full(capacity, _NOTHING, terms.dtype))
    return slots, rest, n_overflow
