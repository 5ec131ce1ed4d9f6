"""Intrinsic patterns (§4 of the paper): disks around the images of points under a discrete group, with coordinates."""

import math
import warnings
from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from ..arguments import Integer, Real, checked_integer, checked_positive
from ..flows import flow, orbit
from ..flows import period as period_of
from ..geometry import closest_points, surface_positions, vertex_points
from ..host import check_on_host
from ..mesh import TriangleMesh
from ._log_map import log_map
from ._refinement import refined
from ._subdivision import subdivided

MARGIN = 1.3
"""Coordinates are given this far beyond the unit disk, so that faces across its rim have them at all corners."""
_SHARE = 0.4
"""Default radius of a disk in distances between neighbouring copies: below ½ they stay apart."""

_ON_THE_SURFACE = 1e-3
"""Points further from the faces of a chart, in radii, lie on another part of the surface."""
_SLOWEST = 0.05
"""Share of the largest speed below which no disk is put."""


class Pattern(eqx.Module):
    """Coordinates in the unit disk around the copies φ^jq(p), j = 0…m−1, of each centre p, for the vertices of a mesh."""

    mesh: TriangleMesh
    """The surface, refined around the disks; its first vertices are those of the mesh that was given."""
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
    vertices: ArrayLike | Sequence[int],
    m: Integer,
    *,
    radius: Real | None = None,
    period: Real | None = None,
    subdivide: Integer = 1,
    edge: Real = 1 / 8,
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
        subdivide: in how many parts every edge of the surface is cut.
        edge: longest edge around the disks, in their radii: there the surface is refined until no edge is longer, so that
            disks are round and reliefs have vertices to live on; `math.inf`: nowhere.

    Raises:
        ValueError: m < 1 or subdivide < 1; no such vertex; a centre where the field vanishes; radius or edge not
            positive; what `period` raises.
        ImportError: `potpourri3d` is not installed (`pip install "jaxkvf[patterns]"`).

    Warns:
        UserWarning: disks overlap; the message says which m would fit. A disk reaches over the boundary.
    """
    check_on_host("pattern", mesh, vectors, vertices, radius, period)
    m = checked_integer("m", m)
    subdivide = checked_integer("subdivide", subdivide)
    edge = checked_positive("edge", edge, finite=False)
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

    around = orbit(mesh, vectors, m, vertex_points(mesh, centers), period=whole)
    middles = np.asarray(surface_positions(mesh, around.points), np.float64).reshape(-1, 3)
    radii = np.tile(reach * speed, m)
    finer = refined(mesh, middles, MARGIN * radii, edge * subdivide / MARGIN)
    fine, points = subdivided(finer.mesh, subdivide)
    points = finer.in_coarse(points)
    charts = [_Chart(finer.mesh, int(p), u[p], reach) for p in centers]
    coordinates = np.full((len(centers), m, len(points), 2), np.nan)
    for j in range(m):
        if j:
            points = flow(mesh, vectors, -whole / m, points).points
        places = np.asarray(surface_positions(mesh, points), np.float64)
        for i, chart in enumerate(charts):
            chart.read(places, coordinates[i, j])
    made = Pattern(fine, coordinates.reshape(len(centers) * m, -1, 2), m, whole, reach)
    _warn_if_overlapping(made, len(centers))
    _warn_if_cut_off(mesh, centers, reach * speed)
    return made


class _Chart:
    """The log map at a vertex over the radius of its disk, where it is wanted."""

    def __init__(self, mesh: TriangleMesh, vertex: int, vector: Float[np.ndarray, "3"], reach: float) -> None:
        self._radius = reach * float(np.linalg.norm(vector))
        self._middle = np.asarray(mesh.vertices[vertex], np.float64)
        chart = log_map(mesh, vertex, vector) / self._radius
        # A chart tears at the cut locus: faces far from the disk are left out, as are those across a tear.
        extent = np.linalg.norm(chart, axis=1)[np.asarray(mesh.faces)].max(axis=1)
        near = extent <= 2 * MARGIN
        self._near = None
        if near.any():
            self._near, owner = mesh.submesh(near)
            self._chart = chart[owner]

    def read(self, places: Float[np.ndarray, "W 3"], into: Float[np.ndarray, "W 2"]) -> None:
        """Writes the coordinates of points of the surface where the chart has any."""
        close = np.flatnonzero(np.linalg.norm(places - self._middle, axis=1) <= MARGIN * self._radius)
        if self._near is None or not close.size:
            return
        found = closest_points(self._near, places[close])
        gap = np.linalg.norm(np.asarray(surface_positions(self._near, found)) - places[close], axis=1)
        corners = self._chart[np.asarray(self._near.faces)[np.asarray(found.faces)]]
        at = np.einsum("wc,wcx->wx", np.asarray(found.barycentric, np.float64), corners)
        inside = (gap <= _ON_THE_SURFACE * self._radius) & (np.linalg.norm(at, axis=1) <= MARGIN)
        into[close[inside]] = at[inside]


def fastest_vertex(mesh: TriangleMesh, vectors: ArrayLike, radius: Real = 0.0) -> int:
    """The vertex where a field is fastest, of those whose disk of radius `radius` ‖U‖ does not reach the boundary.

    If all disks do, that whose disk comes nearest to fit. On the host.

    Args:
        mesh: the surface.
        vectors: `[V, 3]`. Unit: length / time.
        radius: as for `pattern`. Unit: time.
    """
    check_on_host("fastest_vertex", mesh, vectors, radius)
    speed = np.linalg.norm(np.asarray(vectors, np.float64), axis=1)
    if not np.asarray(mesh.topology.is_boundary_vertex).any():
        return int(speed.argmax())
    fast = np.flatnonzero(speed > _SLOWEST * speed.max())
    room = _distances_to_boundary(mesh, np.asarray(mesh.vertices, np.float64)[fast]) / speed[fast]
    fits = room >= radius
    return int(fast[np.where(fits, speed[fast], 0.0).argmax() if fits.any() else room.argmax()])


def _distances_to_boundary(mesh: TriangleMesh, places: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """In space, to points 1/8 of an edge apart; infinite without boundary."""
    topology = mesh.topology
    ends = np.asarray(topology.edges)[np.asarray(topology.is_boundary_edge)]
    if not len(ends):
        return np.full(len(places), np.inf)
    a, b = np.moveaxis(np.asarray(mesh.vertices, np.float64)[ends], 1, 0)
    along = np.linspace(0, 1, 9)[:, None, None]
    return KDTree(((1 - along) * a + along * b).reshape(-1, 3)).query(places)[0]


def _warn_if_cut_off(
    mesh: TriangleMesh, centers: Int[np.ndarray, " n"], radii: Float[np.ndarray, " n"]
) -> None:
    room = _distances_to_boundary(mesh, np.asarray(mesh.vertices, np.float64)[centers])
    cut = np.flatnonzero(room < radii)
    if cut.size:
        warnings.warn(
            f"the disk around vertex {centers[cut[0]]} reaches over the boundary ({cut.size} such disks): take a centre "
            "further from it, or a smaller radius",
            stacklevel=3,
        )


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
