"""Arithmetic with many small dense blocks at once."""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, DTypeLike, Float, Int, Shaped


def times(L: Float[Array, "... a b"], R: Float[Array, "... b c"]) -> Float[Array, "... a c"]:
    """The product of each two blocks, written out: XLA makes one loop of it, but a call a block of a batched product."""
    terms = (L[..., :, b, None] * R[..., b, None, :] for b in range(L.shape[-1]))
    return functools.reduce(jnp.add, terms)


def apply_blocks(blocks: Float[Array, "n b b"], block: Float[Array, "nb k"]) -> Float[Array, "nb k"]:
    """The block diagonal matrix with these blocks, applied to each column."""
    n, b, _ = blocks.shape
    x = block.reshape(n, b, -1)
    columns = (blocks[:, :, c, None] * x[:, None, c, :] for c in range(b))
    return functools.reduce(jnp.add, columns).reshape(block.shape)


def inverse_factors(blocks: Float[Array, "n b b"]) -> Float[Array, "n b b"]:
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


def gathered(values: Shaped[Array, "n ..."], places: Int[Array, "..."]) -> Shaped[Array, "..."]:
    """`values[places]` for places within bounds. JAX would wrap and clamp each, which takes longer than a product."""
    return values.at[places].get(mode="promise_in_bounds", wrap_negative_indices=False)


def gathered_or_zero(values: Shaped[Array, "n ..."], places: Int[Array, "..."]) -> Shaped[Array, "..."]:
    """`values[places]`, and 0 for places out of bounds, none of them negative."""
    return values.at[places].get(mode="fill", fill_value=0, wrap_negative_indices=False)


def sum_of_chunks(
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
