"""Interpolation from a coarser graph for values in local frames, and the coarse operator that it makes.

A vector field has no components of its own, only components in the frame of each node, so values are carried from node to
node before they are added up: those of a fine node are Σ_j w_j R_j x_j over coarse nodes j, where the weights w say how near
they are and the rotations R carry components from the frame of j. Each edge of the graph has such a rotation; their product
along a path joins nodes further apart.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..sparse import Graph, ProductLayout, RowLayout, Sparsity, SymmetricBlockOperator, gathered, times


class Interpolation(eqx.Module):
    """How a graph of n nodes and m edges is interpolated from a coarser one.

    Edges are seen from either end: *view* e from the tail of edge e, m + e from its head; 2m stands for no step at all.
    Each node is owned by a coarse node. A coarse edge joins the owners of the ends of some fine edge, its bridge.
    """

    weights: Float[Array, "slots n"]
    """Of the coarse nodes each node is interpolated from, summing to 1; 0 in empty slots."""
    columns: Int[Array, "slots n"]
    """These coarse nodes."""
    slot_views: Int[Array, "slots n"]
    """View of the coarse edge from each node's owner to the coarse node in the slot."""
    parents: Int[Array, " n"]
    """Next node on the path to each node's owner; itself at the path's end."""
    parent_views: Int[Array, " n"]
    """View of the edge to the parent."""
    bridges: Int[Array, " coarse_m"]
    """View of the bridge of each coarse edge, from the side that the coarse edge's tail owns."""
    bridge_ends: Int[Array, "coarse_m 2"]
    """The ends of the bridge, that side first."""
    n_edges: int = eqx.field(static=True)
    """m."""
    n_coarse: int = eqx.field(static=True)
    hops: int = eqx.field(static=True)
    """Edges on the longest path to an owner."""

    def prolongation(
        self, turns: Float[Array, "m b b"], scale: Float[Array, "n b b"]
    ) -> tuple[Float[Array, "p b b"], Float[Array, "coarse_m b b"]]:
        """The p = slots × n blocks scale_i w_ij R_ij, slot by slot, and the rotations from head to tail of each coarse edge.

        Args:
            turns: rotations from head to tail of each edge.
            scale: what each node's values are multiplied by.
        """
        seen = _by_view(turns)
        step = gathered(seen, self.parent_views)
        from_owner = step
        for _ in range(self.hops - 1):
            from_owner = times(step, gathered(from_owner, self.parents))
        a, b = self.bridge_ends.T
        coarse = times(
            gathered(from_owner, a).mT, times(gathered(seen, self.bridges), gathered(from_owner, b))
        )
        by_owner, views = times(scale, from_owner), _by_view(coarse)

        def in_slot(slot: tuple[Float[Array, " n"], Int[Array, " n"]]) -> Float[Array, "n b b"]:
            weights, slot_views = slot
            return weights.astype(scale.dtype)[:, None, None] * times(by_owner, gathered(views, slot_views))

        # A loop for XLA, which would compute a plain expression anew for each of the many that gather the blocks.
        blocks = jax.lax.map(in_slot, (self.weights, self.slot_views))
        return blocks.reshape(-1, *scale.shape[1:]), coarse

    def shares(self) -> Float[Array, " p"]:
        """How a quantity at each node is shared out to the coarse nodes: in proportion to |weights|, and all of it."""
        sizes = jnp.abs(self.weights)
        return (sizes / sizes.sum(axis=0, keepdims=True)).ravel()


def _by_view(turns: Float[Array, "m b b"]) -> Float[Array, "views b b"]:
    stay = jnp.eye(turns.shape[1], dtype=turns.dtype)
    return jnp.concatenate([turns, turns.mT, stay[None]])


class Coarsening(eqx.Module):
    """An interpolation, with the layouts of the products that a multigrid cycle forms with an operator K on
    the fine graph."""

    interpolation: Interpolation
    operator: RowLayout
    """K."""
    prolongation: RowLayout
    """P, the interpolation."""
    restriction: RowLayout
    """Pᵀ."""
    half: ProductLayout
    """K P."""
    galerkin: ProductLayout
    """The upper half of Pᵀ (K P)."""
    diagonal_first: Int[Array, " coarse_blocks"]
    """The order of its blocks that puts those on the diagonal first."""
    coarse_edges: Int[Array, "coarse_e 2"]
    """Graph of the coarse operator, which reaches further than the edges of the interpolation's coarse graph."""
    joined: Int[Array, " j"]
    """Coarse nodes that have edges."""
    alone: Int[Array, " a"]
    """Those that have none: components of one node."""

    @classmethod
    def build(cls, interpolation: Interpolation, edges: Int[np.ndarray, "e 2"]) -> "Coarsening":
        """The layouts for operators on the graph `edges`; on the host."""
        weights, columns = np.asarray(interpolation.weights), np.asarray(interpolation.columns)
        full, n = np.flatnonzero(weights), weights.shape[1]
        K = Sparsity.of_graph(edges, n)
        P = Sparsity.from_entries(full % n, columns.ravel()[full], full, (n, interpolation.n_coarse))
        R = P.transposed()
        half, K_P = ProductLayout.build(K, P)
        galerkin, coarse = ProductLayout.build(R, K_P, upper=True)
        places = np.stack([coarse.rows, coarse.columns], axis=1)
        on_diagonal = places[:, 0] == places[:, 1]
        coarse_edges = places[~on_diagonal].astype(np.int32)
        has_edges = np.zeros(interpolation.n_coarse, bool)
        has_edges[coarse_edges] = True
        return cls(
            interpolation=interpolation,
            operator=RowLayout.build(K),
            prolongation=RowLayout.build(P),
            restriction=RowLayout.build(R),
            half=half,
            galerkin=galerkin,
            diagonal_first=jax.device_put(np.argsort(~on_diagonal, kind="stable").astype(np.int32)),
            coarse_edges=jax.device_put(coarse_edges),
            joined=jax.device_put(np.flatnonzero(has_edges).astype(np.int32)),
            alone=jax.device_put(np.flatnonzero(~has_edges).astype(np.int32)),
        )

    def coarse_operator(
        self, blocks: Float[Array, "e b b"], P: Float[Array, "p b b"]
    ) -> SymmetricBlockOperator:
        """PᵀKP, by the blocks of K (diagonal, upper, transposed upper) and of P (as `prolongation` gives them)."""
        product = gathered(self.galerkin(P, self.half(blocks, P), transposed=True), self.diagonal_first)
        n = self.interpolation.n_coarse
        return SymmetricBlockOperator(product[:n], product[n:], Graph.of_edges(self.coarse_edges, n))
