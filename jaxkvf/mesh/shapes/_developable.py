"""Surfaces that are flat inside: disk, annulus, cylinder and cones."""

import math

import numpy as np
from jaxtyping import Float

from ...arguments import Integer, Real, checked_integer, checked_positive
from .._triangle_mesh import TriangleMesh
from ._checks import check_ascending, check_radii
from ._rings import counts_for_spacing, rings_around_axis

_ROW_OF_EQUILATERALS = math.sqrt(3) / 2


def disk(n_rings: Integer, radius: Real = 1.0) -> TriangleMesh:
    """A flat disk at z = 0, seen from above, with 6 k vertices on the k-th ring: 3 n (n + 1) + 1 in all.

    Args:
        n_rings: rings around the middle, ≥ 1.
        radius: of the outer ring, in the unit of length.

    Raises:
        ValueError: an argument out of range.
    """
    n_rings = checked_integer("n_rings", n_rings, 1)
    radius = checked_positive("radius", radius)
    k = np.arange(n_rings + 1)
    counts = np.maximum(6 * k, 1)
    return TriangleMesh.from_arrays(
        *rings_around_axis(radius * k / n_rings, np.zeros(n_rings + 1), counts, staggered=False)
    )


def annulus(n_rings: Integer, inner_radius: Real = 0.5, outer_radius: Real = 1.0) -> TriangleMesh:
    """A flat ring at z = 0, seen from above, of nearly equilateral triangles; two boundary loops.

    Args:
        n_rings: steps from the inner to the outer circle, ≥ 1.
        inner_radius: in the unit of length.
        outer_radius: in the unit of length.

    Raises:
        ValueError: an argument out of range.
    """
    n_rings = checked_integer("n_rings", n_rings, 1)
    check_ascending("inner_radius", inner_radius, "outer_radius", outer_radius)
    radii = np.linspace(inner_radius, outer_radius, n_rings + 1)
    counts = counts_for_spacing(radii, float(outer_radius - inner_radius) / n_rings / _ROW_OF_EQUILATERALS)
    return TriangleMesh.from_arrays(*rings_around_axis(radii, np.zeros(n_rings + 1), counts))


def cylinder(
    n_around: Integer, n_along: Integer | None = None, radius: Real = 1.0, height: Real = 2.0
) -> TriangleMesh:
    """An open cylinder around the z axis, centred at the origin; two boundary loops.

    All triangles of a row are congruent, so that the mesh is exactly flat at inner vertices.

    Args:
        n_around: vertices on each circle, ≥ 3.
        n_along: steps from bottom to top, ≥ 1; if None, as many as make triangles nearly equilateral.
        radius: of the circles, in the unit of length.
        height: from bottom to top, in the unit of length.

    Raises:
        ValueError: an argument out of range.
    """
    n_around = checked_integer("n_around", n_around, 3)
    radius = checked_positive("radius", radius)
    height = checked_positive("height", height)
    if n_along is None:
        edge = 2 * radius * math.sin(math.pi / n_around)
        n_along = max(1, round(height / (edge * _ROW_OF_EQUILATERALS)))
    n_along = checked_integer("n_along", n_along, 1)
    heights = np.linspace(-height / 2, height / 2, n_along + 1)
    counts = np.full(n_along + 1, n_around)
    return TriangleMesh.from_arrays(*rings_around_axis(np.full(n_along + 1, float(radius)), heights, counts))


def cone(
    n_around: Integer,
    n_along: Integer | None = None,
    bottom_radius: Real = 1.0,
    top_radius: Real = 0.4,
    height: Real = 1.0,
) -> TriangleMesh:
    """A circular cone around the z axis with its apex cut off, 0 ≤ z ≤ height; two boundary loops.

    The radii grow in geometric progression, so that all rows of triangles are similar and the mesh is exactly flat at
    inner vertices.

    Args:
        n_around: vertices on each circle, ≥ 3.
        n_along: steps from bottom to top, ≥ 1; if None, as many as make triangles nearly equilateral.
        bottom_radius: at z = 0, in the unit of length.
        top_radius: at z = height; another one.
        height: in the unit of length.

    Raises:
        ValueError: an argument out of range.
    """
    n_around = checked_integer("n_around", n_around, 3)
    check_radii("bottom_radius, top_radius, height", (bottom_radius, top_radius, height), 3)
    if bottom_radius == top_radius:
        raise ValueError(
            f"top_radius must differ from bottom_radius, got {top_radius!r} twice; use `cylinder`"
        )
    if n_along is None:
        slope = abs(bottom_radius - top_radius) / math.hypot(bottom_radius - top_radius, height)
        step = 2 * math.sin(math.pi / n_around) * _ROW_OF_EQUILATERALS * slope  # of log r
        n_along = max(1, round(abs(math.log(top_radius / bottom_radius)) / step))
    n_along = checked_integer("n_along", n_along, 1)
    radii = np.geomspace(bottom_radius, top_radius, n_along + 1)
    heights = height * (radii - bottom_radius) / (top_radius - bottom_radius)
    counts = np.full(n_along + 1, n_around)
    return TriangleMesh.from_arrays(*rings_around_axis(radii, heights, counts))


def elliptic_cone(
    n_around: Integer,
    n_along: Integer | None = None,
    semi_axes: tuple[Real, Real] = (1.0, 0.5),
    distances: tuple[Real, Real] = (0.5, 1.5),
) -> TriangleMesh:
    """A cone over an ellipse with its apex, the origin, cut off: intrinsically a circular one; two boundary loops.

    Vertices stand on generators at equal angles from one to the next, at equal distances from the apex on all of
    them: the mesh is exactly flat at inner vertices, and the intrinsic turn by one generator maps it to itself.

    Args:
        n_around: generators, ≥ 3.
        n_along: steps from the lower to the upper boundary, ≥ 1; if None, as many as make triangles as high as wide.
        semi_axes: of the ellipse in which the cone meets the plane z = 1, along x and y.
        distances: of the two boundary loops from the apex, in the unit of length.

    Raises:
        ValueError: an argument out of range.
    """
    n_around = checked_integer("n_around", n_around, 3)
    check_radii("semi_axes", semi_axes, 2)
    near, far = distances
    check_ascending("distances[0]", near, "distances[1]", far)
    generators = _equiangular_generators(n_around, semi_axes)
    if n_along is None:
        angle = np.linalg.norm(generators[1] - generators[0])
        n_along = max(1, round(math.log(far / near) / math.log1p(float(angle))))
    n_along = checked_integer("n_along", n_along, 1)
    distance = np.geomspace(near, far, n_along + 1)
    _, faces = rings_around_axis(distance, distance, np.full(n_along + 1, n_around), staggered=False)
    vertices = (distance[:, None, None] * generators).reshape(-1, 3)
    return TriangleMesh.from_arrays(vertices, faces)


def _equiangular_generators(n: int, semi_axes: tuple[Real, Real]) -> Float[np.ndarray, "n 3"]:
    """Unit vectors from the apex to the ellipse at z = 1, each at the same angle from the next."""
    a, b = semi_axes

    def generators(t: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t 3"]:
        points = np.stack([a * np.cos(t), b * np.sin(t), np.ones_like(t)], axis=1)
        return points / np.linalg.norm(points, axis=1, keepdims=True)

    t = np.linspace(0, 2 * np.pi, n + 1)
    for _ in range(500):
        chords = np.linalg.norm(np.diff(generators(t), axis=0), axis=1)
        if np.ptp(chords) <= 1e-10 * chords.mean():
            return generators(t[:-1])
        along = np.concatenate([[0.0], np.cumsum(chords)])
        t = np.interp(np.linspace(0, along[-1], n + 1), along, t)
    raise ValueError(
        f"{n} generators cannot be spread evenly over a cone with semi_axes {semi_axes!r}; take more of them, or a less "
        "elongated ellipse"
    )
