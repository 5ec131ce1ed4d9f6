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

from ..sparse import SymmetricBlockOperator, assembled, matmat

BlockProduct = Callable[[Float[Array, "n k"]], Float[Array, "n k"]]

_CHUNK = 1024  # overflowing blocks multiplied at once


class EllProduct(eqx.Module):
    """X ↦ M X for a symmetric matrix of b × b blocks in ELLPACK layout."""

    entries: Float[Array, "width b nb"]
    """Entry [s, c, b i + a] is that of row a in row block i and column c of the block in its slot s; 0 in empty slots."""
    neighbours: Int[Array, "width n"]
    """Column block of each slot; the first slot is the diagonal."""
    overflow_blocks: Float[Array, "rest b b"]
    """Blocks that found no slot, in front; zeros behind."""
    overflow_places: Int[Array, "rest 2"]
    """Row block and column block of each."""
    n_overflow: Int[Array, ""]

    def __call__(self, block: Float[Array, "nb k"]) -> Float[Array, "nb k"]:
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
    """X ↦ M X for blocks X `[n, k]` of any k, prepared for many products; M symmetric. Runs under `jit`."""
    matrix = assembled(operator)
    return eqx.Partial(matmat, operator) if matrix is operator else block_product(matrix)


@block_product.register
def _(operator: lx.TaggedLinearOperator) -> BlockProduct:
    return block_product(operator.operator)


@block_product.register
def _(operator: SymmetricBlockOperator) -> BlockProduct:
    n, b, _ = operator.diagonal.shape
    m = operator.upper.shape[0]
    # Each edge is seen from its tail and from its head; the view numbered 2m is the empty one.
    rows = operator.edges.T.reshape(-1)
    columns = jnp.append(operator.edges[:, ::-1].T.reshape(-1), 0)
    blocks = jnp.concatenate([operator.upper, operator.upper.mT, jnp.zeros((1, b, b), operator.upper.dtype)])

    views = jnp.argsort(rows).astype(rows.dtype) if operator.row_order is None else operator.row_order
    degrees = jnp.zeros(n, views.dtype).at[rows].add(1)
    ends = jnp.cumsum(degrees)
    starts = ends - degrees

    # A fifth above the mean degree 2m/n: a block that finds no slot costs as much as seven slots.
    width = 12 * m // (5 * n)
    position = starts[None] + jnp.arange(width, dtype=starts.dtype)[:, None]
    view = jnp.append(views, 2 * m)[jnp.where(position < ends[None], position, 2 * m)]

    slot = jnp.arange(2 * m, dtype=starts.dtype) - starts[rows[views]]
    left_over = slot >= width
    place = jnp.where(left_over, jnp.cumsum(left_over) - 1, 2 * m)
    capacity = max(1, -(-2 * m // _CHUNK)) * _CHUNK
    rest = jnp.full(capacity, 2 * m, views.dtype).at[place].set(views, mode="drop")

    entries = jnp.concatenate([operator.diagonal[None], blocks[view]])
    return EllProduct(
        entries=entries.transpose(0, 3, 1, 2).reshape(width + 1, b, n * b),
        neighbours=jnp.concatenate([jnp.arange(n, dtype=columns.dtype)[None], columns[view]]),
        overflow_blocks=blocks[rest],
        overflow_places=jnp.stack([jnp.append(rows, 0)[rest], columns[rest]], axis=1),
        n_overflow=left_over.sum(dtype=jnp.int32),
    )
