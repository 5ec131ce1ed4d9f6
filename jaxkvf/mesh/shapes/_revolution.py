"""Surfaces of revolution around the z axis."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from ...arguments import Integer, Real, checked_integer, checked_positive
from .._triangle_mesh import TriangleMesh
from ._checks import check_ascending
from ._rings import counts_for_spacing, rings_around_axis

_ROW_OF_EQUILATERALS = math.sqrt(3) / 2
_POLE = 1e-9  # a radius this small, relative to the largest, is 0

Coordinate = Callable[[Float[np.ndarray, " t"]], Float[np.ndarray, " t"]]

# r and z of the meridian of a vase, from the middle of its foot to the bottom of its mouth.
_VASE = np.array(
    [
        (0.00, 0.00), (0.25, 0.00), (0.42, 0.03), (0.44, 0.10), (0.34, 0.20), (0.40, 0.36), (0.66, 0.72),
        (0.80, 1.12), (0.70, 1.52), (0.44, 1.84), (0.30, 2.08), (0.30, 2.28), (0.42, 2.46), (0.48, 2.54),
        (0.44, 2.61), (0.34, 2.56), (0.21, 2.36), (0.10, 2.26), (0.00, 2.24),
    ]
)  # fmt: skip


def surface_of_revolution(
    r: Coordinate,
    z: Coordinate,
    n_along: Integer,
    n_around: Integer | None = None,
    interval: tuple[Real, Real] = (0.0, math.pi),
) -> TriangleMesh:
    """The meridian (r(t), z(t)) turned around the z axis.

    Rings of vertices stand at nearly equal arc length along the meridian. A meridian that starts or ends on the axis
    is closed there by a single vertex; one that ends where it starts makes a torus; any other end is a boundary loop.
    Faces are counter-clockwise seen from outside.

    Args:
        r: distance from the axis as a function of the parameter, vectorised, ≥ 0; 0 only at the ends.
        z: height as a function of the parameter, vectorised.
        n_along: steps along the meridian, ≥ 3.
        n_around: vertices on each ring, ≥ 3: then a turn by 2π / n_around maps the mesh to itself. If None, each ring
            has as many, and at least six, as make triangles nearly equilateral.
        interval: of the parameter, start and end.

    Raises:
        ValueError: an argument out of range, or a meridian that is not finite, has no length, or meets the axis other
            than at its ends.
    """
    n_along = checked_integer("n_along", n_along, 3)
    t = _equal_steps(r, z, n_along, interval)
    radii, heights = _evaluate(r, z, t)
    size = max(radii.max(), np.ptp(heights))
    is_pole = radii <= _POLE * size
    if is_pole[1:-1].any():
        at = float(t[1:-1][is_pole[1:-1]][0])
        raise ValueError(f"r must be positive except at the ends of the interval; it is not at t = {at!r}")
    radii = np.where(is_pole, 0.0, radii)
    ends_where_it_starts = math.hypot(radii[-1] - radii[0], heights[-1] - heights[0]) <= _POLE * size
    periodic = ends_where_it_starts and radii[0] > 0
    spacing = np.hypot(np.diff(radii), np.diff(heights)).mean() / _ROW_OF_EQUILATERALS
    if periodic:
        radii, heights = radii[:-1], heights[:-1]
    if n_around is None:
        counts = counts_for_spacing(radii, spacing)
    else:
        n_around = checked_integer("n_around", n_around, 3)
        counts = np.where(radii == 0, 1, n_around)
    return TriangleMesh.from_arrays(*rings_around_axis(radii, heights, counts, periodic=bool(periodic)))


def torus(
    n_major: Integer, n_minor: Integer, major_radius: Real = 2.0, minor_radius: Real = 1.0
) -> TriangleMesh:
    """A torus around the z axis; a turn by 2π / n_major maps the mesh to itself.

    Args:
        n_major: vertices on each circle around the axis, ≥ 3.
        n_minor: such circles, ≥ 3; an even number lets every other one be turned by half a step.
        major_radius: of the circle that the tube is laid along, in the unit of length.
        minor_radius: of the tube, smaller.

    Raises:
        ValueError: an argument out of range.
    """
    n_major = checked_integer("n_major", n_major, 3)
    n_minor = checked_integer("n_minor", n_minor, 3)
    check_ascending("minor_radius", minor_radius, "major_radius", major_radius)
    angle = 2 * np.pi * np.arange(n_minor) / n_minor
    radii, heights = major_radius + minor_radius * np.cos(angle), minor_radius * np.sin(angle)
    counts = np.full(n_minor, n_major)
    return TriangleMesh.from_arrays(*rings_around_axis(radii, heights, counts, periodic=True))


def spherical_band(
    n_around: Integer,
    n_along: Integer | None = None,
    latitudes: tuple[Real, Real] = (-0.5, 0.5),
    radius: Real = 1.0,
) -> TriangleMesh:
    """The part of a sphere between two parallels; two boundary loops. A turn by 2π / n_around maps the mesh to itself.

    Args:
        n_around: vertices on each parallel, ≥ 3.
        n_along: steps from south to north, ≥ 1; if None, as many as make triangles at the equator nearly equilateral.
        latitudes: of the boundary, in radians, −π/2 < south < north < π/2.
        radius: of the sphere, in the unit of length.

    Raises:
        ValueError: an argument out of range.
    """
    n_around = checked_integer("n_around", n_around, 3)
    radius = checked_positive("radius", radius)
    south, north = latitudes
    if not -math.pi / 2 < south < north < math.pi / 2:
        raise ValueError(f"latitudes must hold −π/2 < south < north < π/2, got {latitudes!r}")
    if n_along is None:
        n_along = max(1, round((north - south) * n_around / (2 * math.pi * _ROW_OF_EQUILATERALS)))
    n_along = checked_integer("n_along", n_along, 1)
    latitude = np.linspace(south, north, n_along + 1)
    counts = np.full(n_along + 1, n_around)
    return TriangleMesh.from_arrays(
        *rings_around_axis(radius * np.cos(latitude), radius * np.sin(latitude), counts)
    )


def vase(n_along: Integer = 64) -> TriangleMesh:
    """A vase with foot, belly, neck and lip, its mouth closed: a smooth closed surface of revolution, 2.6 units high.

    Args:
        n_along: steps along the meridian, ≥ 3; the default makes about 2,500 vertices.

    Raises:
        ValueError: `n_along` out of range.
    """
    lengths = np.linalg.norm(np.diff(_VASE, axis=0), axis=1)
    knots = np.concatenate([[0.0], np.cumsum(lengths)])
    # The meridian meets the axis at right angles: first derivatives (r', z') = (1, 0) and (−1, 0).
    ends: Any = ((1, np.array([1.0, 0.0])), (1, np.array([-1.0, 0.0])))
    curve = CubicSpline(knots, _VASE, bc_type=ends)
    return surface_of_revolution(
        lambda t: curve(t)[:, 0], lambda t: curve(t)[:, 1], n_along, interval=(0.0, float(knots[-1]))
    )


def squashed_cone(squash: Real, n_along: Integer = 48) -> TriangleMesh:
    """The paper's Fig. 8: the cone (a h cos θ, h, h sin θ), 0 ≤ h ≤ 1, closed by a flat elliptic cap at h = 1.

    Meshes of different `squash` have the same connectivity: they are the perfect cone (a = 1) scaled along x.

    Args:
        squash: a, the semi-axis of the cap along x; the other one is 1.
        n_along: steps along the meridian from apex to rim to the middle of the cap, ≥ 6.

    Raises:
        ValueError: an argument out of range.
    """
    squash = checked_positive("squash", squash)
    n_along = checked_integer("n_along", n_along, 6)
    n_cap = round(n_along / (1 + math.sqrt(2)))
    radii = np.concatenate([np.linspace(0, 1, n_along - n_cap + 1), np.linspace(1, 0, n_cap + 1)[1:]])
    heights = np.minimum(np.concatenate([radii[: n_along - n_cap + 1], np.ones(n_cap)]), 1.0)
    counts = counts_for_spacing(radii, 1 / n_cap / _ROW_OF_EQUILATERALS)
    vertices, faces = rings_around_axis(radii, heights, counts)
    x, y, z = vertices.T
    return TriangleMesh.from_arrays(np.stack([squash * x, z, y], axis=1), faces[:, ::-1])


def _equal_steps(
    r: Coordinate, z: Coordinate, n_along: Integer, interval: tuple[Real, Real]
) -> Float[np.ndarray, " t"]:
    """Parameters at nearly equal arc length, from the lengths of a fine polygon."""
    start, end = interval
    if not (math.isfinite(start) and math.isfinite(end) and start < end):
        raise ValueError(f"interval must be finite with start < end, got {interval!r}")
    fine = np.linspace(start, end, 32 * n_along + 1)
    radii, heights = _evaluate(r, z, fine)
    if radii.min() < -_POLE * np.abs(radii).max():
        raise ValueError(f"r must not be negative; it is at t = {float(fine[radii.argmin()])!r}")
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(radii), np.diff(heights)))])
    if not length[-1] > 0:
        raise ValueError("the meridian has no length")
    t = np.interp(np.linspace(0, length[-1], n_along + 1), length, fine)
    t[0], t[-1] = start, end
    return t


def _evaluate(
    r: Coordinate, z: Coordinate, t: Float[np.ndarray, " t"]
) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
    values = []
    for name, function in (("r", r), ("z", z)):
        value = np.broadcast_to(np.asarray(function(t), np.float64), t.shape)
        if not np.isfinite(value).all():
            raise ValueError(f"{name} is not finite at t = {float(t[~np.isfinite(value)][0])!r}")
        values.append(value)
    return values[0], values[1]
