"""Spheres and ellipsoids."""

import math

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull

from ...arguments import Integer, Real, checked_integer, checked_positive
from .._triangle_mesh import TriangleMesh
from ._checks import check_radii


def icosphere(frequency: Integer, radius: Real = 1.0) -> TriangleMesh:
    """The geodesic sphere: an icosahedron's faces, each cut into frequency² triangles, projected from the centre.

    10 f² + 2 vertices (f = 12, 16, 32, 45, 316: 1,442, 2,562, 10,242, 20,252, 998,562) and 20 f² faces. Two corners of
    the icosahedron lie on the z axis. All angles are between 54° and 72°; areas differ by up to a factor of 1.93.
    (Subdivision at equal arcs evens out the areas, makes triangles less equilateral, and leaves the error of the
    Killing spectrum as it is.)

    Args:
        frequency: in how many parts each edge of the icosahedron is cut, ≥ 1.
        radius: distance of all vertices from the origin, in the unit of length.

    Raises:
        ValueError: an argument out of range.
    """
    radius = checked_positive("radius", radius)
    vertices, faces = unit_icosphere(frequency)
    return TriangleMesh.from_arrays(radius * vertices, faces)


def ellipsoid(frequency: Integer, radii: tuple[Real, Real, Real] = (1.0, 1.0, 1.6)) -> TriangleMesh:
    """The geodesic sphere of this frequency, scaled along the axes.

    Args:
        frequency: in how many parts each edge of the icosahedron is cut, ≥ 1; 10 frequency² + 2 vertices.
        radii: semi-axes along x, y and z, in the unit of length.

    Raises:
        ValueError: an argument out of range.
    """
    check_radii("radii", radii, 3)
    vertices, faces = unit_icosphere(frequency)
    return TriangleMesh.from_arrays(vertices * np.asarray(radii, np.float64), faces)


def random_sphere(
    n_vertices: Integer, seed: Integer = 0, radii: tuple[Real, Real, Real] = (1.0, 1.0, 1.0)
) -> TriangleMesh:
    """Random points on the unit sphere, joined by their convex hull, then scaled along the axes: bad triangles.

    The hull of points on the sphere is their Delaunay triangulation; the scaled one is not Delaunay.

    Args:
        n_vertices: how many, ≥ 4.
        seed: of the random numbers; the same seed gives the same mesh.
        radii: semi-axes along x, y and z, in the unit of length.

    Raises:
        ValueError: an argument out of range.
    """
    n_vertices = checked_integer("n_vertices", n_vertices, 4)
    check_radii("radii", radii, 3)
    points = np.random.default_rng(seed).standard_normal((n_vertices, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    hull = ConvexHull(points)
    corners = points[hull.simplices]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = (facing * hull.equations[:, :3]).sum(axis=1) < 0
    faces = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    return TriangleMesh.from_arrays(points * np.asarray(radii, np.float64), faces)


def unit_icosphere(frequency: Integer) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
    """Vertices and faces of the geodesic sphere of radius 1, glued by counting alone.

    First the 12 corners of the icosahedron, then frequency − 1 vertices on each of its edges, then the inner vertices
    of each of its faces.
    """
    frequency = checked_integer("frequency", frequency, 1)
    f = frequency
    corners, triangles = _icosahedron()
    sides = np.stack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]], axis=1)
    edges, edge_of_side = np.unique(np.sort(sides, axis=2).reshape(-1, 2), axis=0, return_inverse=True)

    inner_i, inner_j = (index + 1 for index in _triangular_grid(f - 3)) if f > 2 else (np.zeros(0, int),) * 2
    along = np.arange(1, f)
    on_edges = _blend(np.stack([f - along, along], axis=1), corners[edges])
    inside = _blend(np.stack([f - inner_i - inner_j, inner_i, inner_j], axis=1), corners[triangles])
    vertices = np.concatenate([corners, on_edges, inside])
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)

    on_side = len(corners) + edge_of_side.reshape(-1, 3, 1) * (f - 1) + along - 1
    against = (sides[:, :, 0] > sides[:, :, 1])[:, :, None]
    on_side = np.where(against, on_side[:, :, ::-1], on_side)
    number = np.empty(
        (len(triangles), f + 1, f + 1), dtype=np.int64
    )  # of the vertex i steps to b, j steps to c
    number[:, 0, 0], number[:, f, 0], number[:, 0, f] = triangles.T
    number[:, along, 0] = on_side[:, 0]
    number[:, f - along, along] = on_side[:, 1]
    number[:, 0, f - along] = on_side[:, 2]
    number[:, inner_i, inner_j] = (
        len(corners) + len(on_edges) + np.arange(len(triangles) * len(inner_i)).reshape(len(triangles), -1)
    )
    i, j = _triangular_grid(f - 1)
    upright = np.stack([number[:, i, j], number[:, i + 1, j], number[:, i, j + 1]], axis=-1)
    i, j = i[i + j < f - 1], j[i + j < f - 1]
    inverted = np.stack([number[:, i + 1, j], number[:, i + 1, j + 1], number[:, i, j + 1]], axis=-1)
    return vertices, np.concatenate([upright, inverted], axis=1).reshape(-1, 3)


def _icosahedron() -> tuple[Float[np.ndarray, "12 3"], Int[np.ndarray, "20 3"]]:
    """Corners on the unit sphere, the first and last at the poles, and outward faces."""
    k = np.arange(5)
    angle = 2 * np.pi / 5 * np.stack([k, k + 0.5])
    height = np.broadcast_to(np.array([[1.0], [-1.0]]) / math.sqrt(5), angle.shape)
    rings = np.stack([2 / math.sqrt(5) * np.cos(angle), 2 / math.sqrt(5) * np.sin(angle), height], axis=-1)
    corners = np.concatenate([[[0.0, 0.0, 1.0]], rings.reshape(-1, 3), [[0.0, 0.0, -1.0]]])
    top, low, north, south = 1 + k, 6 + k, np.zeros_like(k), np.full_like(k, 11)
    next_top, next_low = np.roll(top, -1), np.roll(low, -1)
    groups = [(north, top, next_top), (top, low, next_top), (next_top, low, next_low), (south, next_low, low)]
    return corners, np.concatenate([np.stack(group, axis=1) for group in groups])


def _triangular_grid(n: int) -> tuple[Int[np.ndarray, " points"], Int[np.ndarray, " points"]]:
    """All i, j ≥ 0 with i + j ≤ n."""
    i, j = np.divmod(np.arange((n + 1) ** 2), n + 1)
    return i[i + j <= n], j[i + j <= n]


def _blend(
    weights: Int[np.ndarray, "points c"], corners: Float[np.ndarray, "cells c 3"]
) -> Float[np.ndarray, "cells*points 3"]:
    """The weighted sums of each cell's corners."""
    return np.einsum("pc,ncx->npx", weights.astype(np.float64), corners).reshape(-1, 3)
