"""Intrinsic patterns (§4 of the paper): disks around the images of points under a discrete group, with coordinates."""

import math
import warnings

import equinox as eqx
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float, Int

from ..flows import check_at_least_one, check_on_host, flow
from ..flows import period as period_of
from ..geometry import vertex_points
from ..mesh import TriangleMesh
from ._log_map import log_map
from ._subdivision import subdivided

MARGIN = 1.3
"""Coordinates are given this far beyond the unit disk, so that faces across its rim have them at all corners."""
_SHARE = 0.4
"""Default radius of a disk in distances between neighbouring copies: below ½ they stay apart."""


class Pattern(eqx.Module):
    """Coordinates in the unit disk around the copies φ^jq(p), j = 0…m−1, of each centre p, for the vertices of a mesh."""

    mesh: TriangleMesh
    """The surface, subdivided where that was asked for."""
    coordinates: Float[np.ndarray, "c W 2"]
    """(u, v) of each vertex in the disk of copy c = m i + j (centre i, image j): the log map at the centre, u along the
    field, over the radius; NaN far from it. |(u, v)| ≤ 1 is the disk."""
    order: int
    """m."""
    period: float
    """T. Unit: time."""
    radius: float
    """r: the disk at p has the radius r‖U(p)‖. Unit: time."""

    @property
    def copy(self) -> Int[np.ndarray, " W"]:
        """The copy in whose disk each vertex lies, the nearest centre's where there are several; −1 in none."""
        distance = self._distance
        return np.where(distance.min(axis=0) <= 1, distance.argmin(axis=0), -1)

    @property
    def disk(self) -> Float[np.ndarray, "W 2"]:
        """(u, v) of each vertex in the disk of its `copy`; NaN in none."""
        nearest = self._distance.argmin(axis=0)
        here = self.coordinates[nearest, np.arange(len(nearest))]
        return np.where(self.copy[:, None] >= 0, here, np.nan)

    @property
    def face_copy(self) -> Int[np.ndarray, " G"]:
        """The copy whose disk each face meets and in which all its corners have coordinates; −1 for no copy."""
        at_corners = self._distance[:, np.asarray(self.mesh.faces)]
        nearest = np.where(np.isfinite(at_corners).all(axis=2), at_corners.min(axis=2), np.inf)
        return np.where(nearest.min(axis=0) <= 1, nearest.argmin(axis=0), -1)

    @property
    def _distance(self) -> Float[np.ndarray, "c W"]:
        return np.nan_to_num(np.linalg.norm(self.coordinates, axis=2), nan=np.inf)


def pattern(
    mesh: TriangleMesh,
    vectors: ArrayLike,
    vertices: ArrayLike,
    m: int,
    *,
    radius: float | None = None,
    period: float | None = None,
    subdivide: int = 1,
) -> Pattern:
    """A neighbourhood of each of some points, repeated m times along the field: coordinates for what is to decorate them.

    The disk around p is mapped to the unit disk by the log map (vector heat method); the coordinates of all other copies
    are those of the vertices' pre-images φ^−jq under the flow, q = T/m. What is painted by them is invariant under φ^q. On
    the host.

    Args:
        mesh: the surface.
        vectors: `[V, 3]`, a nearly Killing field with closed integral curves. Unit: length / time.
        vertices: `[n]`, the centres p.
        m: number of copies of each, the order of the group.
        radius: r, the disk around p has the radius r‖U(p)‖; by default 0.4 T/m, 0.8 of what leaves copies apart. Unit: time.
        period: T; by default `period(mesh, vectors).period`.
        subdivide: in how many parts each edge is cut, so that reliefs have vertices to live on.

    Raises:
        ValueError: m < 1 or subdivide < 1; no such vertex; a centre where the field vanishes; radius not positive; what
            `period` raises.
        ImportError: `potpourri3d` is not installed (`pip install "jaxkvf[patterns]"`).

    Warns:
        UserWarning: disks overlap; the message says which m would fit.
    """
    check_on_host("pattern", mesh, vectors, vertices, radius, period)
    check_at_least_one("m", m)
    check_at_least_one("subdivide", subdivide)
    centers = np.atleast_1d(np.asarray(vertices))
    vertex_points(mesh, centers)
    u = np.asarray(vectors, np.float64)
    whole = period_of(mesh, vectors).period if period is None else float(period)
    reach = _SHARE * whole / m if radius is None else float(radius)
    if not (math.isfinite(reach) and reach > 0):
        raise ValueError(f"radius must be positive and finite, got {radius!r}")
    speed = np.linalg.norm(u[centers], axis=1)
    still = np.flatnonzero(speed <= 1e-6 * np.linalg.norm(u, axis=1).max())
    if still.size:
        raise ValueError(
            f"the field vanishes at vertex {centers[still[0]]}: a disk around it would have radius 0"
        )

    fine, points = subdivided(mesh, subdivide)
    charts = [log_map(mesh, int(p), u[p]) / (reach * s) for p, s in zip(centers, speed, strict=True)]
    faces = np.asarray(mesh.faces)
    coordinates = np.full((len(centers), m, len(points.faces), 2), np.nan)
    for j in range(m):
        if j:
            points = flow(mesh, vectors, -whole / m, points).points
        corners, b = faces[np.asarray(points.faces)], np.asarray(points.barycentric)
        for i, chart in enumerate(charts):
            at = np.einsum("wc,wcx->wx", b, chart[corners])
            near = (
                np.linalg.norm(chart[corners], axis=2).max(axis=1) <= 2 * MARGIN
            )  # a chart tears at the cut locus
            near &= np.linalg.norm(at, axis=1) <= MARGIN
            coordinates[i, j, near] = at[near]
    made = Pattern(fine, coordinates.reshape(len(centers) * m, -1, 2), m, whole, reach)
    _warn_if_overlapping(made, len(centers))
    return made


def _warn_if_overlapping(made: Pattern, centers: int) -> None:
    fits = math.floor(made.period / (2 * made.radius) * (1 + 1e-9))
    if made.order > max(fits, 1):
        warnings.warn(
            f"the {made.order} disks along an orbit overlap; m ≤ {fits} of this radius would fit, "
            f"or a radius of at most {made.period / 2 / made.order:.4g}",
            stacklevel=3,
        )
        return
    twice = int(((made._distance < 1).sum(axis=0) > 1).sum())
    if twice:
        which = "disks of different centres" if centers > 1 else "a disk and its own images"
        warnings.warn(f"{which} overlap at {twice} vertices: take a smaller radius or m", stacklevel=3)
