"""Sparsity laid out on the host, numbers filled in under jit: block matrices times blocks of vectors, and times each other.

Both kinds of product are sums of a varying number of terms, one sum a row (or an entry). Sums of similar length stand
together, padded to the same length, so that all of them advance by one term at once: gathers and no scatter.
"""

# pyright: reportAttributeAccessIssue=false, reportCallIssue=false, reportArgumentType=false
# (the stubs of NumPy and SciPy know too little of complex and sparse arrays)

import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

_T = TypeVar("_T")
_U = TypeVar("_U")

_MOST_CLASSES = 3  # lengths that sums are padded to
_WORTH_A_CLASS = 0.9  # padding must fall to this for one more: each costs compilation, and the sums' order
_CHUNK = 1 << 19  # terms at a time on the host, to stay in its cache
_UNROLLED = 8  # terms added at once: fewer cost memory traffic, more cost compilation


class Pattern(NamedTuple):
    """Where a block matrix has entries, by rows: those of row r are `starts[r] : starts[r + 1]`. NumPy, on the host."""

    starts: np.ndarray
    columns: np.ndarray
    """Column block of each entry, ascending in each row."""
    entries: np.ndarray
    """Number of each entry's block in the list of blocks that goes with the matrix."""
    n_columns: int

    @property
    def n_rows(self) -> int:
        return len(self.starts) - 1

    @property
    def rows(self) -> np.ndarray:
        return np.repeat(np.arange(self.n_rows, dtype=np.int32), np.diff(self.starts))

    @classmethod
    def from_entries(
        cls, rows: np.ndarray, columns: np.ndarray, entries: np.ndarray, shape: tuple[int, int]
    ) -> "Pattern":
        """From triples in any order, no place twice."""
        matrix = sp.coo_array((entries.astype(np.int32), (rows, columns)), shape=shape).tocsr()
        return cls(matrix.indptr, matrix.indices, matrix.data, shape[1])

    @classmethod
    def of_graph(cls, edges: Int[np.ndarray, "m 2"], n_nodes: int) -> "Pattern":
        """Of a `SymmetricBlockOperator`: its blocks are the diagonal ones, the upper ones, the transposed upper ones."""
        nodes, (tail, head) = np.arange(n_nodes, dtype=np.int32), edges.T
        rows, columns = np.concatenate([nodes, tail, head]), np.concatenate([nodes, head, tail])
        return cls.from_entries(rows, columns, np.arange(len(rows)), (n_nodes, n_nodes))

    def transposed(self) -> "Pattern":
        """The same blocks, seen from the columns."""
        return Pattern.from_entries(self.columns, self.rows, self.entries, (self.n_columns, self.n_rows))


class RowLayout(eqx.Module):
    """A pattern laid out for products with blocks of vectors."""

    columns: tuple[Int[Array, "_ _ _"], ...]
    """Column block of each term; the terms are added in chunks."""
    entries: tuple[Int[Array, "_ _ _"], ...]
    """Block of each term; out of bounds for none."""
    places: Int[Array, " n"] | None
    """Where each row has gone, unless all stand in their order."""

    @classmethod
    def build(cls, pattern: Pattern) -> "RowLayout":
        starts = pattern.starts
        classes, places = _length_classes(np.diff(starts))
        return cls(
            tuple(_slots(pattern.columns, starts, rows, width, 0) for rows, width in classes),
            tuple(_slots(pattern.entries, starts, rows, width, _NOTHING) for rows, width in classes),
            None if places is None else jax.device_put(places),
        )

    def fill(self, blocks: Float[Array, "m _ _"], *, transposed: bool = False) -> "RowProduct":
        """The matrix with these blocks, or with their transposes."""
        rows, columns = (4, 3) if transposed else (3, 4)
        r, c = blocks.shape[rows - 2], blocks.shape[columns - 2]

        def values(entries: Int[Array, "_ _ _"]) -> Float[Array, "_ _ _ _"]:
            found = blocks.at[entries].get(mode="fill", fill_value=0)
            return found.transpose(0, 1, columns, 2, rows).reshape(*entries.shape[:2], c, -1)

        return RowProduct(tuple(values(part) for part in self.entries), self.columns, self.places, r)


class RowProduct(eqx.Module):
    """X ↦ M X for a matrix M of r × c blocks; unknown a of node i is number r i + a of the result."""

    values: tuple[Float[Array, "_ _ _ _"], ...]
    columns: tuple[Int[Array, "_ _ _"], ...]
    places: Int[Array, " n"] | None
    r: int = eqx.field(static=True)

    def __call__(self, block: Float[Array, "mc k"]) -> Float[Array, "nr k"]:
        def chunk(values: Float[Array, "slots c rows_r"], columns: Int[Array, "slots rows"]) -> Array:
            slots, width, _ = values.shape

            def term(slot: int, c: int) -> Float[Array, "rows_r k"]:
                row = width * columns[slot] + c
                row = jnp.broadcast_to(row[:, None], (len(row), self.r)).reshape(-1)
                return values[slot, c][:, None] * block.at[row].get(mode="promise_in_bounds")

            return functools.reduce(jnp.add, (term(slot, c) for slot in range(slots) for c in range(width)))

        def add(total: Array, terms: tuple[Array, Array]) -> tuple[Array, None]:
            return total + chunk(*terms), None

        parts = []
        for values, columns in zip(self.values, self.columns, strict=True):
            empty = jnp.zeros((values.shape[3], block.shape[1]), block.dtype)
            parts.append(jax.lax.scan(add, empty, (values, columns))[0])
        product = jnp.concatenate(parts)
        if self.places is None:
            return product
        rows = product.reshape(-1, self.r * block.shape[1])
        return rows.at[self.places].get(mode="promise_in_bounds").reshape(product.shape)


class ProductLayout(eqx.Module):
    """Which pairs of blocks of L and R add up to each block of the matrix product L R."""

    left: tuple[Int[Array, "_ _ _"], ...]
    """Block of L of each term; out of bounds for none."""
    right: tuple[Int[Array, "_ _ _"], ...]
    places: Int[Array, " m"] | None

    @classmethod
    def build(cls, L: Pattern, R: Pattern, *, upper: bool = False) -> tuple["ProductLayout", Pattern]:
        """The layout, and the pattern of the product; with `upper`, of its entries with row ≤ column only."""
        parts = _in_threads(lambda rows: _product_terms(L, R, *rows, upper), _row_chunks(L, R))
        columns, counts, lengths, left, right = (np.concatenate(part) for part in zip(*parts, strict=True))
        starts = np.append(0, np.cumsum(lengths)).astype(np.int32)
        classes, places = _length_classes(lengths)
        layout = cls(
            tuple(_slots(left, starts, entries, width, _NOTHING) for entries, width in classes),
            tuple(_slots(right, starts, entries, width, 0) for entries, width in classes),
            None if places is None else jax.device_put(places),
        )
        pattern = Pattern(
            starts=np.append(0, np.cumsum(counts)).astype(np.int32),
            columns=columns,
            entries=np.arange(len(columns), dtype=np.int32),
            n_columns=R.n_columns,
        )
        return layout, pattern

    def __call__(
        self, L: Float[Array, "l _ _"], R: Float[Array, "r b c"], *, transposed: bool = False
    ) -> Float[Array, "m a c"]:
        """The blocks of L R, from those of L or from their transposes."""
        b, c = R.shape[1:]
        a = L.shape[2] if transposed else L.shape[1]
        across, down = (1, a) if transposed else (b, 1)

        # A block is a row of numbers here: XLA fetches those together.
        def term(left: Int[Array, " entries"], right: Int[Array, " entries"]) -> Float[Array, "entries ac"]:
            x = L.reshape(-1, a * b).at[left].get(mode="fill", fill_value=0)
            y = R.reshape(-1, b * c).at[right].get(mode="promise_in_bounds")
            sums = (
                sum(x[:, across * i + down * j] * y[:, c * j + k] for j in range(b))
                for i in range(a)
                for k in range(c)
            )
            return jnp.stack([*sums], axis=1)

        def add(total: Array, terms: tuple[Array, Array]) -> tuple[Array, None]:
            return functools.reduce(jnp.add, map(term, *terms), total), None

        parts = []
        for left, right in zip(self.left, self.right, strict=True):
            empty = jnp.zeros((left.shape[2], a * c), L.dtype)
            parts.append(jax.lax.scan(add, empty, (left, right))[0])
        product = jnp.concatenate(parts)
        return (product if self.places is None else product[self.places]).reshape(-1, a, c)


_NOTHING = int(np.iinfo(np.int32).max)


def _length_classes(
    lengths: Int[np.ndarray, " n"],
) -> tuple[list[tuple[np.ndarray, int]], np.ndarray | None]:
    """The sums in classes, each with the length it is padded to, and the place of every sum when the classes
    follow each other.

    At most three classes, chosen to minimise the padding; one, with places None, where more do not pay.
    """
    values, counts = np.unique(lengths, return_counts=True)
    below = np.append(0, np.cumsum(counts))
    # cost[j, i]: sums with length in values[j : i], padded to values[i − 1]
    cost = (below[None, :] - below[:, None]) * np.append(0, values)[None, :]
    cost = np.where(np.tri(len(below), k=-1, dtype=bool), np.inf, cost)
    best, cuts = cost[0], []
    total, chosen = best[-1], [len(values)]  # number of values up to the end of each class
    for _ in range(min(_MOST_CLASSES, len(values)) - 1):
        following = best[:, None] + cost
        cuts.append(following.argmin(axis=0))
        best = following.min(axis=0)
        if best[-1] <= _WORTH_A_CLASS * total:
            total, chosen = best[-1], [len(values)]
            for cut in reversed(cuts):
                chosen.append(cut[chosen[-1]])
    widths = values[np.unique(chosen) - 1]
    which = np.searchsorted(widths, lengths)
    classes = [(np.flatnonzero(which == c), int(max(width, 1))) for c, width in enumerate(widths)]
    if len(classes) == 1:
        return classes, None
    order = np.concatenate([rows for rows, _ in classes])
    places = np.empty(len(order), np.int32)
    places[order] = np.arange(len(order), dtype=np.int32)
    return classes, places


def _slots(
    terms: Int[np.ndarray, " t"],
    starts: Int[np.ndarray, " n_starts"],
    sums: Int[np.ndarray, " s"],
    width: int,
    nothing: int,
) -> Int[Array, "chunks slots s"]:
    """The terms of these sums, `nothing` where a sum has no more of them."""
    # A loop of two rounds at least is a loop for XLA, which computes what goes in and what comes out of it once. It would
    # compute a plain expression anew wherever its result is gathered: of chained products, exponentially often.
    chunks = max(2, -(-width // _UNROLLED))
    table = np.full((chunks, -(-width // chunks), len(sums)), nothing, np.int32)
    rows, step = table.reshape(-1, len(sums)), max(1, _CHUNK // width)

    def write(first: int) -> None:
        here = slice(first, first + step)
        position, end = starts[sums[here]], starts[sums[here] + 1]
        for slot in range(width):
            np.copyto(rows[slot, here], np.take(terms, position, mode="clip"), where=position < end)
            position += 1

    _in_threads(write, range(0, len(sums), step))
    return jax.device_put(table)


def _in_threads(function: Callable[[_T], _U], arguments: Sequence[_T]) -> list[_U]:
    """`map` on all cores; NumPy and SciPy let go of Python's lock in long loops."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(function, arguments))


def _row_chunks(L: Pattern, R: Pattern) -> list[tuple[int, int]]:
    """First and last row of parts of the product that fit into the cache."""
    terms = np.append(0, np.cumsum(np.diff(R.starts)[L.columns]))[L.starts]
    cuts = np.searchsorted(terms, np.arange(_CHUNK, terms[-1], _CHUNK))
    cuts = np.unique(np.concatenate([[0], cuts, [L.n_rows]]))
    return list(zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True))


def _product_terms(
    L: Pattern, R: Pattern, first: int, last: int, upper: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of these rows of L R: each entry's column, entries a row, terms an entry; and left and right of each term."""
    starts = L.starts[first : last + 1]
    here = slice(starts[0], starts[-1])
    through = L.columns[here]
    # `take` and `compress` rather than indexing: they are faster, and let go of Python's lock.
    lengths = np.take(R.starts[1:], through) - np.take(R.starts, through)
    ends = np.cumsum(lengths)
    total = int(ends[-1])
    position = np.arange(total, dtype=np.int32)
    position += np.repeat((np.take(R.starts, through) - ends + lengths).astype(np.int32), lengths)
    columns = np.take(R.columns, position)
    row_lengths = np.diff(np.append(0, ends)[starts - starts[0]])

    # Terms are sorted by row and column as one number with their own.
    term_bits, column_bits = total.bit_length(), R.n_columns.bit_length()
    keys = np.repeat(np.arange(last - first) << (term_bits + column_bits), row_lengths)
    keys |= columns.astype(np.int64) << term_bits
    keys |= np.arange(total)
    if upper:
        keys = np.compress(columns >= np.repeat(np.arange(first, last, dtype=np.int32), row_lengths), keys)
    keys.sort()
    terms = keys & ((1 << term_bits) - 1)
    keys >>= term_bits
    entry_starts = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
    places = np.take(keys, entry_starts)
    owners = np.repeat(np.arange(len(through), dtype=np.int32), lengths)
    return (
        (places & ((1 << column_bits) - 1)).astype(np.int32),
        np.bincount(places >> column_bits, minlength=last - first),
        np.diff(entry_starts, append=len(keys)),
        np.take(L.entries[here], np.take(owners, terms)),
        np.take(R.entries, np.take(position, terms)),
    )
