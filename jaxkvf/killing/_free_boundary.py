"""What eq. (12) of the paper adds to the energy of a 1-form on a surface with boundary.

Along the boundary, the surface on its left, T and N are its tangent and inner normal, a = ⟨u, T⟩, b = ⟨u, N⟩, u = ω^♯:

    4 ∮ ⟨∇_T ω, ω^⊥⟩ = 4 ∮ (b ∂a − a ∂b − k_g |ω|²)

With u linear along each boundary edge ij, in its frame, the integral is Σ (a_j b_i − a_i b_j). By parts, and with the form's
own value ω_ij/ℓ for the mean of a_i and a_j,

    Σ (a_j b_i − a_i b_j) = −Σ 2 ω_ij/ℓ_ij (b_j − b_i) + Σ (a_j b_j − a_i b_i).

Its geodesic curvature sits in the turn of the edges' frames at each vertex. Written so, translations and rotations of any
planar mesh are in the kernel of the whole operator: the first sum cancels their curl, edge by edge.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float

from ..exterior import end_components
from ..geometry import edge_directions, geodesic_curvatures
from ..mesh import Topology
from ..sparse import RowSparseOperator


class FreeBoundary(NamedTuple):
    """What a free boundary adds; everything is 0 away from it."""

    half_lengths_inward: Float[Array, "V 2"]
    """Σ ½ ℓ N over the boundary edges of each vertex: with u it completes d₀ᵀ⋆₁ω to the divergence there."""
    turns: Float[Array, "V 2 2"]
    """uᵀ(·)u = a b along the edge that arrives minus a b along the one that leaves."""
    rises: lx.AbstractLinearOperator
    """ωᵀ(·)ω = Σ 2 ω_ij/ℓ_ij (b_j − b_i)."""


def free_boundary(
    vectors: lx.AbstractLinearOperator, lengths: Float[Array, " E"], topology: Topology
) -> FreeBoundary:
    """The terms above, with ω ↦ u given by `vectors`, edges → 2 V components, exact for constant fields in the plane."""
    n_vertices, dtype = topology.n_vertices, lengths.dtype
    side = jnp.where(topology.edge_halfedges[:, 0] >= 0, 1.0, -1.0).astype(dtype)
    side = jnp.where(topology.is_boundary_edge, side, 0.0)  # +1: the surface lies on the left of the edge
    along = edge_directions(lengths, topology)
    across = jnp.stack([-along[..., 1], along[..., 0]], axis=-1)
    ends = jnp.asarray([[-1.0, 1.0]], dtype)  # tail, head

    def at_vertices(values: Float[Array, "E 2 *block"]) -> Float[Array, "V *block"]:
        flat = values.reshape(-1, *values.shape[2:])
        return jax.ops.segment_sum(flat, topology.edges.ravel(), num_segments=n_vertices)

    rises = (ends[:, :, None] * across).reshape(-1, 4)
    rise = RowSparseOperator(end_components(topology), rises, 2 * n_vertices) @ vectors
    products = 0.5 * (along[..., :, None] * across[..., None, :] + across[..., :, None] * along[..., None, :])
    return FreeBoundary(
        half_lengths_inward=at_vertices((0.5 * side * lengths)[:, None, None] * across),
        turns=at_vertices((side[:, None] * ends)[:, :, None, None] * products),
        rises=lx.DiagonalLinearOperator(2 * side / lengths) @ rise,
    )


def tangential_boundary_term(lengths: Float[Array, " E"], topology: Topology) -> lx.AbstractLinearOperator:
    """Diagonal of 4 ∮ (−k_g a²) for a form whose normal part vanishes, a = ω/ℓ along boundary edges."""
    on_boundary = topology.is_boundary_edge
    boundary_length = jnp.where(on_boundary, lengths, 0.0)
    at_vertices = jnp.zeros(topology.n_vertices, lengths.dtype)
    for end in range(2):
        at_vertices = at_vertices.at[topology.edges[:, end]].add(0.5 * boundary_length)
    pointwise = geodesic_curvatures(lengths, topology) / jnp.where(
        topology.is_boundary_vertex, at_vertices, 1.0
    )
    diagonal = jnp.where(on_boundary, -4 * pointwise[topology.edges].mean(axis=1) / lengths, 0.0)
    return lx.DiagonalLinearOperator(diagonal)
