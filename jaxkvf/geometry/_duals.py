"""Dual areas and curvatures: quantities integrated over the neighbourhood of a vertex or an edge."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mesh import Topology
from ._metric import corner_angles, corner_cotangents, face_areas


def sum_at_vertices(corner_values: Float[Array, "F 3"], topology: Topology) -> Float[Array, " V"]:
    """Sum of the values of the corners around each vertex."""
    return jax.ops.segment_sum(
        corner_values.ravel(), topology.faces.ravel(), num_segments=topology.n_vertices
    )


@jax.jit
def cotan_weights(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " E"]:
    """½ (cot α + cot β) of the angles opposite each edge (one on the boundary): dual length over length.

    Dimensionless; negative where the edge is not Delaunay.
    """
    opposite = jnp.roll(corner_cotangents(lengths, topology), 1, axis=1)  # corner c + 2 faces side c
    return 0.5 * jax.ops.segment_sum(
        opposite.ravel(), topology.face_edges.ravel(), num_segments=topology.n_edges
    )


@jax.jit
def edge_areas(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " E"]:
    """Diamond area of each edge, ½ ℓ² × cotangent weight; they sum to the surface area. Unit: length².

    A_ij of the paper, §3.2. Negative where the edge is not Delaunay.
    """
    return 0.5 * lengths**2 * cotan_weights(lengths, topology)


@jax.jit
def barycentric_vertex_areas(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " V"]:
    """A third of the area of the faces around each vertex; always positive. Unit: length²."""
    third = face_areas(lengths, topology)[:, None] / 3
    return sum_at_vertices(jnp.broadcast_to(third, (topology.n_faces, 3)), topology)


@jax.jit
def circumcentric_vertex_areas(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " V"]:
    """Voronoi area of each vertex, Σ ⅛ (b² cot β + c² cot γ) over its corners. Unit: length².

    |v*| of the paper, §3.2. May be negative on a triangulation that is not Delaunay.
    """
    half_diamond = (
        0.25 * lengths[topology.face_edges] ** 2 * jnp.roll(corner_cotangents(lengths, topology), 1, axis=1)
    )
    return sum_at_vertices(0.5 * (half_diamond + jnp.roll(half_diamond, 1, axis=1)), topology)


@jax.jit
def cone_angles(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " V"]:
    """Sum of the corner angles at each vertex. Radians."""
    return sum_at_vertices(corner_angles(lengths, topology), topology)


@jax.jit
def angle_defects(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " V"]:
    """2π − cone angle: Gauss curvature integrated over the vertex; 0 at boundary vertices. Radians.

    With `geodesic_curvatures` they sum to 2πχ (Gauss–Bonnet). k_i of the paper, §3.2.
    """
    inside = ~topology.is_boundary_vertex
    return jnp.where(inside, 2 * jnp.pi - cone_angles(lengths, topology), 0.0)


@jax.jit
def geodesic_curvatures(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " V"]:
    """π − cone angle at boundary vertices: geodesic curvature integrated along the boundary; 0 inside. Radians.

    Positive where the boundary bends towards the surface: 2π in all around a flat disk.
    """
    return jnp.where(topology.is_boundary_vertex, jnp.pi - cone_angles(lengths, topology), 0.0)
