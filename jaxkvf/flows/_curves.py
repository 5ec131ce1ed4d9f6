"""Integral curves as polylines with time stamps."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from ..arguments import Integer, checked_integer
from ..geometry import SurfacePoints, surface_positions
from ..mesh import TriangleMesh
from ._checked import checked_field, checked_points, checked_steps, checked_times
from ._face_fields import FaceField, tracing_field
from ._flow import FlowStatus, follow

_Carry = tuple[SurfacePoints, Float[Array, " N"], Int[Array, " N"], Int[Array, ""]]


class IntegralCurves(eqx.Module):
    """Polylines on the surface: point i of curve n is where the tracer n is at the time `times[n, i]`."""

    points: SurfacePoints
    """`[N, k]`."""
    positions: Float[Array, "N k 3"]
    """The points in space. Unit: length."""
    times: Float[Array, "N k"]
    """Equal steps from 0 to the time asked for; from where a tracer stopped, the time at which it did. Unit: time."""
    status: Int[Array, " N"]
    """`FlowStatus` of each tracer at the end."""

    def polylines(self) -> list[Float[np.ndarray, "_ 3"]]:
        """The positions of each curve, those after it stopped taken away. On the host."""
        ends = 1 + np.argmax(np.abs(np.asarray(self.times)), axis=1)
        return [x[:end] for x, end in zip(np.asarray(self.positions), ends, strict=True)]


def integral_curves(
    mesh: TriangleMesh,
    vectors: ArrayLike,
    time: ArrayLike,
    points: SurfacePoints,
    *,
    samples: Integer = 200,
    max_steps: Integer | None = None,
) -> IntegralCurves:
    """The curves t ↦ φᵗ(p), followed exactly (see `flow`) and sampled at equal times.

    Args:
        mesh: the surface.
        vectors: `[V, 3]`, tangent vectors at the vertices. Unit: length / time.
        time: how long to go, one for all or `[N]`, one a curve; negative: backwards.
        points: `[N]`, where they start.
        samples: number of steps, ≥ 1; each curve has one point more.
        max_steps: most steps from face to face on the whole of a curve; default as in `flow`.

    Raises:
        ValueError: `samples` < 1; otherwise as for `flow`.
    """
    samples = checked_integer("samples", samples)
    field = checked_field(mesh, vectors)
    start = checked_points(mesh, points)
    times = checked_times(time, start)
    limit = checked_steps(max_steps, mesh.topology)
    return _curves(mesh, tracing_field(mesh, field), times, start, max_steps=limit, samples=samples)


@partial(jax.jit, static_argnames="samples")
def _curves(
    mesh: TriangleMesh,
    field: FaceField,
    whole: Float[Array, " N"],
    start: SurfacePoints,
    *,
    max_steps: int | Int[Array, ""],
    samples: int,
) -> IntegralCurves:
    def ahead(carry: _Carry, _: None) -> tuple[_Carry, tuple[SurfacePoints, Float[Array, " N"]]]:
        points, gone, status, steps = carry
        going: Bool[Array, " N"] = (status == FlowStatus.ARRIVED) | (status == FlowStatus.STATIONARY)
        end, taken = follow(field, points, jnp.where(going, whole / samples, 0.0), max_steps - steps)
        gone = gone + jnp.where(going, end.time, 0.0)
        status = jnp.where(going, end.status, status)
        return (end.points, gone, status, steps + taken), (end.points, gone)

    zero = jnp.zeros((), jnp.int32)
    first = (start, jnp.zeros_like(whole), jnp.full(whole.shape, FlowStatus.ARRIVED, jnp.int32), zero)
    (_, _, status, _), (path, gone) = jax.lax.scan(ahead, first, None, length=samples)
    points, times = jax.tree.map(
        lambda at_start, later: jnp.moveaxis(jnp.concatenate([at_start[None], later]), 0, 1),
        (start, first[1]),
        (path, gone),
    )
    return IntegralCurves(points, surface_positions(mesh, points), times, status)
