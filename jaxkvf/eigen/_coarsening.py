"""Interpolation between a graph and a coarser one, for values in local frames; and the coarse operator it makes.

A vector field has no components of its own, only components in the frame of each node, so values are carried from node to
node before they are added: a fine node's are Σ_j w_j R_j x_j over coarse nodes j, where the weights w say how near they are and
the rotations R carry components from the frame of j. A rotation goes with each edge of the graph; a product of them along a
path joins nodes further apart.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..sparse import SymmetricBlockOperator
from ._layouts import Pattern, ProductLayout, RowLayout


class Coarsening(eqx.Module):
    """How a graph of n nodes and m edges is interpolated from a coarser one: what depends on structure, and on it alone.

    Edges are seen from either end: *view* e from the tail of edge e, m + e from its head; 2m stands for no step at all.
    Each node is owned by a coarse node. A coarse edge joins the owners of the ends of some fine edge, its bridge.
    """

    weights: Float[Array, "n slots"]
    """Of the coarse nodes each node is interpolated from, summing to 1; 0 in empty slots."""
    columns: Int[Array, "n slots"]
    """These coarse nodes."""
    slot_views: Int[Array, "n slots"]
    """View of the coarse edge from each node's owner to the coarse node in the slot."""
    parents: Int[Array, " n"]
    """Next node on the path to each node's owner; itself where it is the owner."""
    parent_views: Int[Array, " n"]
    """View of the edge to the parent."""
    hops: int = eqx.field(static=True)
    """Most edges on such a path."""
    bridges: Int[Array, " coarse_m"]
    """View of the bridge of each coarse edge, from its tail's side."""
    bridge_ends: Int[Array, "coarse_m 2"]
    """The ends of the bridge, the one the coarse edge's tail owns first."""
    n_coarse: int = eqx.field(static=True)

    operator: RowLayout
    """K, an operator on the graph."""
    prolongation: RowLayout
    restriction: RowLayout
    half: ProductLayout
    """K P."""
    galerkin: ProductLayout
    """The upper half of Pᵀ (K P)."""
    diagonal_first: Int[Array, " coarse_blocks"]
    """The order of its blocks that puts those on the diagonal first."""
    operator_edges: Int[Array, "coarse_e 2"]
    """Graph of the coarse operator. It reaches further than the coarse edges do."""

    @classmethod
    def build(
        cls,
        operator_edges: Int[np.ndarray, "e 2"],
        *,
        weights: Float[np.ndarray, "n slots"],
        columns: Int[np.ndarray, "n slots"],
        n_coarse: int,
        hops: int,
        **paths: Int[np.ndarray, "..."],
    ) -> "Coarsening":
        """From the graph of the fine operator and the fields that describe the interpolation; on the host."""
        n, slots = weights.shape
        full = weights != 0
        rows = np.repeat(np.arange(n, dtype=np.int32), full.sum(axis=1))
        K = Pattern.of_graph(operator_edges, n)
        P = Pattern.from_entries(rows, columns[full], np.flatnonzero(full), (n, n_coarse))
        R = P.transposed()
        half, K_P = ProductLayout.build(K, P)
        galerkin, coarse = ProductLayout.build(R, K_P, upper=True)
        places = np.stack([coarse.rows, coarse.columns], axis=1)
        on_diagonal = places[:, 0] == places[:, 1]
        return cls(
            weights=jnp.asarray(weights),
            columns=jnp.asarray(columns, jnp.int32),
            n_coarse=n_coarse,
            hops=hops,
            **{name: jnp.asarray(part, jnp.int32) for name, part in paths.items()},
            operator=RowLayout.build(K),
            prolongation=RowLayout.build(P),
            restriction=RowLayout.build(R),
            half=half,
            galerkin=galerkin,
            diagonal_first=jnp.asarray(np.argsort(~on_diagonal, kind="stable"), jnp.int32),
            operator_edges=jnp.asarray(places[~on_diagonal], jnp.int32),
        )

    def rotations(
        self, turns: Float[Array, "m b b"]
    ) -> tuple[Float[Array, "n slots b b"], Float[Array, "coarse_m b b"]]:
        """Those from the coarse node in each slot to the node, and from head to tail of the coarse edges.

        Args:
            turns: those from head to tail of the edges.
        """
        seen = _by_view(turns)
        step = seen[self.parent_views]
        from_owner = step
        for _ in range(self.hops - 1):
            from_owner = _times(step, from_owner[self.parents])
        a, b = self.bridge_ends.T
        coarse = _times(from_owner.mT[a], _times(seen[self.bridges], from_owner[b]))
        return _times(from_owner[:, None], _by_view(coarse)[self.slot_views]), coarse

    def coarse_operator(
        self, blocks: Float[Array, "e b b"], P: Float[Array, "n slots b b"]
    ) -> SymmetricBlockOperator:
        """PᵀKP for the operator K of these blocks (diagonal, upper, transposed upper)."""
        flat = P.reshape(-1, *P.shape[2:])
        product = self.galerkin(flat.mT, self.half(blocks, flat))[self.diagonal_first]
        return SymmetricBlockOperator(
            diagonal=product[: self.n_coarse], upper=product[self.n_coarse :], edges=self.operator_edges
        )

    def coarse_masses(self, masses: Float[Array, " n"]) -> Float[Array, " n_coarse"]:
        """The masses of the nodes, shared out by the weights. Their sum stays the same."""
        share = jnp.abs(self.weights).astype(masses.dtype)
        share = share / share.sum(axis=1, keepdims=True)
        return self.restriction.fill(share.reshape(-1, 1, 1))(masses[:, None])[:, 0]


def _by_view(turns: Float[Array, "m b b"]) -> Float[Array, "views b b"]:
    b = turns.shape[1]
    return jnp.concatenate([turns, turns.mT, jnp.eye(b, dtype=turns.dtype)[None]])


def _times(L: Float[Array, "*n a b"], R: Float[Array, "*#n b c"]) -> Float[Array, "*#n a c"]:
    """L R, written out: XLA makes one loop of it where a batched matrix product would be a call a block."""
    L, R = jnp.broadcast_arrays(L, R) if L.ndim > 3 else (L, R)
    return sum((L[..., :, b, None] * R[..., b, None, :] for b in range(1, L.shape[-1])), L[..., :, :1] * R[..., :1, :])
