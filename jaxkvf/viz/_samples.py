"""Points spread evenly over a surface."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

CANDIDATES_PER_POINT = 16
SIDE_DISTANCE = 1.5
"""How far apart, in mean distances between points, two points count whose normals are opposite."""


@dataclasses.dataclass(frozen=True)
class Samples:
    """Points on a surface: the face of each, its barycentric coordinates there, and the mean distance."""

    faces: Int[np.ndarray, "N"]
    weights: Float[np.ndarray, "N 3"]
    spacing: float


def spread_evenly(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], count: int) -> Samples:
    """`count` points spread evenly over a surface, however uneven its triangles; the same ones every time.

    Where flow lines may start: `integral_curves(mesh, field, t, at.faces, at.weights)`.

    Farthest-point sampling among random points of uniform density (fixed seed). Opposite normals count as
    distance, so that the two sides of a thin wing each get their points.
    """
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled_areas = np.linalg.norm(normals, axis=1)
    total = doubled_areas.sum()
    if count == 0 or total == 0:
        return Samples(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), 0.0)
    spacing = float(np.sqrt(total / 2 / count))
    owner, weights = _candidates(doubled_areas / total, CANDIDATES_PER_POINT * count)
    places = np.einsum("nc,ncx->nx", weights, corners[owner])
    sides = normals[owner] / doubled_areas[owner][:, None]
    chosen = np.zeros(count, dtype=np.int64)
    nearest = np.full(len(places), np.inf)
    for i in range(1, count):
        last = chosen[i - 1]
        opposed = np.maximum(-(sides @ sides[last]), 0.0)
        squared = ((places - places[last]) ** 2).sum(axis=1) + (SIDE_DISTANCE * spacing) ** 2 * opposed
        nearest = np.minimum(nearest, squared)
        chosen[i] = np.argmax(nearest)
    return Samples(owner[chosen], weights[chosen], spacing)


def _candidates(
    shares: Float[np.ndarray, "F"], count: int
) -> tuple[Int[np.ndarray, "N"], Float[np.ndarray, "N 3"]]:
    """One random point in each of `count` equal shares of the area: faces and barycentric coordinates."""
    rng = np.random.default_rng(0)
    occupied = np.flatnonzero(shares > 0)
    ends = np.cumsum(shares[occupied])
    at = (np.arange(count) + rng.random(count)) / count
    owner = occupied[np.minimum(np.searchsorted(ends, at), len(occupied) - 1)]
    root, fraction = np.sqrt(rng.random(count)), rng.random(count)
    return owner, np.stack([1 - root, root * (1 - fraction), root * fraction], axis=1)
