"""Graphs, as the pattern of symmetric matrices."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Int


class Graph(eqx.Module):
    """The edges of a graph, and by node those that meet there. Loops and repeated edges are allowed."""

    edges: Int[Array, "m 2"]
    """Tail and head."""
    starts: Int[Array, " starts"]
    """The views of node i are `views[starts[i] : starts[i + 1]]`; n + 1 numbers."""
    views: Int[Array, " views"]
    """Edge e seen from its tail is e, seen from its head m + e."""

    @classmethod
    def of_edges(cls, edges: Int[Array, "m 2"], n_nodes: int) -> "Graph":
        """By a sort; runs under `jit`."""
        starts, views = by_row(edges.T.reshape(-1), n_nodes)
        return cls(edges, starts, views)

    @property
    def n_nodes(self) -> int:
        return len(self.starts) - 1


def by_row(rows: Int[Array, " terms"], n: int) -> tuple[Int[Array, " starts"], Int[Array, " terms"]]:
    """Where each row's terms start, and the terms by row."""
    counts = jnp.zeros(n + 1, rows.dtype).at[rows + 1].add(1)
    return jnp.cumsum(counts, dtype=rows.dtype), jnp.argsort(rows).astype(rows.dtype)
