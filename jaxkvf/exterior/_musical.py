"""Flat and sharp: between 1-forms and vectors at vertices or in faces, all intrinsic.

Vertex vectors have two components in the polar frames of `geometry`; face vectors two in the face's own frame, whose first
axis runs along the face's first side. All maps are first-order accurate, exact for constant fields on a flat mesh.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry import (
    barycentric_vertex_areas,
    cone_angles,
    corner_angles,
    edge_directions,
    face_areas,
    rotations,
    spoke_angles,
    unit_vectors,
)
from ..mesh import Topology
from ..sparse import RowSparseOperator


@jax.jit
def flat(vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " E"]:
    """1-form of a vertex field: its line integral along each edge by the trapezoidal rule. Unit: vector × length."""
    return flat_operator(lengths, topology).mv(vectors.ravel())


def flat_operator(lengths: Float[Array, " E"], topology: Topology) -> RowSparseOperator:
    """`flat` as an operator: component c of the vector at vertex v is unknown number 2 v + c."""
    columns = 2 * topology.edges[:, :, None] + jnp.arange(2, dtype=topology.edges.dtype)[None, None]
    values = 0.5 * lengths[:, None, None] * edge_directions(lengths, topology)
    return RowSparseOperator(columns.reshape(-1, 4), values.reshape(-1, 4), 2 * topology.n_vertices)


@jax.jit
def sharp(form: Float[Array, " E"], lengths: Float[Array, " E"], topology: Topology) -> Float[Array, "V 2"]:
    """Vertex field of a 1-form: at each vertex the vector whose components along the spokes fit best (least squares).

    One or two spokes, which an inner vertex of an intrinsic triangulation may have, do not determine a vector; there it is
    the mean over the faces around.
    """
    sign = jnp.where(topology.is_tail_spoke, 1.0, -1.0)
    along = sign * (form / lengths)[topology.spoke_edges]
    direction = unit_vectors(spoke_angles(lengths, topology))

    def around_vertices(x: Float[Array, "S c"]) -> Float[Array, "V c"]:
        return jax.ops.segment_sum(x, topology.spoke_vertices, num_segments=topology.n_vertices)

    (x, y), (right_x, right_y) = direction.T, around_vertices(direction * along[:, None]).T
    xx, xy, yy = around_vertices(jnp.stack([x * x, x * y, y * y], axis=1)).T
    undetermined = (topology.vertex_degrees < 3) & ~topology.is_boundary_vertex
    determinant = jnp.where(undetermined, 1.0, xx * yy - xy * xy)
    fitted = (
        jnp.stack([yy * right_x - xy * right_y, xx * right_y - xy * right_x], axis=1) / determinant[:, None]
    )
    return jnp.where(undetermined[:, None], _mean_over_faces(form, lengths, topology), fitted)


def _mean_over_faces(
    form: Float[Array, " E"], lengths: Float[Array, " E"], topology: Topology
) -> Float[Array, "V 2"]:
    """The vectors `sharp_faces` averaged around each vertex with the faces' areas, in the frame of the vertex.

    Rescaling stretches a corner's angle; a face is laid into it along the bisector.
    """
    angle, area = corner_angles(lengths, topology), face_areas(lengths, topology)
    forward = topology.face_edge_signs > 0
    outgoing = jnp.where(
        forward, topology.edge_spokes[topology.face_edges, 0], topology.edge_spokes[topology.face_edges, 1]
    )
    stretch = jnp.where(topology.is_boundary_vertex, 1.0, 2 * jnp.pi / cone_angles(lengths, topology))
    in_vertex = spoke_angles(lengths, topology)[outgoing] + 0.5 * stretch[topology.faces] * angle
    in_face = _face_side_headings(lengths, topology) + 0.5 * angle
    turned = jnp.einsum(
        "fcij,fj->fci", rotations(in_vertex - in_face), sharp_faces(form, lengths, topology) * area[:, None]
    )
    total = jax.ops.segment_sum(
        turned.reshape(-1, 2), topology.faces.ravel(), num_segments=topology.n_vertices
    )
    return total / (3 * barycentric_vertex_areas(lengths, topology)[:, None])


def _face_side_headings(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, "F 3"]:
    """Direction of each side of each face, counter-clockwise, as an angle from its first side. Radians."""
    turn = jnp.pi - jnp.roll(corner_angles(lengths, topology), -1, axis=1)  # from side s to side s + 1
    return jnp.cumsum(turn, axis=1) - turn


@jax.jit
def face_side_directions(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, "F 3 2"]:
    """Unit tangent of each side of each face, counter-clockwise, in the face's frame."""
    return unit_vectors(_face_side_headings(lengths, topology))


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
