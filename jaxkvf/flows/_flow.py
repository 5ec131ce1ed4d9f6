"""The flow φᵗ of a tangent field: where points are after a time."""

from enum import IntEnum
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from ..geometry import edge_lengths, project, vertex_frames
from ..mesh import TriangleMesh
from . import _trace
from ._face_fields import FaceField, face_field
from ._points import SurfacePoints, surface_positions, vertex_points

_MOST_STEPS = 200_000
_ON_THE_FACE = 1e-9


class FlowStatus(IntEnum):
    """What became of a tracer; compare with `Flow.status`."""

    ARRIVED = _trace.ARRIVED
    """It went on for the whole time."""
    LEFT = _trace.LEFT
    """It reached the boundary and the field points off the surface: it is where, and `Flow.time` is when."""
    STATIONARY = _trace.STATIONARY
    """It stays in a singular point, where the field vanishes."""
    UNFINISHED = _trace.UNFINISHED
    """It passed more faces than were allowed."""


class Flow(NamedTuple):
    """Where the tracers are at the end."""

    faces: Int[Array, " N"]
    barycentric: Float[Array, "N 3"]
    status: Int[Array, " N"]
    """`FlowStatus` of each tracer."""
    time: Float[Array, " N"]
    """How long each was under way: t itself for those that arrived or stay. Unit: time."""

    @property
    def points(self) -> SurfacePoints:
        return SurfacePoints(self.faces, self.barycentric)


def flow(
    mesh: TriangleMesh,
    vectors: ArrayLike,
    t: ArrayLike,
    faces: ArrayLike,
    barycentric: ArrayLike,
    *,
    max_steps: int = _MOST_STEPS,
) -> Flow:
    """φᵗ of the tangent field `vectors` (eq. (1) of the paper) for all points at once.

    The field is linear in each flattened face and the motion in a face is integrated exactly, to rounding, up to the point
    where it leaves the face; so φˢ∘φᵗ = φˢ⁺ᵗ, φ⁻ᵗ undoes φᵗ, and isometric surfaces have the same flow. What is approximate
    is the field between the vertices. Not differentiable: the path is a sequence of discrete choices.

    Args:
        mesh: the surface.
        vectors: `[V, 3]`, tangent vectors at the vertices (of a normal part nothing is used), such as
            `killing_fields(mesh).vectors[0]`. Unit: length / time.
        t: time to go, one for all or `[N]`, one a point; negative: backwards.
        faces: `[N]`, face of each point; `vertex_points`, `closest_points` make points of vertices or positions.
        barycentric: `[N, 3]`, its barycentric coordinates there, at least 0 and summing to 1.
        max_steps: most faces that a tracer may pass.

    Returns:
        End faces, end barycentric coordinates, status and time of each tracer.

    Raises:
        ValueError: a field of another shape, not finite, or zero everywhere; a time that is not finite; a point that lies in
            no face.
    """
    field = tracing_field(mesh, vectors)
    points = checked_points(mesh, faces, barycentric)
    return follow(field, points, checked_times(t, points), max_steps)


def advect_vertices(mesh: TriangleMesh, vectors: ArrayLike, t: ArrayLike) -> Float[Array, "V 3"]:
    """φᵗ of every vertex: the positions X_t = φᵗ(X₀) of §3.3. A vertex that meets the boundary stays there. Unit: length.

    Raises:
        ValueError: as for `flow`.
    """
    points = vertex_points(mesh.topology)
    return surface_positions(mesh, flow(mesh, vectors, t, *points).points)


class TracingField(NamedTuple):
    """A field made ready for tracing, forwards and backwards."""

    forward: FaceField
    backward: FaceField


def tracing_field(mesh: TriangleMesh, vectors: ArrayLike) -> TracingField:
    """Raises `ValueError` for a field of another shape than the vertices, not finite, or zero everywhere."""
    vectors = checked_field(mesh, vectors)
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    intrinsic = project(vectors, vertex_frames(mesh.vertices, mesh.topology))
    return TracingField(*(face_field(u, lengths, mesh.topology) for u in (intrinsic, -intrinsic)))


def checked_field(mesh: TriangleMesh, vectors: ArrayLike) -> Float[Array, "V 3"]:
    """The field in the dtype of the mesh.

    Raises:
        ValueError: another shape than the vertices, not finite, or zero everywhere.
    """
    vectors = jnp.asarray(vectors, mesh.vertices.dtype)
    if vectors.shape != mesh.vertices.shape:
        raise ValueError(
            f"vectors must have shape {list(mesh.vertices.shape)}, one at each vertex, got {list(vectors.shape)}"
        )
    bad = np.flatnonzero(~np.isfinite(np.asarray(vectors)).all(axis=1))
    if bad.size:
        raise ValueError(
            f"vectors must be finite; at vertex {bad[0]} they are not ({bad.size} such vertices)"
        )
    if not np.asarray(vectors).any():
        raise ValueError("the field is zero everywhere: it generates no flow")
    return vectors


def checked_points(mesh: TriangleMesh, faces: object, barycentric: object) -> SurfacePoints:
    """The points, clipped to their faces where rounding took them out.

    Raises:
        ValueError: wrong shapes or dtype, a face that does not exist, or coordinates that lie in no face.
    """
    face, b = np.asarray(faces), np.asarray(barycentric, np.float64)
    if face.ndim != 1 or not np.issubdtype(face.dtype, np.integer) or b.shape != (len(face), 3):
        raise ValueError(
            f"points need integer faces [N] and barycentric [N, 3], got {face.dtype} {list(face.shape)} and {list(b.shape)}"
        )
    n = mesh.topology.n_faces
    outside = np.flatnonzero((face < 0) | (face >= n))
    if outside.size:
        raise ValueError(f"point {outside[0]} is in face {face[outside[0]]}: the mesh has faces 0…{n - 1}")
    off = np.flatnonzero(~((b >= -_ON_THE_FACE).all(axis=1) & (np.abs(b.sum(axis=1) - 1) <= _ON_THE_FACE)))
    if off.size:
        raise ValueError(
            f"point {off[0]} is off the mesh: barycentric coordinates must be at least 0 and sum to 1, "
            f"got {b[off[0]].tolist()} ({off.size} such points); closest_points puts positions on the mesh"
        )
    b = np.maximum(b, 0)
    return SurfacePoints(
        jnp.asarray(face.astype(np.int32)), jnp.asarray(b / b.sum(axis=1, keepdims=True), mesh.vertices.dtype)
    )


def checked_times(t: object, points: SurfacePoints) -> Float[Array, " N"]:
    """One finite time for each point.

    Raises:
        ValueError: another shape, or a time that is not finite.
    """
    n, time = len(points.faces), np.asarray(t, np.float64)
    if time.shape not in ((), (n,)):
        raise ValueError(
            f"t must be a number or have one for each of the {n} points, got shape {list(time.shape)}"
        )
    if not np.isfinite(time).all():
        raise ValueError(f"t must be finite, got {time[~np.isfinite(time)][0]}")
    return jnp.asarray(np.broadcast_to(time, (n,)), points.barycentric.dtype)


def follow(
    field: TracingField, points: SurfacePoints, time: Float[Array, " N"], max_steps: int = _MOST_STEPS
) -> Flow:
    """`flow` of arguments that have been checked."""
    backwards = np.asarray(time) < 0
    if backwards.all():
        return _follow(field.backward, points, -time, time, max_steps)
    ahead = _follow(field.forward, points, jnp.maximum(time, 0), time, max_steps)
    if not backwards.any():
        return ahead
    back = _follow(field.backward, points, jnp.maximum(-time, 0), time, max_steps)
    return jax.tree.map(
        lambda a, b: jnp.where(backwards if a.ndim == 1 else backwards[:, None], b, a), ahead, back
    )


@jax.jit
def _follow(
    field: FaceField, points: SurfacePoints, duration: Array, time: Array, max_steps: int | Int[Array, ""]
) -> Flow:
    end = _trace.trace(field, points.faces, points.barycentric, duration, max_steps)
    gone = jnp.where(end.status == FlowStatus.STATIONARY, duration, duration - end.time_left)
    return Flow(end.face, end.barycentric.T, end.status, jnp.sign(time) * gone)
