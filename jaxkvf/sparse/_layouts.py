"""Sparsity laid out on the host, numbers filled in under jit: block matrices times blocks of vectors, and times each other.

Both kinds of product are sums of a varying number of terms, one sum a row (or an entry). Sums of similar length stand
together, padded to the same length, so that all of them advance by one term at once: gathers and no scatter.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, DTypeLike, Float, Int, Shaped

from ..compiled import compiled, in_threads
from ._blocks import gathered, gathered_or_zero
from ._sparsity import Sparsity

_MOST_CLASSES = 2  # lengths that sums are padded to
_WORTH_A_CLASS = 0.9  # padding must fall to this for one more: each costs compilation, and the sums' order
_CHUNK = 1 << 19  # terms that one thread writes at a time
_ALIGNED = 16  # numbers: JAX takes over arrays that begin at a multiple of 64 bytes
_UNROLLED = 8  # terms added at once: fewer cost memory traffic, more cost compilation


class RowLayout(eqx.Module):
    """A pattern laid out for products with blocks of vectors."""

    columns: tuple[Int[Array, "_ _ _"], ...]
    """Column block of each term; the terms are added in chunks."""
    entries: tuple[Int[Array, "_ _ _"], ...]
    """Block of each term; out of bounds for none."""
    places: Int[Array, " n"] | None
    """Where each row has gone, unless all stand in their order."""

    @classmethod
    def build(cls, sparsity: Sparsity) -> "RowLayout":
        table = _Table.of(np.diff(sparsity.starts))
        columns, entries = table.empty(), table.empty()
        in_threads(
            lambda rows: _write_rows(rows, sparsity, table.slots, columns, entries), _parts(sparsity.starts)
        )
        return cls(table.parts(columns), table.parts(entries), table.order)

    def fill(self, blocks: Float[Array, "m _ _"], *, transposed: bool = False) -> "RowProduct":
        """The matrix with these blocks, or with their transposes."""
        values = tuple(gathered_or_zero(blocks, entries) for entries in self.entries)
        return RowProduct(values, self.columns, self.places, transposed)


class RowProduct(eqx.Module):
    """X ↦ M X for a matrix M of r × c blocks; unknown a of node i is number r i + a of the result."""

    values: tuple[Float[Array, "_ _ _ _ _"], ...]
    """The block of each term, or its transpose."""
    columns: tuple[Int[Array, "_ _ _"], ...]
    places: Int[Array, " n"] | None
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
            _sum_of_chunks(chunk, (values.shape[2] * r, block.shape[1]), block.dtype, values, columns)
            for values, columns in zip(self.values, self.columns, strict=True)
        ]
        product = jnp.concatenate(sums)
        if self.places is None:
            return product
        rows = product.reshape(-1, r * block.shape[1])
        return gathered(rows, self.places).reshape(product.shape)


def _sum_of_chunks(
    chunk: Callable[..., Array], shape: tuple[int, ...], dtype: DTypeLike, *terms: Shaped[Array, "chunks ..."]
) -> Array:
    """Σ chunk(*terms[i]), which XLA computes once: a loop, or a branch where there is but one chunk.

    It would compute a plain expression anew wherever its result is gathered: of chained products, exponentially often.
    """
    empty = jnp.zeros(shape, dtype)
    if len(terms[0]) > 1:
        return jax.lax.scan(lambda total, terms: (total + chunk(*terms), None), empty, terms)[0]
    some = terms[-1].ravel()[0] >= 0  # always, but XLA does not know
    return jax.lax.cond(some, lambda: chunk(*(part[0] for part in terms)), lambda: empty)


class ProductLayout(eqx.Module):
    """Which pairs of blocks of L and R add up to each block of the matrix product L R."""

    left: tuple[Int[Array, "_ _ _"], ...]
    """Block of L of each term; out of bounds for none."""
    right: tuple[Int[Array, "_ _ _"], ...]
    places: Int[Array, " m"] | None

    @classmethod
    def build(cls, L: Sparsity, R: Sparsity, *, upper: bool = False) -> tuple["ProductLayout", Sparsity]:
        """The layout, and the sparsity of the product; with `upper`, of its entries with row ≤ column only."""
        chunks = _parts(np.append(0, np.cumsum(np.diff(R.starts)[L.columns]))[L.starts])
        found = in_threads(lambda rows: _product_entries(rows, L, R, upper), chunks)
        columns, lengths, counts = (np.concatenate(part) for part in zip(*found, strict=True))
        starts = np.append(0, np.cumsum(counts)).astype(np.int32)
        product = Sparsity(starts, columns, np.arange(len(columns), dtype=np.int32), R.n_columns)
        table = _Table.of(lengths)
        left, right = table.empty(), table.empty()
        in_threads(lambda rows: _write_products(rows, (L, R), product, table.slots, (left, right)), chunks)
        return cls(table.parts(left), table.parts(right), table.order), product

    def __call__(
        self, L: Float[Array, "l _ _"], R: Float[Array, "r b c"], *, transposed: bool = False
    ) -> Float[Array, "m a c"]:
        """The blocks of L R, from those of L or from their transposes."""
        b, c = R.shape[1:]
        a = L.shape[2] if transposed else L.shape[1]
        across, down = (1, a) if transposed else (b, 1)

        # A block is a row of numbers here: XLA fetches those together.
        def term(left: Int[Array, " entries"], right: Int[Array, " entries"]) -> Float[Array, "entries ac"]:
            x = gathered_or_zero(L.reshape(-1, a * b), left)
            y = gathered(R.reshape(-1, b * c), right)
            sums = (
                sum(x[:, across * i + down * j] * y[:, c * j + k] for j in range(b))
                for i in range(a)
                for k in range(c)
            )
            return jnp.stack([*sums], axis=1)

        def chunk(left: Int[Array, "slots entries"], right: Int[Array, "slots entries"]) -> Array:
            return functools.reduce(jnp.add, map(term, left, right))

        sums = [
            _sum_of_chunks(chunk, (left.shape[2], a * c), L.dtype, left, right)
            for left, right in zip(self.left, self.right, strict=True)
        ]
        product = jnp.concatenate(sums)
        return (product if self.places is None else gathered(product, self.places)).reshape(-1, a, c)


_NOTHING = int(np.iinfo(np.int32).max)


class _Slots(NamedTuple):
    """Where the terms of sums stand in one long array: slot by slot in each class of sums of similar length."""

    places: Int[np.ndarray, " sums"]
    """Of each sum when the classes follow each other."""
    firsts: Int[np.ndarray, " starts"]
    """First place of each class, and one past the last."""
    widths: Int[np.ndarray, " classes"]
    """Slots of each sum."""
    offsets: Int[np.ndarray, " starts"]
    """Where the slots of each class begin, and the length of the array."""


class _Table(NamedTuple):
    """Slots, and how they are cut up for XLA."""

    slots: _Slots
    chunks: list[int]
    """That the slots of each class are added up in."""

    @classmethod
    def of(cls, lengths: Int[np.ndarray, " sums"]) -> "_Table":
        class_of, longest = _length_classes(lengths)
        places, firsts = _places(lengths.astype(np.int32), class_of, len(longest))
        chunks = [-(-length // _UNROLLED) for length in longest]
        widths = np.array([-(-length // n) * n for length, n in zip(longest, chunks, strict=True)])
        sizes = -(-np.diff(firsts) * widths // _ALIGNED) * _ALIGNED
        return cls(_Slots(places, firsts, widths, np.append(0, np.cumsum(sizes))), chunks)

    @property
    def order(self) -> Int[Array, " sums"] | None:
        """The places, unless there is but one class."""
        return None if len(self.chunks) == 1 else jax.device_put(self.slots.places)

    def empty(self) -> Int[np.ndarray, " slots"]:
        return _aligned(int(self.slots.offsets[-1]))

    def parts(self, values: Int[np.ndarray, " slots"]) -> tuple[Int[Array, "_ _ _"], ...]:
        """The array of each class, [chunk, slot, sum]."""
        _, firsts, widths, offsets = self.slots
        sizes = np.diff(firsts)
        ends = offsets[:-1] + widths * sizes
        return tuple(
            jax.device_put(values[start:end].reshape(n, -1, size))
            for start, end, size, n in zip(offsets, ends, sizes, self.chunks, strict=False)
        )


def _aligned(size: int) -> Int[np.ndarray, " size"]:
    """An array that JAX can use on a CPU as it is, without a copy."""
    room = np.empty(size + _ALIGNED, np.int32)
    first = -(room.ctypes.data // room.itemsize) % _ALIGNED
    return room[first : first + size]


def _length_classes(lengths: Int[np.ndarray, " n"]) -> tuple[Int[np.ndarray, " lengths"], list[int]]:
    """Class of each length from 0 on, and the longest of each class.

    At most two classes, chosen to minimise the padding, and fewer where more do not pay.
    """
    all_counts = np.bincount(lengths)
    values = np.flatnonzero(all_counts)
    below = np.append(0, np.cumsum(all_counts[values]))
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
    longest = values[np.unique(chosen) - 1]
    class_of = np.searchsorted(longest, np.arange(len(all_counts))).astype(np.int32)
    return class_of, np.maximum(longest, 1).tolist()


def _parts(work: Int[np.ndarray, " starts"]) -> list[tuple[int, int]]:
    """First and last row of parts of about the same size, by the work up to each row."""
    cuts = np.searchsorted(work, np.arange(_CHUNK, work[-1], _CHUNK))
    cuts = np.unique(np.concatenate([[0], cuts, [len(work) - 1]]))
    return list(zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True))


@compiled
def _places(lengths: np.ndarray, class_of: np.ndarray, n_classes: int) -> tuple[np.ndarray, np.ndarray]:
    """Place of each sum when the classes follow each other, and the first of each class."""
    firsts = np.zeros(n_classes + 1, np.int64)
    for length in lengths:
        firsts[class_of[length] + 1] += 1
    firsts = np.cumsum(firsts)
    following = firsts.astype(np.int32)
    places = np.empty_like(lengths)
    for i in range(len(lengths)):
        places[i] = following[class_of[lengths[i]]]
        following[class_of[lengths[i]]] += 1
    return places, firsts


@compiled
def _write_rows(
    rows: tuple[int, int],
    sparsity: Sparsity,
    slots: _Slots,
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
            columns[slot], entries[slot] = 0, _NOTHING
            slot += size


@compiled
def _product_entries(
    rows: tuple[int, int], L: Sparsity, R: Sparsity, upper: bool
) -> tuple[Int[np.ndarray, " e"], Int[np.ndarray, " e"], Int[np.ndarray, " r"]]:
    """Of rows of L R: the column of each entry, ascending, and the number of its terms; entries in each row."""
    first, last = rows
    most = 0
    for i in range(L.starts[first], L.starts[last]):
        most += R.starts[L.columns[i] + 1] - R.starts[L.columns[i]]
    columns, lengths = np.empty(most, np.int32), np.empty(most, np.int32)
    counts = np.empty(last - first, np.int32)
    terms = np.zeros(R.n_columns, np.int32)  # to each column of the row at hand
    end = 0
    for row in range(first, last):
        start = end
        for i in range(L.starts[row], L.starts[row + 1]):
            for j in range(R.starts[L.columns[i]], R.starts[L.columns[i] + 1]):
                column = R.columns[j]
                if upper and column < row:
                    continue
                if terms[column] == 0:
                    place = end
                    while place > start and columns[place - 1] > column:
                        columns[place] = columns[place - 1]
                        place -= 1
                    columns[place] = column
                    end += 1
                terms[column] += 1
        for entry in range(start, end):
            lengths[entry] = terms[columns[entry]]
            terms[columns[entry]] = 0
        counts[row - first] = end - start
    return columns[:end].copy(), lengths[:end].copy(), counts


@compiled
def _write_products(
    rows: tuple[int, int],
    factors: tuple[Sparsity, Sparsity],
    product: Sparsity,
    slots: _Slots,
    terms: tuple[Int[np.ndarray, " slots"], Int[np.ndarray, " slots"]],
) -> None:
    """Left and right blocks of the terms of the entries in these rows of a product into their slots."""
    (L, R), (left, right) = factors, terms
    following = np.full(R.n_columns, -1, np.int64)  # slot of each column of the row at hand
    sizes, ends = np.empty(R.n_columns, np.int64), np.empty(R.n_columns, np.int64)
    for row in range(rows[0], rows[1]):
        entries = range(product.starts[row], product.starts[row + 1])
        for entry in entries:
            column, place = product.columns[entry], slots.places[entry]
            k = np.searchsorted(slots.firsts, place, side="right") - 1
            sizes[column] = slots.firsts[k + 1] - slots.firsts[k]
            following[column] = slots.offsets[k] + place - slots.firsts[k]
            ends[column] = following[column] + slots.widths[k] * sizes[column]
        for i in range(L.starts[row], L.starts[row + 1]):
            for j in range(R.starts[L.columns[i]], R.starts[L.columns[i] + 1]):
                column = R.columns[j]
                slot = following[column]
                if slot >= 0:  # an entry of the product, not one below its diagonal
                    left[slot], right[slot] = L.entries[i], R.entries[j]
                    following[column] = slot + sizes[column]
        for entry in entries:
            column = product.columns[entry]
            for slot in range(following[column], ends[column], sizes[column]):
                left[slot], right[slot] = _NOTHING, 0
            following[column] = -1
