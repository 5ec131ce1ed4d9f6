"""A vertex field as a linear field in each flattened face, whose flow crosses every edge the same way from both sides.

Two faces that pushed a tracer at each other would hold it on their common edge and merge what was apart. Here the sign of
the field's normal component on an edge is the same seen from both sides, at every point of the edge: what leaves a face
enters its neighbour, no tracer slides or stalls, and following the field backwards retraces the same path.

A vertex vector goes into a corner of a face by the angles: the vertex's polar frame stretches the corner's angle θ to sθ;
the map that takes 0, sθ, π, π + sθ to 0, θ, π, π + θ, linear between, keeps on which side of both spokes the vector points,
and the vector keeps its length. Where the normal component changes sign along an edge, both faces take that of the polar
frames, so that they agree on where. Everything follows from edge lengths.

On spheroids 1 : 1 : 1.6 the edge-length error after a period falls with h^1.86. Brezzi–Douglas–Marini elements, with normal
components equal on both sides, give h^1.6: mesh rows that run along the field make them shear. Vectors projected into the
faces from space stall on 1–2 % of the vertices and depend on the embedding.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..geometry import (
    cone_angles,
    corner_angles,
    edge_angles,
    edge_directions,
    edge_lengths,
    face_areas,
    project,
    vertex_frames,
)
from ..mesh import Topology, TriangleMesh

LEAVES = -1
STAYS = -2


class FaceField(eqx.Module):
    """A field ḃ = J b on barycentric coordinates b, J constant in a face, and where tracers go at sides and corners."""

    velocities: Float[Array, "F 8"]
    """J₀₁, J₀₂, J₁₀, J₁₂, J₂₀, J₂₁ (J_ij: rate of b_i at corner j; columns of J sum to zero), the norm of the field's
    gradient and a filler: one row, one cache line. Unit: time⁻¹."""
    exits: Int[Array, " 6*F"]
    """Halfedge of the neighbour across each halfedge (F 3), then corner from which a tracer at each corner's vertex goes on
    (F 3); `LEAVES` where the surface ends, `STAYS` where the field vanishes."""

    @property
    def n_faces(self) -> int:
        return self.velocities.shape[0]


@jax.jit
def tracing_field(mesh: TriangleMesh, vectors: Float[Array, "V 3"]) -> FaceField:
    """The field of vertex vectors on two sheets of the mesh, forwards on faces 0…F−1 and backwards on F…2F−1."""
    topology = mesh.topology
    lengths = edge_lengths(mesh.vertices, topology)
    intrinsic = project(vectors, vertex_frames(mesh.vertices, topology))
    both = jnp.stack([intrinsic, -intrinsic])
    matrix, packed = jax.vmap(lambda u: _sheet(u, lengths, topology))(both)
    ahead, back = jax.vmap(lambda m: _departures(m, topology))(matrix)
    further = 3 * topology.n_faces
    twins = _twins(topology)
    exits = [twins, _moved(twins, further), ahead, _moved(back, further)]
    return FaceField(packed.reshape(-1, 8), jnp.concatenate(exits))


def _moved(exits: Int[Array, " H"], further: int) -> Int[Array, " H"]:
    """Halfedges or corners of the first sheet as those of the second."""
    return jnp.where(exits < 0, exits, exits + further)


def _sheet(
    vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology
) -> tuple[Float[Array, "F 3 3"], Float[Array, "F 8"]]:
    """J of each face, and the rows of `FaceField.velocities`."""
    matrix = barycentric_velocities(vectors, lengths, topology)
    off_diagonal = [matrix[:, i, j] for i, j in ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))]
    rate = _gradient_norms(jax.lax.stop_gradient(matrix), jax.lax.stop_gradient(lengths), topology)
    return matrix, jnp.stack([*off_diagonal, rate, jnp.zeros_like(rate)], axis=1)


def barycentric_velocities(
    vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology
) -> Float[Array, "F 3 3"]:
    """J of each face: on the side opposite corner i, ḃ_i = (inward normal component) × side / (2 area). Unit: time⁻¹."""
    forward = topology.face_edge_signs > 0
    across = _normal_components(vectors, lengths, topology)
    in_polar_frames = across[topology.face_edges]
    in_polar_frames = jnp.where(forward[..., None], in_polar_frames, -in_polar_frames[..., ::-1])

    angle = corner_angles(lengths, topology)
    stretch = jnp.where(topology.is_boundary_vertex, 1.0, 2 * jnp.pi / cone_angles(lengths, topology))
    vector = vectors[topology.faces]
    speed = _norms(vector)
    at_ends = edge_angles(lengths, topology)[topology.face_edges]
    first_side = jnp.where(forward, at_ends[..., 0], at_ends[..., 1])
    x, y = (
        jnp.where(speed > 0, vector[..., 0], 1.0),
        vector[..., 1],
    )  # any angle will do where the vector is 0
    heading = jnp.mod(jnp.arctan2(y, x) - first_side, 2 * jnp.pi)
    heading, fits = _into_corner(heading, angle, stretch[topology.faces])
    flow_line = ((across == 0).all(axis=1) & topology.is_boundary_edge)[topology.face_edges]
    heading = _along_boundary(heading, angle, flow_line)
    at_start, at_end = speed * jnp.sin(heading), jnp.roll(speed * jnp.sin(angle - heading), -1, axis=1)
    in_corners = jnp.stack([at_start, at_end], axis=2)

    one_sign = (across[:, 0] * across[:, 1] > 0)[topology.face_edges][..., None]
    fits = jnp.stack([fits, jnp.roll(fits, -1, axis=1)], axis=2)
    inward = jnp.where(one_sign & fits, in_corners, in_polar_frames)  # at start and end of each side
    inward = inward * (lengths[topology.face_edges] / (2 * face_areas(lengths, topology)[:, None]))[..., None]
    matrix = jnp.zeros((topology.n_faces, 3, 3), lengths.dtype)
    for side in range(3):
        start, end, opposite = side, (side + 1) % 3, (side + 2) % 3
        matrix = matrix.at[:, opposite, start].set(inward[:, side, 0])
        matrix = matrix.at[:, opposite, end].set(inward[:, side, 1])
    corner = jnp.arange(3)
    return matrix.at[:, corner, corner].set(-matrix.sum(axis=1))


def _into_corner(
    heading: Float[Array, "F 3"], angle: Float[Array, "F 3"], stretch: Float[Array, "F 3"]
) -> tuple[Float[Array, "F 3"], Bool[Array, "F 3"]]:
    """Polar angle from a corner's first side → angle in the face, and whether the stretched corner is less than π."""
    half_turns = jnp.floor(heading / jnp.pi)
    rest, stretched = heading - half_turns * jnp.pi, stretch * angle
    fits = stretched < jnp.pi
    outside = (jnp.pi - angle) / jnp.where(fits, jnp.pi - stretched, 1.0)
    return half_turns * jnp.pi + jnp.where(
        rest < stretched, rest / stretch, angle + (rest - stretched) * outside
    ), fits


def _along_boundary(
    heading: Float[Array, "F 3"], angle: Float[Array, "F 3"], flow_line: Bool[Array, "F 3"]
) -> Float[Array, "F 3"]:
    """Headings turned into the boundary at corners of sides that are flow lines, unless they then crossed the other side."""

    def nearest(direction: Float[Array, "F 3"]) -> Float[Array, "F 3"]:
        return direction + jnp.pi * jnp.round((heading - direction) / jnp.pi)

    after, before = nearest(jnp.zeros_like(angle)), nearest(angle)
    keeps_end = jnp.sin(angle - after) * jnp.sin(angle - heading) > 0
    keeps_start = jnp.sin(before) * jnp.sin(heading) > 0
    heading = jnp.where(jnp.roll(flow_line, 1, axis=1) & keeps_start, before, heading)
    return jnp.where(flow_line & keeps_end, after, heading)


def _normal_components(
    vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology
) -> Float[Array, "E 2"]:
    """⟨U, n⟩ at tail and head of each edge, n pointing to its left: pointwise, in each end's own polar frame.

    Zero where the field runs along the edge to rounding, and on a boundary edge through which what comes in goes out again,
    but for `BOUNDARY_TOLERANCE`: a field that is tangential to a smooth boundary is not so to each side of the polygon that
    stands for it. Such edges are flow lines.
    """
    tangent = edge_directions(lengths, topology)
    at_ends = vectors[topology.edges]
    across = at_ends[..., 1] * tangent[..., 0] - at_ends[..., 0] * tangent[..., 1]
    speed = _norms(at_ends)
    across = jnp.where(jnp.abs(across) <= 1e3 * jnp.finfo(lengths.dtype).eps * speed, 0.0, across)
    total, speed = jnp.abs(across).sum(axis=1), speed.max(axis=1)
    along_boundary = jnp.abs(across.sum(axis=1)) <= BOUNDARY_TOLERANCE * jnp.maximum(total, 1e-5 * speed)
    return jnp.where((along_boundary & topology.is_boundary_edge)[:, None], 0.0, across)


def _norms(vectors: Float[Array, "*n 2"]) -> Float[Array, "*n"]:
    """Lengths of vectors, with the derivative 0 where they are 0."""
    moves = (vectors != 0).any(axis=-1)
    return jnp.where(moves, jnp.linalg.norm(jnp.where(moves[..., None], vectors, 1.0), axis=-1), 0.0)


BOUNDARY_TOLERANCE = 0.1
"""Flux through a boundary edge, relative to the fluxes at its ends taken positive, below which it counts as none."""


def _gradient_norms(
    matrix: Float[Array, "F 3 3"], lengths: Float[Array, " E"], topology: Topology
) -> Float[Array, " F"]:
    """Frobenius norm of the field's gradient in each face, X J ∇λ, in an orthonormal frame of the face."""
    side = lengths[topology.face_edges]
    angle = corner_angles(lengths, topology)[:, 0]
    zero = jnp.zeros_like(angle)
    x = jnp.stack([zero, side[:, 0], side[:, 2] * jnp.cos(angle)], axis=1)
    y = jnp.stack([zero, zero, side[:, 2] * jnp.sin(angle)], axis=1)
    corners = jnp.stack([x, y], axis=1)  # [F, 2, 3]
    sides = jnp.roll(corners, 1, axis=2) - jnp.roll(corners, -1, axis=2)  # opposite each corner, clockwise
    inward = jnp.stack([sides[:, 1], -sides[:, 0]], axis=1) / (
        2 * face_areas(lengths, topology)[:, None, None]
    )
    gradient = jnp.einsum("fxi,fij,fyj->fxy", corners, matrix, inward)
    return jnp.sqrt((gradient**2).sum(axis=(1, 2)))


def _twins(topology: Topology) -> Int[Array, " H"]:
    """The opposite of each halfedge, `LEAVES` on the boundary."""
    forward = topology.face_edge_signs.ravel() > 0
    pair = topology.edge_halfedges[topology.face_edges.ravel()]
    return jnp.where(forward, pair[:, 1], pair[:, 0])


def _departures(matrix: Float[Array, "F 3 3"], topology: Topology) -> Int[Array, " H"]:
    """For each corner, the corner around the same vertex into which the field points, or `LEAVES` or `STAYS`."""
    corner = jnp.arange(3)
    towards = jnp.stack([matrix[:, (corner + i) % 3, corner] for i in (1, 2)], axis=2).reshape(-1, 2)
    vertex = topology.faces.ravel()
    beyond = jnp.stack([matrix[:, (corner + i) % 3, (corner + 3 - i) % 3] for i in (1, 2)], axis=2).reshape(
        -1, 2
    )
    # Along a side it is the side's other end that tells to which face a tracer goes.
    inside = ((towards > 0) | ((towards == 0) & (beyond >= 0))).all(axis=1) & (towards > 0).any(axis=1)
    index = jnp.arange(inside.shape[0], dtype=vertex.dtype)
    none = inside.shape[0]
    chosen = jax.ops.segment_min(jnp.where(inside, index, none), vertex, num_segments=topology.n_vertices)
    moves = jax.ops.segment_max((towards != 0).any(axis=1), vertex, num_segments=topology.n_vertices)
    nowhere = jnp.where(moves & topology.is_boundary_vertex, LEAVES, STAYS)
    return jnp.where(chosen < none, chosen, nowhere)[vertex]
