"""Integral curves as polylines with time stamps."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from ..mesh import TriangleMesh
from ._flow import FlowStatus, checked_points, checked_times, follow, tracing_field
from ._period import check_at_least_one
from ._points import SurfacePoints, surface_positions


class IntegralCurves(NamedTuple):
    """Polylines on the surface: point i of curve n is where the tracer n is at time `times[n, i]`."""

    positions: Float[np.ndarray, "N k 3"]
    """Unit: length."""
    times: Float[np.ndarray, "N k"]
    """Equal steps from 0 to t; where a tracer left the surface, the time at which it did, from then on. Unit: time."""
    faces: Int[np.ndarray, "N k"]
    barycentric: Float[np.ndarray, "N k 3"]
    status: Int[np.ndarray, " N"]
    """`FlowStatus` of each tracer at the end."""

    def polylines(self) -> list[Float[np.ndarray, "_ 3"]]:
        """The positions of each curve, those after it left the surface taken away."""
        ends = [1 + int(np.argmax(np.abs(times))) for times in self.times]
        return [x[:end] for x, end in zip(self.positions, ends, strict=True)]


def integral_curves(
    mesh: TriangleMesh,
    vectors: ArrayLike,
    t: ArrayLike,
    faces: ArrayLike,
    barycentric: ArrayLike,
    *,
    samples: int = 200,
) -> IntegralCurves:
    """The curves t ↦ φᵗ(p), followed exactly (see `flow`) and sampled at equal times.

    Args:
        mesh: the surface.
        vectors: `[V, 3]`, tangent vectors at the vertices. Unit: length / time.
        t: time to go, one for all or `[N]`, one a curve; negative: backwards.
        faces: `[N]`, face of each starting point.
        barycentric: `[N, 3]`, its barycentric coordinates there.
        samples: number of steps, ≥ 1; each curve has one point more.

    Raises:
        ValueError: `samples` < 1; otherwise as for `flow`.
    """
    check_at_least_one("samples", samples)
    field = tracing_field(mesh, vectors)
    points = checked_points(mesh, faces, barycentric)
    whole = checked_times(t, points)
    step = whole / samples
    path, times = [points], [jnp.zeros_like(whole)]
    left: Bool[Array, " N"] = jnp.zeros(whole.shape, bool)
    status = jnp.full(whole.shape, FlowStatus.ARRIVED, jnp.int32)
    for _ in range(samples):
        end = follow(field, path[-1], jnp.where(left, 0.0, step))
        status = jnp.where(left, status, end.status)
        times.append(times[-1] + jnp.where(left, 0.0, end.time))
        left = left | (end.status == FlowStatus.LEFT)
        path.append(end.points)
    at = SurfacePoints(*(jnp.stack(part) for part in zip(*path, strict=True)))
    positions = np.stack([np.asarray(surface_positions(mesh, p)) for p in path], axis=1)
    faces_, b = np.asarray(at.faces).T, np.moveaxis(np.asarray(at.barycentric), 1, 0)
    return IntegralCurves(
        positions, np.stack([np.asarray(s) for s in times], axis=1), faces_, b, np.asarray(status)
    )
