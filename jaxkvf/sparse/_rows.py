"""The one format for block matrices that multiply blocks of vectors, on CPU and GPU.

A product is a sum of terms for each row. The terms stand in slots, as many for each row of a class (ELLPACK), so that all
rows of the class advance by one term at once: gathers, which XLA fuses into one loop, and no scatter. Where a pattern is
known on the host, there are classes enough for all terms. Where it is traced, shapes must follow from sizes alone: there is
one class, and what rows longer than its slots have more is a list, gone through by a loop that ends where the list does.
"""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..compiled import compiled, in_threads
from ._blocks import gathered, gathered_or_zero, sum_of_chunks
from ._graph import Graph, by_row
from ._slots import NOTHING, UNROLLED, Slots, Table, row_parts
from ._sparsity import Sparsity

_AT_ONCE = 1024  # terms of long rows

BlocksAt = Callable[[Int[Array, "*shape"]], Float[Array, "*shape r c"]]
"""The blocks with these numbers, zero for numbers out of bounds."""


class _Rest(eqx.Module):
    """Terms that found no slot: the first `count` of these."""

    rows: Int[Array, " terms"]
    columns: Int[Array, " terms"]
    entries: Int[Array, " terms"]
    count: Int[Array, ""]


class RowLayout(eqx.Module):
    """A pattern laid out for products with blocks of vectors."""

    columns: tuple[Int[Array, "_ _ _"], ...]
    """Column block of each term [chunk, slot, row], for each class; the terms are added in chunks."""
    entries: tuple[Int[Array, "_ _ _"], ...]
    """Number of each term's block; out of bounds for none."""
    places: Int[Array, " n"] | None = None
    """Where each row has gone, unless all stand in their order."""
    rest: _Rest | None = None

    @classmethod
    def build(cls, sparsity: Sparsity) -> "RowLayout":
        """On the host, in as many classes as pay."""
        table = Table.of(np.diff(sparsity.starts))
        columns, entries = table.empty(), table.empty()
        in_threads(
            lambda rows: _write_rows(rows, sparsity, table.slots, columns, entries),
            row_parts(sparsity.starts),
        )
        return cls(table.parts(columns), table.parts(entries), table.order)

    @classmethod
    def of_graph(cls, graph: Graph) -> "RowLayout":
        """Of a `SymmetricBlockOperator` on this graph, with its numbers of blocks; runs under `jit`."""
        n, m = graph.n_nodes, len(graph.edges)
        nodes = jnp.arange(n, dtype=graph.views.dtype)
        views, left_over, count = _slots(graph.starts, graph.views, reserved=1)
        tail, head = graph.edges.T
        here, there = jnp.concatenate([tail, head]), jnp.concatenate([head, tail])

        def numbers(views: Int[Array, "*v"]) -> Int[Array, "*v"]:
            return jnp.where(views < 2 * m, n + views, NOTHING)

        rest = _Rest(
            gathered_or_zero(here, left_over),
            gathered_or_zero(there, left_over),
            numbers(left_over),
            count,
        )
        columns = jnp.concatenate([nodes[None], gathered_or_zero(there, views)])
        entries = jnp.concatenate([nodes[None], numbers(views)])
        return cls((_chunked(columns),), (_chunked(entries),), rest=rest)

    @classmethod
    def of_terms(cls, rows: Int[Array, " t"], columns: Int[Array, " t"], n: int) -> "RowLayout":
        """Of a matrix of n rows with blocks in these places, by number; runs under `jit`."""
        terms, left_over, count = _slots(*by_row(rows, n), reserved=0)
        rest = _Rest(
            gathered_or_zero(rows, left_over), gathered_or_zero(columns, left_over), left_over, count
        )
        return cls((_chunked(gathered_or_zero(columns, terms)),), (_chunked(terms),), rest=rest)

    def fill(self, blocks: Float[Array, "m _ _"] | BlocksAt, *, transposed: bool = False) -> "RowProduct":
        """The matrix with these blocks, or with their transposes."""
        blocks_at: BlocksAt = blocks if callable(blocks) else eqx.Partial(gathered_or_zero, blocks)
        values = tuple(blocks_at(entries) for entries in self.entries)
        rest = None if self.rest is None else (self.rest, blocks_at)
        return RowProduct(values, self.columns, self.places, rest, transposed)


class RowProduct(eqx.Module):
    """X ↦ M X for a matrix M of r × c blocks; unknown a of node i is number r i + a of the result."""

    values: tuple[Float[Array, "_ _ _ _ _"], ...]
    """The block of each term, or its transpose."""
    columns: tuple[Int[Array, "_ _ _"], ...]
    places: Int[Array, " n"] | None
    rest: tuple[_Rest, BlocksAt] | None
    transposed: bool = eqx.field(static=True)

    def __call__(self, block: Float[Array, "mc k"]) -> Float[Array, "nr k"]:
        r, c = self.values[0].shape[3:][:: -1 if self.transposed else 1]

        def chunk(values: Float[Array, "slots rows _ _"], columns: Int[Array, "slots rows"]) -> Array:
            def term(slot: int, b: int) -> Float[Array, "rows_r k"]:
                row = c * columns[slot] + b
                row = jnp.broadcast_to(row[:, None], (len(row), r)).reshape(-1)
                factor = values[slot, :, b] if self.transposed else values[slot, :, :, b]
                return factor.reshape(-1)[:, None] * gathered(block, row)

            return functools.reduce(jnp.add, (term(s, b) for s in range(len(values)) for b in range(c)))

        sums = [
            sum_of_chunks(chunk, (values.shape[2] * r, block.shape[1]), block.dtype, values, columns)
            for values, columns in zip(self.values, self.columns, strict=True)
        ]
        product = jnp.concatenate(sums)
        if self.places is not None:
            rows = product.reshape(-1, r * block.shape[1])
            product = gathered(rows, self.places).reshape(product.shape)
        return product if self.rest is None else self._with_rest(product, block, r, c)

    def _with_rest(
        self, product: Float[Array, "nr k"], block: Float[Array, "mc k"], r: int, c: int
    ) -> Float[Array, "nr k"]:
        assert self.rest is not None
        rest, blocks_at = self.rest

        def add(turn: Array, product: Float[Array, "nr k"]) -> Float[Array, "nr k"]:
            rows, columns, entries = (
                jax.lax.dynamic_slice_in_dim(part, turn * _AT_ONCE, _AT_ONCE)
                for part in (rest.rows, rest.columns, rest.entries)
            )
            values = blocks_at(entries)
            read = gathered(block, c * columns[:, None] + jnp.arange(c, dtype=columns.dtype)[None])
            write = r * rows[:, None] + jnp.arange(r, dtype=rows.dtype)[None]
            return product.at[write].add((values.mT if self.transposed else values) @ read)

        return jax.lax.fori_loop(0, -(-rest.count // _AT_ONCE), add, product)


def _chunked(table: Int[Array, "slots n"]) -> Int[Array, "_ _ n"]:
    slots, n = table.shape
    return table.reshape(-(-slots // UNROLLED), -1, n)


def _slots(
    starts: Int[Array, " starts"], terms: Int[Array, " terms"], *, reserved: int
) -> tuple[Int[Array, "width n"], Int[Array, " rest"], Int[Array, ""]]:
    """The terms of each row in slots, those that found none, and how many these are; out of bounds where there is none.

    Args:
        starts: where each row's terms start.
        terms: by row.
        reserved: slots of each row that are taken already; all together make whole chunks.
    """
    n, none = len(starts) - 1, len(terms)
    # A fifth above the mean length: a term that finds no slot costs as much as seven slots.
    wanted = reserved + max(1, 6 * none // (5 * n))
    chunks = -(-wanted // UNROLLED)
    width = -(-wanted // chunks) * chunks - reserved
    position = starts[None, :-1] + jnp.arange(width, dtype=starts.dtype)[:, None]
    position = jnp.where(position < starts[None, 1:], position, none)
    slots = terms.at[position].get(mode="fill", fill_value=NOTHING, wrap_negative_indices=False)

    count = jnp.maximum(jnp.diff(starts) - width, 0).sum(dtype=jnp.int32)
    capacity = max(1, -(-none // _AT_ONCE)) * _AT_ONCE

    def left_over() -> Int[Array, " rest"]:
        place = jnp.arange(none, dtype=starts.dtype)
        row = jnp.searchsorted(starts, place, side="right") - 1
        waits = place - starts[row] >= width
        place = jnp.where(waits, jnp.cumsum(waits) - 1, capacity)
        return jnp.full(capacity, NOTHING, terms.dtype).at[place].set(terms, mode="drop")

    rest = jax.lax.cond(count > 0, left_over, lambda: jnp.full(capacity, NOTHING, terms.dtype))
    return slots, rest, count


@compiled
def _write_rows(
    rows: tuple[int, int],
    sparsity: Sparsity,
    slots: Slots,
    columns: Int[np.ndarray, " slots"],
    entries: Int[np.ndarray, " slots"],
) -> None:
    """The entries from one row to another into their slots, column 0 and no entry into those left over."""
    for row in range(rows[0], rows[1]):
        place = slots.places[row]
        k = np.searchsorted(slots.firsts, place, side="right") - 1
        size = slots.firsts[k + 1] - slots.firsts[k]
        slot = slots.offsets[k] + place - slots.firsts[k]
        end = slot + slots.widths[k] * size
        for i in range(sparsity.starts[row], sparsity.starts[row + 1]):
            columns[slot], entries[slot] = sparsity.columns[i], sparsity.entries[i]
            slot += size
        while slot < end:
            columns[slot], entries[slot] = 0, NOTHING
            slot += size
