"""How far vertices moved, measured against the mesh they left."""

from typing import Literal

import numpy as np
from jaxtyping import Float, Int

CLIPPED_PERCENT = 0.5
"""Share of the vertices whose value may lie beyond the end of the colour bar."""


def mean_edge_length(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> float:
    """Mean over the mesh's edges, each counted once."""
    ends = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    return float(np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1).mean())


def vertex_normals(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> Float[np.ndarray, "V 3"]:
    """Unit normals at the vertices, means of the faces' weighted by area; 0 where a vertex has no face."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    sums = np.zeros_like(vertices)
    np.add.at(sums, faces.ravel(), np.repeat(np.cross(b - a, c - a), 3, axis=0))
    norms = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.divide(sums, norms, out=np.zeros_like(sums), where=norms > 0)


def displacement(
    before: Float[np.ndarray, "V 3"],
    after: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    quantity: Literal["normal", "size"],
) -> Float[np.ndarray, "V"]:
    """The displacement's component along `before`'s outward vertex normal, or its length."""
    moved = after - before
    if quantity == "size":
        return np.linalg.norm(moved, axis=1)
    return (moved * vertex_normals(before, faces)).sum(axis=1)


def color_limits(
    values: Float[np.ndarray, "N"], *, signed: bool
) -> tuple[tuple[float, float], Literal["neither", "max", "both"]]:
    """Ends of the colour bar, ±m or 0 … m, and which of them some values exceed.

    m leaves out the largest `CLIPPED_PERCENT` of the values; where nothing moved it is 1.
    """
    sizes = np.abs(values)
    m = float(np.percentile(sizes, 100 - CLIPPED_PERCENT)) or float(sizes.max()) or 1.0
    beyond = bool(sizes.max() > m)
    if signed:
        return (-m, m), "both" if beyond else "neither"
    return (0.0, m), "max" if beyond else "neither"
