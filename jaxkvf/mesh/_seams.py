"""Copies of vertices along seams: where they lie, and the distance at which merging them closes the surface."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from ._defects import Gluing, coincident, with_repeated_corner

_NEAR = 1e-4  # of the size: gaps that text of five digits leaves
_OF_AN_EDGE = 0.05  # gaps that may not be meant, of the usual edge at the seam
_SLIVER = 1e-3  # a side this short beside another may collapse
_FLOAT32 = 16 * float(
    np.finfo(np.float32).eps
)  # of the largest coordinate: as STL and many PLY files round it


class Seam(NamedTuple):
    distance: float
    """Merging vertices up to this far apart closes what can be closed; 0 where copies are exact."""
    vertices: Int[np.ndarray, " n"]
    """The vertices that would go."""
    open_edges: int
    """Edges of one face, or of more than two, that would be left."""


def closing(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> Seam | None:
    """The least distance at which merging vertices leaves the fewest open edges; None if none helps.

    Looked for among the vertices at open edges alone, up to a small part of their edges' length, and without collapsing
    faces that are not slivers. Tried, not estimated.

    Args:
        vertices: positions, finite where a face uses them.
        faces: of three different vertices, none of them flat.
    """
    gluing = Gluing.of(faces, len(vertices))
    open_edges = gluing.edges[gluing.uses != 2]
    if not len(open_edges):
        return None
    loose = np.unique(open_edges)
    used = vertices[np.unique(faces)].astype(np.float64)
    with np.errstate(over="ignore"):
        size = float(np.ptp(used, axis=0).max())
    if not 0 < size < np.inf:
        return None
    places = np.unique(vertices[loose].astype(np.float64) / size, axis=0)
    lengths = np.linalg.norm(np.diff(vertices[open_edges].astype(np.float64) / size, axis=1)[:, 0], axis=1)
    furthest = min(
        _OF_AN_EDGE * float(np.median(lengths)), max(_NEAR, _FLOAT32 * float(np.abs(used).max() / size))
    )
    candidates = [0.0] if len(places) < len(loose) else []
    if len(places) > 1:
        gaps, _ = KDTree(places).query(places, k=min(9, len(places)))
        decades = np.unique(np.floor(np.log10(gaps[(gaps > 0) & (gaps < furthest)])))
        candidates += [_rounded_up(10.0 ** (decade + 1) * size) for decade in decades]
    corner = vertices[faces].astype(np.float64) / size
    sides = np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2)
    slivers = sides.min(axis=1) < _SLIVER * sides.max(axis=1)
    best: Seam | None = None
    fewest = len(open_edges)
    for distance in candidates:
        first = coincident(vertices, distance)
        merged = first[faces]
        collapsed = with_repeated_corner(merged)
        if not slivers[collapsed].all():
            break
        left = int((Gluing.of(np.delete(merged, collapsed, axis=0), len(vertices)).uses != 2).sum())
        if left < fewest:
            fewest, best = left, Seam(distance, np.flatnonzero(first != np.arange(len(first))), left)
    return best


def _rounded_up(value: float) -> float:
    """To one digit, as it is printed."""
    exponent = math.floor(math.log10(value))
    return float(f"{math.ceil(value / 10.0**exponent * (1 - 1e-12))}e{exponent}")
