"""The flow φᵗ of a tangent field: where points are after a time."""

from enum import IntEnum

import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from ..arguments import Integer
from ..geometry import SurfacePoints, surface_positions, vertex_points
from ..mesh import TriangleMesh
from . import _trace
from ._checked import checked_field, checked_points, checked_steps, checked_times
from ._face_fields import FaceField, tracing_field


class FlowStatus(IntEnum):
    """What became of a tracer; compare with `Flow.status`."""

    ARRIVED = _trace.ARRIVED
    """It went on for the whole time."""
    LEFT = _trace.LEFT
    """It reached the boundary and the field points off the surface: it is where, and `Flow.time` is when."""
    STATIONARY = _trace.STATIONARY
    """It stays in a singular point, where the field vanishes."""
    UNFINISHED = _trace.UNFINISHED
    """It took as many steps as were allowed: it is where it was then, and `Flow.time` is when."""


class Flow(eqx.Module):
    """Where the tracers are at the end."""

    points: SurfacePoints
    """`[N]`. At the boundary for those that left."""
    status: Int[Array, " N"]
    """`FlowStatus` of each tracer."""
    time: Float[Array, " N"]
    """How long each was under way: the time asked for if it arrived or stays. Unit: time."""


def flow(
    mesh: TriangleMesh,
    vectors: ArrayLike,
    time: ArrayLike,
    points: SurfacePoints,
    *,
    max_steps: Integer | None = None,
) -> Flow:
    """φᵗ of the tangent field `vectors` (eq. (1) of the paper) for all points at once.

    The field is linear in each flattened face and the motion in a face is integrated exactly, to rounding, up to the point
    where it leaves the face; so φˢ∘φᵗ = φˢ⁺ᵗ, φ⁻ᵗ undoes φᵗ, and isometric surfaces have the same flow. What is approximate
    is the field between the vertices.

    Under `jit` and `vmap` values are not checked: what is not finite or off the mesh comes out as NaN. In forward mode
    (`jax.jvp`, `jax.jacfwd`) the end points are differentiated along their paths, which cross the same edges; a derivative
    is that of `Flow.points.barycentric`, or of `surface_positions` of the points, and holds as long as they do. There is
    no reverse mode.

    Args:
        mesh: the surface.
        vectors: `[V, 3]`, tangent vectors at the vertices (of a normal part nothing is used), such as
            `killing_fields(mesh).vectors[0]`. Unit: length / time.
        time: how long to go, one for all or `[N]`, one a point; negative: backwards.
        points: `[N]` points; `vertex_points`, `closest_points` make them of vertices or positions.
        max_steps: most steps of a tracer, each within one face; `None`: four a face and 10,000, and on large meshes less,
            enough for dozens of times around them.

    Returns:
        End points, status and time of each tracer.

    Raises:
        ValueError: a field of another shape, not finite, or zero everywhere; a time that is not finite; a point that lies in
            no face.
    """
    field = checked_field(mesh, vectors)
    start = checked_points(mesh, points)
    times = checked_times(time, start)
    limit = checked_steps(max_steps, mesh.topology)
    return _flow(tracing_field(mesh, field), times, start, limit)


def advect_vertices(
    mesh: TriangleMesh, vectors: ArrayLike, time: ArrayLike, *, max_steps: Integer | None = None
) -> Float[Array, "V 3"]:
    """φᵗ of every vertex: the positions X_t = φᵗ(X₀) of §3.3. A vertex that meets the boundary stays there. Unit: length.

    Under transformations as for `flow`.

    Raises:
        ValueError: as for `flow`.
    """
    end = flow(mesh, vectors, time, vertex_points(mesh), max_steps=max_steps)
    return surface_positions(mesh, end.points)


@jax.jit
def _flow(
    field: FaceField,
    times: Float[Array, " N"],
    start: SurfacePoints,
    max_steps: int | Int[Array, ""],
) -> Flow:
    end, _ = follow(field, start, times, max_steps)
    return eqxi.nondifferentiable_backward(
        end, msg="a flow has no reverse-mode derivative: take jax.jvp or jax.jacfwd"
    )


def follow(
    field: FaceField, start: SurfacePoints, times: Float[Array, " N"], max_steps: int | Int[Array, ""]
) -> tuple[Flow, Int[Array, ""]]:
    """`flow` of arguments that have been checked, and how many steps it took."""
    end, steps = _trace.trace(field, on_sheets(field, start, times), start.barycentric, abs(times), max_steps)
    gone = abs(times) - jnp.where(end.status == FlowStatus.STATIONARY, 0.0, end.time_left)
    points = SurfacePoints(end.face % (field.n_faces // 2), end.barycentric.T)
    return Flow(points, end.status, jnp.sign(times) * gone), steps


def on_sheets(field: FaceField, points: SurfacePoints, times: Float[Array, " N"]) -> Int[Array, " N"]:
    """The faces of the points in the two sheets of a `tracing_field`: backwards in the second."""
    return points.faces + jnp.where(times < 0, field.n_faces // 2, 0).astype(points.faces.dtype)
