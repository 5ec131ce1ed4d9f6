"""The coarsest problem of a hierarchy, solved directly: one dense factorization, and one for each node that stands alone."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..sparse import Graph, SymmetricBlockOperator, gathered


class Direct(eqx.Module):
    """K on the coarsest level by eigenpairs K x = w D x, with the masses D: a solve and an eigenproblem at once.

    Components that are down to one node each, the specks of a mesh say, can be thousands: their blocks stand for themselves.
    """

    values: Float[Array, " nb"]
    vectors: Float[Array, "nb nb"]
    """Scaled to xᵀDx = 1."""
    joined: Int[Array, " n"]
    """The nodes they are about."""
    alone_values: Float[Array, "a b"]
    alone_vectors: Float[Array, "a b b"]
    """Columns."""
    alone: Int[Array, " a"]

    @classmethod
    def factorize(
        cls,
        K: SymmetricBlockOperator,
        masses: Float[Array, " nodes"],
        joined: Int[Array, " n"],
        alone: Int[Array, " a"],
    ) -> "Direct":
        """All nodes are in `joined` or have no edges and are in `alone`."""
        places = jnp.zeros(len(masses), joined.dtype)
        places = places.at[joined].set(jnp.arange(len(joined), dtype=joined.dtype))
        edges = gathered(places, K.edges)
        dense = SymmetricBlockOperator(
            K.diagonal[joined], K.upper, Graph.of_edges(edges, len(joined))
        ).as_matrix()
        size = jnp.abs(K.diagonal).max()
        half = jnp.repeat(jax.lax.rsqrt(masses[joined]), K.block_size)
        values, vectors = _eigenpairs(dense, half, size)
        half = jnp.broadcast_to(jax.lax.rsqrt(masses[alone])[:, None], (len(alone), K.block_size))
        alone_values, alone_vectors = jax.vmap(_eigenpairs, (0, 0, None))(K.diagonal[alone], half, size)
        return cls(values, vectors, joined, alone_values, alone_vectors, alone)

    def solve(self, block: Float[Array, "m k"]) -> Float[Array, "m k"]:
        b, k = self.alone_values.shape[1], block.shape[1]
        x = block.reshape(-1, b, k)
        inside = gathered(x, self.joined).reshape(-1, k)
        inside = self.vectors @ ((self.vectors.T @ inside) / self.values[:, None])
        if len(self.alone) == 0:
            return inside
        outside = gathered(x, self.alone)
        outside = self.alone_vectors @ ((self.alone_vectors.mT @ outside) / self.alone_values[..., None])
        y = jnp.zeros_like(x).at[self.joined].set(inside.reshape(-1, b, k)).at[self.alone].set(outside)
        return y.reshape(block.shape)

    def lowest(self, count: int) -> tuple[Float[Array, " c"], Float[Array, "m c"]]:
        """The smallest w and their x, no more than there are."""
        if len(self.alone) == 0:
            return self.values[:count], self.vectors[:, :count]
        b, n_nodes = self.alone_values.shape[1], len(self.joined) + len(self.alone)
        vectors = self.vectors[:, :count]
        values = jnp.concatenate([self.values[:count], self.alone_values.ravel()])
        lowest = jnp.argsort(values)[:count]
        inside = vectors.at[:, lowest].get(mode="fill", fill_value=0)
        node, number = jnp.divmod(jnp.maximum(lowest - vectors.shape[1], 0), b)
        outside = self.alone_vectors[node, :, number].T * (lowest >= vectors.shape[1]).astype(values.dtype)
        x = jnp.zeros((n_nodes, b, len(lowest)), values.dtype)
        x = x.at[self.joined].set(inside.reshape(-1, b, len(lowest)))
        x = x.at[self.alone[node], :, jnp.arange(len(lowest))].add(outside.T)
        return values[lowest], x.reshape(n_nodes * b, -1)


def _eigenpairs(
    K: Float[Array, "n n"], half: Float[Array, " n"], size: Float[Array, ""]
) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Of K x = w D x with D = diag(half)⁻²: K is positive semi-definite and of this size."""
    values, V = jnp.linalg.eigh(half[:, None] * K * half[None, :])
    vectors = half[:, None] * V
    # A preconditioner must be positive definite in spite of rounding, which is the larger the smaller a component's masses.
    least = jnp.finfo(values.dtype).eps * size * (vectors**2).sum(axis=0)
    return jnp.maximum(values, least), vectors
