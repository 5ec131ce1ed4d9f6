"""The period of a flow whose integral curves close, and the discrete groups in it: §4 of the paper."""

import operator
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from ..geometry import edge_lengths, mean_edge_length, surface_area
from ..mesh import TriangleMesh
from ._flow import TracingField, checked_field, checked_points, follow, tracing_field
from ._points import SurfacePoints, surface_positions, vertex_points

_SLOW = 0.3
"""Share of the largest speed below which curves are too close to a singular point to tell the period well."""
_HORIZON = 8.0
"""How long curves are followed before giving up, in times that the mean speed needs for 2 √(π area), a sphere's equator."""
_NEAR = 0.25
_CLOSED = 0.05


class Period(NamedTuple):
    """The time after which integral curves come back to where they started."""

    time: float
    """T, the median over the curves that closed. Unit: time."""
    spread: float
    """Half the distance between the quartiles of the curves' own periods, relative to T; 0 for an exact Killing field."""
    times: Float[np.ndarray, " c"]
    """When each curve comes back across the plane normal to it through its start; NaN if it does not. Unit: time."""
    lengths: Float[np.ndarray, " c"]
    """Length of each curve until then: the T of a Killing field is length / speed. Unit: length."""
    gaps: Float[np.ndarray, " c"]
    """How far from its start each curve comes back, relative to its length; 0 is closed."""
    closed: Bool[np.ndarray, " c"]
    """Which curves come back within 5 % of their length."""
    vertices: Int[np.ndarray, " c"]
    """Where the curves start."""


def period(mesh: TriangleMesh, vectors: ArrayLike, *, curves: int = 64, seed: int = 0) -> Period:
    """T with φᵀ = id (§4: L(γ)/‖U‖ is the same for all integral curves γ of a Killing field), from many curves.

    Args:
        mesh: the surface.
        vectors: `[V, 3]`, tangent vectors at the vertices. Unit: length / time.
        curves: how many, from vertices drawn with `seed` where the field is not slow.
        seed: of `numpy.random.default_rng`.

    Raises:
        ValueError: `curves` < 1; no curve closes; a field as in `flow`.
    """
    check_at_least_one("curves", curves)
    field = tracing_field(mesh, vectors)
    u = np.asarray(checked_field(mesh, vectors))
    speed = np.linalg.norm(u, axis=1)
    fast = np.flatnonzero(speed > _SLOW * speed.max())
    chosen = np.random.default_rng(seed).choice(fast, curves, replace=len(fast) < curves)
    start = vertex_points(mesh.topology, chosen)

    lengths = edge_lengths(mesh.vertices, mesh.topology)
    step = 2 * float(mean_edge_length(lengths)) / speed.max()
    equator = 2 * np.sqrt(np.pi * float(surface_area(lengths, mesh.topology)))
    horizon = _HORIZON * equator / speed[chosen].mean()
    times, travelled = _first_returns(mesh, u, field, start, step=step, horizon=horizon)
    gaps = np.full(curves, np.nan)
    back = np.isfinite(times)
    if back.any():
        times = _refined(mesh, u, field, start, times)
        origin, there = (np.asarray(surface_positions(mesh, p)) for p in (start, _after(field, start, times)))
        gaps[back] = np.linalg.norm((there - origin)[back], axis=1) / travelled[back]
    closed = back & (gaps <= _CLOSED)
    if not closed.any():
        raise ValueError(
            f"the field has no period: none of {curves} integral curves closes within a time of {horizon:.4g}; "
            "take the field of a smaller λ, or a linear combination of fields of equal λ"
        )
    low, middle, high = np.quantile(times[closed], (0.25, 0.5, 0.75))
    return Period(
        float(middle), float((high - low) / 2 / middle), times, travelled, gaps, closed, np.asarray(chosen)
    )


def _after(field: TracingField, start: SurfacePoints, times: Float[np.ndarray, " c"]) -> SurfacePoints:
    return follow(field, start, jnp.asarray(np.nan_to_num(times), start.barycentric.dtype)).points


def _across_start(
    mesh: TriangleMesh, u: Float[np.ndarray, "V 3"], start: SurfacePoints, now: SurfacePoints
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """How far each point is beyond the plane through its start normal to the field there, how fast it goes on from it, and
    how far it is from the start."""
    faces = np.asarray(mesh.faces)

    def field_at(points: SurfacePoints) -> Float[np.ndarray, "c 3"]:
        return np.einsum("nc,ncx->nx", np.asarray(points.barycentric), u[faces[np.asarray(points.faces)]])

    normal = field_at(start)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    offset = np.asarray(surface_positions(mesh, now)) - np.asarray(surface_positions(mesh, start))
    beyond, rate = (offset * normal).sum(axis=1), (field_at(now) * normal).sum(axis=1)
    return beyond, rate, np.linalg.norm(offset, axis=1)


def _first_returns(
    mesh: TriangleMesh,
    u: Float[np.ndarray, "V 3"],
    field: TracingField,
    start: SurfacePoints,
    *,
    step: float,
    horizon: float,
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """When each curve first comes back across the plane at its start and close to it, to first order, and its length."""
    n = len(start.faces)
    returned, length, furthest, before = np.full(n, np.nan), np.zeros(n), np.zeros(n), np.zeros(n)
    now, where = start, np.asarray(surface_positions(mesh, start))
    ahead = jnp.full(n, step, start.barycentric.dtype)
    for i in range(1, int(np.ceil(horizon / step)) + 1):
        now = follow(field, now, ahead).points
        here = np.asarray(surface_positions(mesh, now))
        going = np.isnan(returned)
        length = length + np.where(going, np.linalg.norm(here - where, axis=1), 0)
        beyond, rate, distance = _across_start(mesh, u, start, now)
        furthest = np.maximum(furthest, distance)
        back = going & (before < 0) & (beyond >= 0) & (rate > 0) & (distance < _NEAR * furthest)
        overshoot = np.where(back, beyond / np.where(rate > 0, rate, 1.0), 0)
        returned = np.where(back, i * step - overshoot, returned)
        length = length - np.where(back, overshoot * np.linalg.norm(here - where, axis=1) / step, 0)
        if not np.isnan(returned).any():
            break
        before, where = beyond, here
    return returned, length


def _refined(
    mesh: TriangleMesh,
    u: Float[np.ndarray, "V 3"],
    field: TracingField,
    start: SurfacePoints,
    times: Float[np.ndarray, " c"],
) -> Float[np.ndarray, " c"]:
    """The times at which the plane is crossed exactly, by Newton."""
    for _ in range(3):
        beyond, rate, _ = _across_start(mesh, u, start, _after(field, start, times))
        times = times - beyond / np.where(np.isnan(times), 1.0, rate)
    return times


class Orbit(NamedTuple):
    """Images of points under the discrete group {φ^q, φ^2q, …, φ^mq = id}, q = T/m."""

    faces: Int[Array, "m N"]
    """Row j: φ^jq, j = 0…m−1."""
    barycentric: Float[Array, "m N 3"]
    closure: Float[Array, " N"]
    """Distance in space between each point and its φ^mq. Unit: length."""


def orbit(
    mesh: TriangleMesh,
    vectors: ArrayLike,
    m: int,
    faces: ArrayLike,
    barycentric: ArrayLike,
    *,
    time: float | None = None,
) -> Orbit:
    """The images of points under the cyclic group of order m that the flow over T/m generates (§4).

    Args:
        mesh: the surface.
        vectors: `[V, 3]`, tangent vectors at the vertices. Unit: length / time.
        m: order of the group, ≥ 1.
        faces: `[N]`, face of each point.
        barycentric: `[N, 3]`, its barycentric coordinates there.
        time: the period T; by default `period(mesh, vectors).time`.

    Raises:
        ValueError: m < 1; arguments as in `flow` and `period`.
    """
    check_at_least_one("m", m)
    field = tracing_field(mesh, vectors)
    start = checked_points(mesh, faces, barycentric)
    whole = period(mesh, vectors).time if time is None else time
    step = jnp.full(len(start.faces), whole / m, start.barycentric.dtype)
    images = [start]
    for _ in range(m):
        images.append(follow(field, images[-1], step).points)
    *images, last = images
    gap = surface_positions(mesh, last) - surface_positions(mesh, start)
    return Orbit(
        jnp.stack([p.faces for p in images]),
        jnp.stack([p.barycentric for p in images]),
        jnp.linalg.norm(gap, axis=1),
    )


def check_at_least_one(name: str, value: int) -> None:
    """Raises `ValueError` unless `value` is an integer of at least 1."""
    try:
        fits = operator.index(value) >= 1
    except TypeError:
        fits = False
    if not fits:
        raise ValueError(f"{name} must be an integer of at least 1, got {value!r}")
