"""Block matrices times each other: laid out on the host, numbers filled in under `jit`."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..compiled import compiled, in_threads
from ._blocks import gathered, gathered_or_zero, sum_of_chunks
from ._slots import NOTHING, Slots, Table, row_parts
from ._sparsity import Sparsity


class ProductLayout(eqx.Module):
    """Which pairs of blocks of L and R add up to each block of the matrix product L R."""

    left: tuple[Int[Array, "_ _ _"], ...]
    """Block of L of each term; out of bounds for none."""
    right: tuple[Int[Array, "_ _ _"], ...]
    places: Int[Array, " m"] | None

    @classmethod
    def build(cls, L: Sparsity, R: Sparsity, *, upper: bool = False) -> tuple["ProductLayout", Sparsity]:
        """The layout, and the sparsity of the product; with `upper`, of its entries with row ≤ column only."""
        chunks = row_parts(np.append(0, np.cumsum(np.diff(R.starts)[L.columns]))[L.starts])
        found = in_threads(lambda rows: _product_entries(rows, L, R, upper), chunks)
        columns, lengths, counts = (np.concatenate(part) for part in zip(*found, strict=True))
        starts = np.append(0, np.cumsum(counts)).astype(np.int32)
        product = Sparsity(starts, columns, np.arange(len(columns), dtype=np.int32), R.n_columns)
        table = Table.of(lengths)
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
            sum_of_chunks(chunk, (left.shape[2], a * c), L.dtype, left, right)
            for left, right in zip(self.left, self.right, strict=True)
        ]
        product = jnp.concatenate(sums)
        return (product if self.places is None else gathered(product, self.places)).reshape(-1, a, c)


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
    slots: Slots,
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
                left[slot], right[slot] = NOTHING, 0
            following[column] = -1
