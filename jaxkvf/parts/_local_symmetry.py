"""How symmetric a surface is around each place. A shape without a symmetry may have parts with one."""

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from ..arguments import checked_integer, checked_positive
from ..geometry import intrinsic_delaunay
from ..killing import Pieces
from ..mesh import TriangleMesh
from ._balls import Balls


class LocalSymmetry(eqx.Module):
    """How symmetric the surface is around each place."""

    values: Float[np.ndarray, " V"]
    """Lowest λ · area of the balls around, at each vertex: near 0 in parts with a continuous symmetry. Dimensionless.

    NaN on components without a sample.
    """
    samples: Int[np.ndarray, " n"]
    """Vertices at the centres of the balls."""
    sample_values: Float[np.ndarray, " n"]
    """Lowest λ · area of each ball; infinite where a ball has no face."""


def local_symmetry(mesh: TriangleMesh, radius: float | int, *, samples: int = 64) -> LocalSymmetry:
    """Lowest λ · area of geodesic balls of this radius, as a map over the surface.

    A handle or neck shows as a valley. So do flat places, which have three symmetries: choose a radius at which what you
    look for is closed around (about half the circumference of a handle, or more). On the intrinsic Delaunay triangulation,
    each ball with free boundary.

    Args:
        mesh: the surface.
        radius: of the balls, along edges of the intrinsic Delaunay triangulation. Unit: length.
        samples: number of balls, around vertices as far from each other as can be; components come first. Between them
            values are averaged with weights (1 − distance / radius)².

    Raises:
        ValueError: a radius or number of samples that is not positive.
    """
    radius, samples = checked_positive("radius", radius), checked_integer("samples", samples)
    surface = intrinsic_delaunay(mesh, least_degree=3)
    pieces = Pieces(surface.lengths, surface.topology)
    balls = Balls(surface.lengths, surface.topology)
    chosen, distances = balls.spread(min(samples, balls.n_vertices))
    found = np.full(len(chosen), np.inf)
    for number, (centre, distance) in enumerate(zip(chosen, distances, strict=True)):
        faces = balls.faces_within(distance <= radius, centre)
        if faces.size:
            found[number] = pieces.smallest(faces, 1)[0]
    weights = np.clip(1 - distances / radius, 0, None) ** 2 * np.isfinite(found)[:, None]
    total = weights.sum(axis=0)
    averaged = weights.T @ np.where(np.isfinite(found), found, 0.0) / np.where(total > 0, total, 1.0)
    reached = np.isfinite(distances).any(axis=0)
    of_nearest = np.where(reached, found[distances.argmin(axis=0)], np.nan)
    return LocalSymmetry(np.where(total > 0, averaged, of_nearest), chosen, found)
