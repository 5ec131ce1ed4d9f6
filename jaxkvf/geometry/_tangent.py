"""Intrinsic polar tangent frames at vertices, and parallel transport along edges.

A tangent vector at a vertex is two numbers in the vertex's own frame, whose first axis is its first spoke. Directions are
angles from that spoke: around an interior vertex the cone angle is rescaled to 2π, at a boundary vertex it is kept.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mesh import Topology
from ._duals import sum_at_vertices
from ._metric import corner_angles


@jax.jit
def spoke_angles(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " S"]:
    """Polar angle of each spoke in the frame of its vertex; the first spoke's is 0. Radians, counter-clockwise.

    A cumulative sum of corner angles around each vertex, done for all vertices in one scan: every ring's mean is taken
    out first, so that the running total returns to zero at each vertex and nothing is lost to cancellation.
    """
    corner, vertex = topology.spoke_corners, topology.spoke_vertices
    angles = corner_angles(lengths, topology)
    turn = jnp.where(corner < 0, 0.0, angles.ravel()[corner])  # from this spoke to the next
    total = sum_at_vertices(angles, topology)
    mean = total / topology.vertex_degrees.astype(lengths.dtype)
    first = topology.spoke_starts[:-1]
    running = jnp.cumsum(turn - mean[vertex])
    before = running - (turn - mean[vertex])  # exclusive sum
    position = (jnp.arange(2 * topology.n_edges, dtype=first.dtype) - first[vertex]).astype(lengths.dtype)
    unscaled = (before - before[first][vertex]) + position * mean[vertex]
    scale = jnp.where(topology.is_boundary_vertex, 1.0, 2 * jnp.pi / total)
    return scale[vertex] * unscaled


@jax.jit
def edge_angles(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, "E 2"]:
    """Polar angle of each edge as seen from its tail and from its head (both pointing along the edge, away). Radians."""
    return spoke_angles(lengths, topology)[topology.edge_spokes]


@jax.jit
def unit_vectors(angles: Float[Array, "*shape"]) -> Float[Array, "*shape 2"]:
    """(cos, sin) of each angle."""
    return jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)


@jax.jit
def edge_directions(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, "E 2 2"]:
    """Unit tangent of each edge, tail towards head, in the frame of its tail `[:, 0]` and of its head `[:, 1]`."""
    outward = unit_vectors(edge_angles(lengths, topology))
    return outward * jnp.asarray([1.0, -1.0], lengths.dtype)[None, :, None]


@jax.jit
def transport_angles(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " E"]:
    """Rotation that carries components from the tail's frame to the head's, along each edge. Radians."""
    at_tail, at_head = edge_angles(lengths, topology).T
    return at_head + jnp.pi - at_tail


@jax.jit
def rotations(angles: Float[Array, "*shape"]) -> Float[Array, "*shape 2 2"]:
    """Rotation matrix by each angle, counter-clockwise."""
    return _turning(jnp.cos(angles), jnp.sin(angles))


@jax.jit
def rotations_between(
    start: Float[Array, "*shape 2"], end: Float[Array, "*shape 2"]
) -> Float[Array, "*shape 2 2"]:
    """Rotation matrix that carries each unit vector `start` to `end`, without a detour by angles."""
    (start_x, start_y), (end_x, end_y) = jnp.moveaxis(start, -1, 0), jnp.moveaxis(end, -1, 0)
    return _turning(start_x * end_x + start_y * end_y, start_x * end_y - start_y * end_x)


def _turning(cos: Float[Array, "*shape"], sin: Float[Array, "*shape"]) -> Float[Array, "*shape 2 2"]:
    return jnp.stack([jnp.stack([cos, -sin], -1), jnp.stack([sin, cos], -1)], -2)


@jax.jit
def transport(
    vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology
) -> Float[Array, "E 2 2"]:
    """Vectors at the two ends of each edge, each carried to the other end: `[:, 0]` tail → head, `[:, 1]` head → tail."""
    turn = rotations(transport_angles(lengths, topology))
    tail, head = vectors[topology.edges[:, 0]], vectors[topology.edges[:, 1]]
    return jnp.stack([jnp.einsum("eij,ej->ei", turn, tail), jnp.einsum("eji,ej->ei", turn, head)], axis=1)
