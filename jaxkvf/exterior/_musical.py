"""Flat and sharp: between 1-forms and vectors at vertices or in faces, all intrinsic.

Vertex vectors have two components in the polar frames of `geometry`; face vectors two in the face's own frame, whose first
axis runs along the face's first side. All maps are first-order accurate, exact for constant fields on a flat mesh.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry import corner_angles, edge_directions, face_areas, spoke_angles, unit_vectors
from ..mesh import Topology


@jax.jit
def flat(vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " E"]:
    """1-form of a vertex field: its line integral along each edge by the trapezoidal rule. Unit: vector × length."""
    ends = vectors[topology.edges]
    return 0.5 * lengths * (ends * edge_directions(lengths, topology)).sum(axis=(1, 2))


@jax.jit
def sharp(form: Float[Array, " E"], lengths: Float[Array, " E"], topology: Topology) -> Float[Array, "V 2"]:
    """Vertex field of a 1-form: at each vertex the vector whose components along the spokes fit best (least squares)."""
    sign = jnp.where(topology.edges[topology.spoke_edges, 0] == topology.spoke_vertices, 1.0, -1.0)
    along = sign * (form / lengths)[topology.spoke_edges]
    direction = unit_vectors(spoke_angles(lengths, topology))

    def around_vertices(x: Float[Array, "S c"]) -> Float[Array, "V c"]:
        return jax.ops.segment_sum(x, topology.spoke_vertices, num_segments=topology.n_vertices)

    (x, y), (right_x, right_y) = direction.T, around_vertices(direction * along[:, None]).T
    xx, xy, yy = around_vertices(jnp.stack([x * x, x * y, y * y], axis=1)).T
    determinant = xx * yy - xy * xy
    return (
        jnp.stack([yy * right_x - xy * right_y, xx * right_y - xy * right_x], axis=1) / determinant[:, None]
    )


@jax.jit
def face_side_directions(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, "F 3 2"]:
    """Unit tangent of each side of each face, counter-clockwise, in the face's frame."""
    turn = jnp.pi - jnp.roll(corner_angles(lengths, topology), -1, axis=1)  # from side s to side s + 1
    heading = jnp.cumsum(turn, axis=1) - turn
    return unit_vectors(heading)


@jax.jit
def flat_faces(
    vectors: Float[Array, "F 2"], lengths: Float[Array, " E"], topology: Topology
) -> Float[Array, " E"]:
    """1-form of a face field: line integral along each edge, averaged over its faces. Unit: vector × length."""
    sides = jnp.einsum("fc,fsc->fs", vectors, face_side_directions(lengths, topology))
    sides = sides * topology.face_edge_signs.astype(lengths.dtype)

    def over_edges(x: Float[Array, "F 3"]) -> Float[Array, " E"]:
        return jax.ops.segment_sum(x.ravel(), topology.face_edges.ravel(), num_segments=topology.n_edges)

    return lengths * over_edges(sides) / over_edges(jnp.ones_like(sides))


@jax.jit
def sharp_faces(
    form: Float[Array, " E"], lengths: Float[Array, " E"], topology: Topology
) -> Float[Array, "F 2"]:
    """Face field of a 1-form: its Whitney interpolant at the barycentre, Σ ω_ij (∇λ_j − ∇λ_i)/3."""
    side = lengths[topology.face_edges][:, :, None] * face_side_directions(lengths, topology)
    inward = jnp.stack([-side[..., 1], side[..., 0]], axis=-1)
    gradient = jnp.roll(inward, -1, axis=1) / (
        2 * face_areas(lengths, topology)[:, None, None]
    )  # ∇λ of each corner
    circulation = form[topology.face_edges] * topology.face_edge_signs.astype(form.dtype)
    return (circulation[:, :, None] * (jnp.roll(gradient, -1, axis=1) - gradient)).sum(axis=1) / 3
