"""Flat and sharp: between 1-forms and vectors at vertices or in faces, all intrinsic.

Vertex vectors have two components in the polar frames of `geometry`; face vectors two in the face's own frame, whose first
axis runs along the face's first side. All maps are first-order accurate, exact for constant fields on a flat mesh.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

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
from ..sparse import RowSparseOperator, TransposedRowSparseOperator


@jax.jit
def flat(vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " E"]:
    """1-form of a vertex field: its line integral along each edge by the trapezoidal rule. Unit: vector × length."""
    return flat_operator(lengths, topology).mv(vectors.ravel())


def flat_operator(lengths: Float[Array, " E"], topology: Topology) -> RowSparseOperator:
    """`flat` as an operator: component c of the vector at vertex v is unknown number 2 v + c."""
    values = 0.5 * lengths[:, None, None] * edge_directions(lengths, topology)
    return RowSparseOperator(end_components(topology), values.reshape(-1, 4), 2 * topology.n_vertices)


@jax.jit
def sharp(form: Float[Array, " E"], lengths: Float[Array, " E"], topology: Topology) -> Float[Array, "V 2"]:
    """Vertex field of a 1-form: at each vertex the vector whose components along the spokes fit best (least squares).

    One or two spokes, which an inner vertex of an intrinsic triangulation may have, do not determine a vector; there it is
    the mean over the faces around.
    """
    fitted = sharp_operator(lengths, topology).mv(form).reshape(-1, 2)
    undetermined = _is_undetermined(topology)[:, None]
    return jnp.where(undetermined, _mean_over_faces(form, lengths, topology), fitted)


def sharp_operator(
    lengths: Float[Array, " E"], topology: Topology, weights: Float[Array, " E"] | None = None
) -> TransposedRowSparseOperator:
    """`sharp` as a sparse operator, edges → 2 V vector components; 0 where one or two spokes determine no vector.

    Args:
        lengths: length of each edge.
        topology: connectivity.
        weights: of the edges in the least-squares fit, positive; by default equal.
    """
    direction = edge_directions(lengths, topology)  # form / length is the component along it, at both ends
    weighted = direction if weights is None else weights[:, None, None] * direction
    outer = (weighted[..., :, None] * direction[..., None, :]).reshape(-1, 4)
    xx, xy, _, yy = jax.ops.segment_sum(outer, topology.edges.ravel(), num_segments=topology.n_vertices).T
    undetermined = _is_undetermined(topology)
    determinant = jnp.where(undetermined, 1.0, xx * yy - xy * xy)
    inverse = jnp.stack([yy, -xy, -xy, xx], axis=1).reshape(-1, 2, 2) / determinant[:, None, None]
    inverse = jnp.where(undetermined[:, None, None], 0.0, inverse)
    fit = jnp.einsum("ecij,ecj->eci", inverse[topology.edges], weighted) / lengths[:, None, None]
    fitted = RowSparseOperator(end_components(topology), fit.reshape(-1, 4), 2 * topology.n_vertices)
    return fitted.transpose()


def end_components(topology: Topology) -> Int[Array, "E 4"]:
    """Numbers of the vector components at the tail and head of each edge, among 2 V."""
    first = jnp.repeat(2 * topology.edges, 2, axis=1)
    return first + jnp.asarray([[0, 1, 0, 1]], first.dtype)


def _is_undetermined(topology: Topology) -> Bool[Array, " V"]:
    return (topology.vertex_degrees < 3) & ~topology.is_boundary_vertex


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
