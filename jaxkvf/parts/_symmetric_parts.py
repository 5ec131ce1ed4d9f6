"""A surface cut into parts that are nearly symmetric each."""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from ..arguments import checked_integer, checked_positive
from ..geometry import intrinsic_delaunay
from ..killing import Pieces
from ..mesh import TriangleMesh
from ._balls import Balls

_GROWTH = 1.2  # of a ball's radius at a time
_SMALLEST = 0.05  # area of a part, as a share of an equal one


class SymmetricParts(eqx.Module):
    """A surface cut into parts that are nearly symmetric each, and a rest."""

    vertex_parts: Int[np.ndarray, " V"]
    """Number of the part of each vertex, in the order found; −1 in the rest."""
    values: Float[np.ndarray, " n"]
    """Lowest λ · area of each part. Dimensionless."""
    areas: Float[np.ndarray, " n"]
    """Unit: length²."""


def symmetric_parts(
    mesh: TriangleMesh, tolerance: float | int, *, most: int = 8, samples: int = 32
) -> SymmetricParts:
    """Cuts off the largest piece with a nearly exact symmetry, then the largest of what is left, and so on. Greedy.

    Pieces are geodesic balls in what is left, grown by a fifth in radius at a time while their lowest λ · area stays
    within `tolerance`; the one of largest area is taken. The remedy that the paper names for its biggest limitation (§4).

    Args:
        mesh: the surface.
        tolerance: largest λ · area of a part. Dimensionless.
        most: number of parts at which to stop.
        samples: number of centres tried for each part.

    Raises:
        ValueError: a tolerance, `most` or `samples` that is not positive.
    """
    tolerance = checked_positive("tolerance", tolerance)
    most, samples = checked_integer("most", most), checked_integer("samples", samples)
    surface = intrinsic_delaunay(mesh, least_degree=3)
    pieces = Pieces(surface.lengths, surface.topology)
    balls = Balls(surface.lengths, surface.topology)
    parts = np.full(balls.n_vertices, -1)
    values, areas = [], []
    smallest = _SMALLEST * float(pieces.areas.sum()) / most
    for number in range(most):
        free = parts < 0
        best: _Part | None = None
        centres, distances = balls.spread(min(samples, int(free.sum())), free)
        for centre, distance in zip(centres, distances, strict=True):
            grown = _grown(
                pieces, balls, centre, distance, tolerance=tolerance, more_than=best[0] if best else smallest
            )
            best = grown or best
        if best is None:
            break
        area, value, inside = best
        parts[inside] = number
        values.append(value)
        areas.append(area)
        if not (parts < 0).any():
            break
    return SymmetricParts(parts, np.array(values), np.array(areas))


_Part = tuple[float, float, np.ndarray]


def _grown(
    pieces: Pieces,
    balls: Balls,
    centre: int | np.integer,
    distance: Float[np.ndarray, " V"],
    *,
    tolerance: float,
    more_than: float,
) -> tuple[float, float, Bool[np.ndarray, " V"]] | None:
    """Area, λ · area and vertices of the largest ball within tolerance, if its area is more than `more_than`."""
    radius, farthest = np.sqrt(more_than / np.pi), distance[np.isfinite(distance)].max()
    best = None
    while True:
        faces = balls.faces_within(distance <= radius, centre)
        area = float(pieces.areas[faces].sum())
        if area > more_than:
            value = float(pieces.smallest(faces, 1)[0])
            if value > tolerance:
                return best
            best = area, value, balls.vertices_of(faces)
        if radius > farthest:
            return best
        radius *= _GROWTH
