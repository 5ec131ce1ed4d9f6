"""The period of a flow whose integral curves close, and the discrete groups in it: §4 of the paper."""

import warnings
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from ..arguments import Integer, checked_integer
from ..geometry import SurfacePoints, barycentric_vertex_areas, edge_lengths, surface_positions, vertex_points
from ..host import check_on_host
from ..mesh import TriangleMesh
from ._checked import (
    checked_field,
    checked_points,
    checked_steps,
    checked_times,
)
from ._face_fields import FaceField, tracing_field
from ._flow import follow
from ._returns import first_returns

_SLOW = 0.3
"""Share of the largest speed below which curves are too close to a singular point to tell the period well."""
_HORIZON = 4.0
"""How far curves are followed before giving up: times the equator of the sphere of the component's area, or π times its
extent, whichever is longer."""
_CLOSED = 0.05


class NoPeriodError(ValueError):
    """No integral curve closes."""

    def __init__(self, curves: int, time: float, component: int, components: int) -> None:
        self.component = component
        where = f" on component {component}" if components > 1 else ""
        self.what = f"the field has no period: none of {curves} integral curves{where} closes within a time of {time:.4g}"
        super().__init__(
            f"{self.what}; take the field of a smaller λ, or, of fields of equal λ, the combination that "
            "jaxkvf.flows.closed_field finds"
        )


class Period(eqx.Module):
    """The time after which integral curves come back to where they started."""

    period: float
    """T, the median over the curves that closed. Unit: time."""
    spread: float
    """Half the distance between the quartiles of the curves' own periods, relative to T; 0 for an exact Killing field."""
    component: int
    """The connected component that T is of (`Topology.components`): that with the largest ∫|U|."""
    periods: Float[np.ndarray, " c"]
    """When each curve comes back across the plane normal to it through its start; NaN if it does not. Unit: time."""
    lengths: Float[np.ndarray, " c"]
    """Length of each curve until then: the T of a Killing field is length / speed. Unit: length."""
    gaps: Float[np.ndarray, " c"]
    """How far from its start each curve comes back, relative to its length; 0 is closed."""
    closed: Bool[np.ndarray, " c"]
    """Which curves come back within 5 % of their length."""
    vertices: Int[np.ndarray, " c"]
    """Where the curves start."""
    components: Int[np.ndarray, " c"]
    """The component that each is on."""


def period(
    mesh: TriangleMesh,
    vectors: ArrayLike,
    *,
    curves: Integer = 64,
    seed: int = 0,
    max_steps: Integer | None = None,
) -> Period:
    """T with φᵀ = id (§4: L(γ)/‖U‖ is the same for all integral curves γ of a Killing field), from many curves.

    Curves are followed from face to face, and on each connected component for itself. On the host.

    Args:
        mesh: the surface.
        vectors: `[V, 3]`, tangent vectors at the vertices. Unit: length / time.
        curves: how many, from vertices drawn with `seed` where the field is not slow; shared out among the components by
            ∫|U| on each.
        seed: of `numpy.random.default_rng`.
        max_steps: most steps from face to face on each curve; default as in `flow`.

    Raises:
        NoPeriodError: no curve closes; a `ValueError`.
        ValueError: `curves` < 1; a field as in `flow`.

    Warns:
        UserWarning: curves that count as closed come back more than a mean edge from where they started.
    """
    check_on_host("period", mesh, vectors)
    curves = checked_integer("curves", curves)
    field = checked_field(mesh, vectors)
    limit = checked_steps(max_steps, mesh.topology)
    components = _Components(mesh, np.asarray(field, np.float64))
    chosen, owner = components.starts(curves, np.random.default_rng(seed))
    horizon = components.horizons[owner]
    found = first_returns(mesh, field, vertex_points(mesh, chosen), jnp.asarray(horizon, field.dtype), limit)
    periods, lengths, misses = (np.asarray(part, np.float64) for part in found)
    gaps = misses / lengths
    closed = np.nan_to_num(gaps, nan=np.inf) <= _CLOSED
    here = closed & (owner == owner[0])
    if not here.any():
        followed = int((owner == owner[0]).sum())
        raise NoPeriodError(followed, float(horizon[0]), int(owner[0]), components.count)
    _warn_of_misses(misses[here], components.mean_edge(int(owner[0])))
    low, middle, high = np.quantile(periods[here], (0.25, 0.5, 0.75))
    spread = float((high - low) / 2 / middle)
    return Period(float(middle), spread, int(owner[0]), periods, lengths, gaps, closed, chosen, owner)


def _warn_of_misses(misses: Float[np.ndarray, " c"], edge: float) -> None:
    if misses.max() > edge:
        warnings.warn(
            f"{int((misses > edge).sum())} of {len(misses)} integral curves that count as closed miss their start by more "
            f"than a mean edge, up to {misses.max() / edge:.3g}: the flow after a period is not the identity",
            stacklevel=3,
        )


class _Components:
    """A field on each connected component of a surface."""

    def __init__(self, mesh: TriangleMesh, field: Float[np.ndarray, "V 3"]) -> None:
        topology = mesh.topology
        self.mesh = mesh
        self.count, self.label = topology.components()
        x = np.asarray(mesh.vertices, np.float64)
        lengths = edge_lengths(mesh.vertices, topology)
        share = np.asarray(barycentric_vertex_areas(lengths, topology), np.float64)
        self._lengths = np.asarray(lengths, np.float64)
        self._speed = np.linalg.norm(field, axis=1)
        most, self._total = np.zeros(self.count), np.zeros(self.count)
        np.maximum.at(most, self.label, self._speed)
        np.add.at(self._total, self.label, share * self._speed)
        self._fast = self._speed > _SLOW * most[self.label]
        low, high = np.full((self.count, 3), np.inf), np.full((self.count, 3), -np.inf)
        np.minimum.at(low, self.label, x)
        np.maximum.at(high, self.label, x)
        area = np.bincount(self.label, share, self.count)
        around = np.maximum(2 * np.sqrt(np.pi * area), np.pi * np.linalg.norm(high - low, axis=1))
        mean_speed = np.bincount(self.label, self._fast * self._speed, self.count) / np.maximum(
            np.bincount(self.label, self._fast, self.count), 1
        )
        self.horizons = _HORIZON * around / np.where(mean_speed > 0, mean_speed, np.inf)

    def starts(
        self, curves: int, rng: np.random.Generator
    ) -> tuple[Int[np.ndarray, " c"], Int[np.ndarray, " c"]]:
        """Vertices where the field is not slow, and their components, that with the largest ∫|U| first."""
        order = np.argsort(-self._total, kind="stable")
        wanted = curves * self._total[order] / self._total.sum()
        each = np.floor(wanted).astype(int)
        each[0] += curves - each.sum()  # what is left over by rounding belongs to the first
        chosen = []
        for component, count in zip(order[each > 0], each[each > 0], strict=True):
            fast = np.flatnonzero(self._fast & (self.label == component))
            chosen.append(rng.choice(fast, count, replace=len(fast) < count))
        vertices = np.concatenate(chosen)
        return vertices, self.label[vertices].astype(np.int64)

    def mean_edge(self, component: int) -> float:
        """Mean edge length of a component."""
        here = self.label[np.asarray(self.mesh.topology.edges)[:, 0]] == component
        return float(self._lengths[here].mean())


class Orbit(eqx.Module):
    """Images of points under the discrete group {φ^q, φ^2q, …, φ^mq = id}, q = T/m."""

    points: SurfacePoints
    """`[m, N]`. Row j: φ^jq, j = 0…m−1."""
    closure: Float[Array, " N"]
    """Distance in space between each point and its φ^mq. Unit: length."""


def orbit(
    mesh: TriangleMesh,
    vectors: ArrayLike,
    m: Integer,
    points: SurfacePoints,
    *,
    period: ArrayLike | None = None,
    max_steps: Integer | None = None,
) -> Orbit:
    """The images of points under the cyclic group of order m that the flow over T/m generates (§4).

    Args:
        mesh: the surface.
        vectors: `[V, 3]`, tangent vectors at the vertices. Unit: length / time.
        m: order of the group, ≥ 1.
        points: `[N]` points.
        period: T; by default `period(mesh, vectors).period`, on the host.
        max_steps: most steps from face to face from each image to the next; default as in `flow`.

    Raises:
        ValueError: m < 1; arguments as in `flow` and `period`.
    """
    m = checked_integer("m", m)
    field = checked_field(mesh, vectors)
    start = checked_points(mesh, points)
    whole = _period_of(mesh, vectors) if period is None else period
    times = checked_times(whole, start) / m
    limit = checked_steps(max_steps, mesh.topology)
    return _orbit(mesh, tracing_field(mesh, field), times, start, max_steps=limit, m=m)


def _period_of(mesh: TriangleMesh, vectors: ArrayLike) -> float:
    return period(mesh, vectors).period


@partial(jax.jit, static_argnames="m")
def _orbit(
    mesh: TriangleMesh,
    field: FaceField,
    times: Float[Array, " N"],
    start: SurfacePoints,
    *,
    max_steps: int | Int[Array, ""],
    m: int,
) -> Orbit:

    def turned(points: SurfacePoints, _: None) -> tuple[SurfacePoints, SurfacePoints]:
        return follow(field, points, times, max_steps)[0].points, points

    last, images = jax.lax.scan(turned, start, None, length=m)
    gap = surface_positions(mesh, last) - surface_positions(mesh, start)
    return Orbit(images, jnp.linalg.norm(gap, axis=1))
