"""Points spread evenly over a surface."""

import equinox as eqx
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float, Int, Integer

from ._surface_points import SurfacePoints

_CANDIDATES_PER_POINT = 16
_SIDE_DISTANCE = 1.5
"""How far apart, in mean distances between points, two points count whose normals are opposite."""


class Samples(eqx.Module):
    """Points on a surface, spread over it."""

    faces: Int[np.ndarray, " N"]
    """The face of each."""
    barycentric: Float[np.ndarray, "N 3"]
    """Where in it."""
    spacing: float
    """√(area / N), about the distance between neighbours. Unit: length."""

    @property
    def points(self) -> SurfacePoints:
        """Where they are, as `flow` and `integral_curves` take it."""
        return SurfacePoints(self.faces, self.barycentric)


def spread_evenly(vertices: Float[ArrayLike, "V 3"], faces: Integer[ArrayLike, "F 3"], count: int) -> Samples:
    """`count` points spread evenly over a surface, however uneven its triangles; the same ones every time. On the host.

    Where flow lines may start (`integral_curves(mesh, field, time, at.points)`), or arrows stand. Farthest-point sampling
    among random points of uniform density (fixed seed). Opposite normals count as distance, so that the two sides of a thin
    wing each get their points.

    Args:
        vertices: positions. Unit: length.
        faces: vertex indices.
        count: how many; none come back where the surface has no area.
    """
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled_areas = np.linalg.norm(normals, axis=1)
    total = doubled_areas.sum()
    if count == 0 or total == 0:
        return Samples(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), 0.0)
    spacing = float(np.sqrt(total / 2 / count))
    owner, weights = _candidates(doubled_areas / total, _CANDIDATES_PER_POINT * count)
    places = np.einsum("nc,ncx->nx", weights, corners[owner])
    sides = normals[owner] / doubled_areas[owner][:, None]
    chosen = np.zeros(count, dtype=np.int64)
    nearest = np.full(len(places), np.inf)
    for i in range(1, count):
        last = chosen[i - 1]
        opposed = np.maximum(-(sides @ sides[last]), 0.0)
        squared = ((places - places[last]) ** 2).sum(axis=1) + (_SIDE_DISTANCE * spacing) ** 2 * opposed
        nearest = np.minimum(nearest, squared)
        chosen[i] = np.argmax(nearest)
    return Samples(owner[chosen], weights[chosen], spacing)


def _candidates(
    shares: Float[np.ndarray, " F"], count: int
) -> tuple[Int[np.ndarray, " N"], Float[np.ndarray, "N 3"]]:
    """One random point in each of `count` equal shares of the area: faces and barycentric coordinates."""
    rng = np.random.default_rng(0)
    occupied = np.flatnonzero(shares > 0)
    ends = np.cumsum(shares[occupied])
    at = (np.arange(count) + rng.random(count)) / count
    owner = occupied[np.minimum(np.searchsorted(ends, at), len(occupied) - 1)]
    root, fraction = np.sqrt(rng.random(count)), rng.random(count)
    return owner, np.stack([1 - root, root * (1 - fraction), root * fraction], axis=1)
