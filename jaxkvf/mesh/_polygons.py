"""Faces of any number of corners, and how they become triangles."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

_GOOD = 0.02  # twice the area over the square of the longest side: a fan of such triangles is good enough


class Polygons(NamedTuple):
    """The corners of faces, one face after the other."""

    corners: Int[np.ndarray, " C"]
    sizes: Int[np.ndarray, " F"]
    """Number of corners of each face."""

    @classmethod
    def of_rows(cls, rows: Int[np.ndarray, "F n"]) -> "Polygons":
        return cls(rows.ravel(), np.full(len(rows), rows.shape[1]))

    @property
    def starts(self) -> Int[np.ndarray, " F"]:
        return np.cumsum(self.sizes) - self.sizes


class Triangles(NamedTuple):
    """Triangles that polygons were cut into."""

    faces: Int[np.ndarray, "F 3"]
    corner_origins: Int[np.ndarray, "F 3"]
    """Which of all corners of the polygons each corner was."""
    face_origins: Int[np.ndarray, " F"]
    """Polygon that each triangle was a part of."""


def triangulated(vertices: Float[np.ndarray, "V 3"], polygons: Polygons) -> Triangles:
    """Cuts polygons along diagonals. A face of two corners or one becomes a triangle that repeats a corner.

    Where the triangles around one corner of a polygon all look its way and none is thin, they are taken, around the corner
    where the thinnest is thickest; otherwise ears are cut off, the thickest first (G. Meisters 1975).
    """
    starts = polygons.starts
    corners, faces = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    for n in np.unique(polygons.sizes[polygons.sizes > 0]).tolist():
        which = np.flatnonzero(polygons.sizes == n)
        if n <= 3:
            cuts = np.broadcast_to(np.minimum(np.arange(3), n - 1), (len(which), 1, 3))
        else:
            cuts = _cuts(_unit(vertices, polygons.corners[starts[which, None] + np.arange(n)]))
        corners.append((starts[which, None, None] + cuts).reshape(-1, 3))
        faces.append(np.repeat(which, cuts.shape[1]))
    order = np.argsort(np.concatenate(faces), kind="stable")
    corner_origins = np.concatenate(corners)[order]
    return Triangles(polygons.corners[corner_origins], corner_origins, np.concatenate(faces)[order])


def _unit(vertices: Float[np.ndarray, "V 3"], rows: Int[np.ndarray, "m n"]) -> Float[np.ndarray, "m n 3"]:
    """Positions of the corners, of size 1, from the first corner; corners that are none lie there."""
    inside = (rows >= 0) & (rows < len(vertices))
    x = vertices[np.where(inside, rows, 0)].astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        x -= x[:, :1].copy()
        scale = np.abs(x).max(axis=(1, 2), keepdims=True)
        x /= np.where((scale > 0) & (scale < np.inf), scale, 1.0)
    return np.where(inside[..., None] & np.isfinite(x), x, 0.0)


def _cuts(x: Float[np.ndarray, "m n 3"]) -> Int[np.ndarray, "m t 3"]:
    """Corners of the n − 2 triangles of each polygon."""
    m, n = x.shape[:2]
    normal = np.cross(x, np.roll(x, -1, axis=1)).sum(axis=1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal /= np.where(length > 0, length, 1.0)
    ring = np.arange(1, n - 1)
    fan = np.stack([np.zeros_like(ring), ring, ring + 1], axis=1)
    worst = np.stack([_thickness(x, normal, (fan + start) % n).min(axis=1) for start in range(n)], axis=1)
    best = worst.argmax(axis=1)
    cuts = (fan[None] + best[:, None, None]) % n
    if n > 4:
        for i in np.flatnonzero(worst[np.arange(m), best] < _GOOD):
            cuts[i] = _ears(x[i], normal[i])
    return cuts


def _thickness(
    x: Float[np.ndarray, "m n 3"], normal: Float[np.ndarray, "m 3"], cuts: Int[np.ndarray, "t 3"]
) -> Float[np.ndarray, "m t"]:
    """Twice the area over the square of the longest side; negative for triangles that look the other way."""
    a, b, c = (x[:, cuts[:, i]] for i in range(3))
    area = (np.cross(b - a, c - a) * normal[:, None]).sum(axis=2)
    longest = np.maximum.reduce([((p - q) ** 2).sum(axis=2) for p, q in ((a, b), (b, c), (c, a))])
    return area / np.where(longest > 0, longest, 1.0)


def _ears(x: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "3"]) -> Int[np.ndarray, "t 3"]:
    """Cuts off the thickest corner whose triangle holds no other corner, until a triangle is left."""
    left = list(range(len(x)))
    thickness = [_ear(x, normal, left, i) for i in range(len(left))]
    cut = []
    while len(left) > 3:
        i = max(range(len(left)), key=thickness.__getitem__)
        cut.append((left[i - 1], left[i], left[(i + 1) % len(left)]))
        del left[i], thickness[i]
        for j in (i - 1, i % len(left)):
            thickness[j] = _ear(x, normal, left, j)
    return np.array([*cut, tuple(left)])


def _ear(x: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "3"], left: list[int], i: int) -> float:
    """How thick the triangle at a corner is; −2 and less where another corner lies in it."""
    a, b, c = (x[left[k % len(left)]] for k in (i - 1, i, i + 1))
    thickness = float(_thickness(np.stack([a, b, c])[None], normal[None], np.array([[0, 1, 2]]))[0, 0])
    if thickness <= 0:
        return thickness - 1
    others = x[[v for v in left if not any((x[v] == p).all() for p in (a, b, c))]]
    inside = np.ones(len(others), bool)
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= np.cross(q - p, others - p) @ normal >= 0
    return thickness - 2 if inside.any() else thickness
