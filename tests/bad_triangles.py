"""Surfaces that are far from Delaunay, and how to differentiate on them."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial import Delaunay

from jaxkvf import Topology, TriangleMesh, shapes
from jaxkvf.geometry import edge_lengths

STRETCH = (1.0, 1.0, 2.5)


def surface(mesh: TriangleMesh) -> tuple[jax.Array, Topology]:
    return edge_lengths(mesh.vertices, mesh.topology), mesh.topology


def grid_faces(n: int, m: int) -> np.ndarray:
    """n × m squares of a torus, each cut along its diagonal; vertex (i, j) is number m i + j."""
    i, j = (part.ravel() for part in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    a, b, c, d = ((i + p) % n * m + (j + q) % m for p, q in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def grid_torus(n: int, m: int, noise: float = 0.0) -> TriangleMesh:
    """A torus of planar quadrilaterals with corners on a circle, so that the diagonal of each has ⋆₁ = 0."""
    shift = noise * np.random.default_rng(0).standard_normal((2, n, m))
    u = (np.arange(n)[:, None] + shift[0]) * 2 * np.pi / n
    v = (np.arange(m) + shift[1]) * 2 * np.pi / m
    r = 2 + 0.8 * np.cos(v)
    points = np.stack([r * np.cos(u), r * np.sin(u), 1.04 * np.sin(v)], axis=-1)
    return TriangleMesh.from_arrays(points.reshape(-1, 3), grid_faces(n, m))


def sheared_torus(n: int, shear: int) -> tuple[jax.Array, Topology]:
    """The flat square torus of area n², its unit squares sheared by an integer: the same surface, far from Delaunay."""
    topology = Topology.from_faces(grid_faces(n, n))
    i, j = np.divmod(np.asarray(topology.edges), n)
    x, y = ((np.diff(index, axis=1)[:, 0] + n // 2) % n - n // 2 for index in (i, j))
    return jnp.asarray(np.hypot(x + shear * y, y)), topology


def stretched_plane(count: int) -> TriangleMesh:
    """Random points in a square, Delaunay, then stretched: flat, with convex boundary."""
    points = np.random.default_rng(4).uniform(size=(count, 2))
    faces = Delaunay(points).simplices
    u, v = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    backwards = u[:, 0] * v[:, 1] < u[:, 1] * v[:, 0]
    faces[backwards] = faces[backwards][:, ::-1]
    return TriangleMesh.from_arrays(np.pad(points * [8.0, 1.0], [(0, 0), (0, 1)]), faces)


def spindle(belt: int) -> TriangleMesh:
    """Two far tips over a ring of few vertices that runs up and down wildly."""
    angle = 2 * np.pi * np.arange(belt) / belt
    height = np.random.default_rng(0).uniform(-90, 90, belt)
    ring = np.stack([np.cos(angle), np.sin(angle), height], axis=1)
    i, j = np.arange(belt), (np.arange(belt) + 1) % belt
    faces = np.concatenate([np.stack([i, j, 0 * i + belt], 1), np.stack([j, i, 0 * i + belt + 1], 1)])
    return TriangleMesh.from_arrays(np.concatenate([ring, [[0, 0, 100.0], [0, 0, -100.0]]]), faces)


def doubled_triangle() -> tuple[jax.Array, Topology]:
    """A triangle and its mirror image glued along all three sides: 2, √2, √2.5 with an obtuse angle at vertex 2."""
    topology = Topology.from_faces(np.array([[0, 1, 2], [0, 2, 1]]))
    corners = np.array([[0.0, 0], [2.0, 0], [0.9, 0.5]])
    tail, head = np.asarray(topology.edges).T
    return jnp.asarray(np.linalg.norm(corners[tail] - corners[head], axis=1)), topology


def thin_strip(count: int) -> TriangleMesh:
    """Two parallel lines of points joined by a fan from each end: about as far from Delaunay as can be."""
    x, i = np.linspace(0, 1, count), np.arange(count - 1)
    points = np.concatenate([np.stack([x, 0 * x, 0 * x], 1), np.stack([x, 0 * x + 0.01, 0 * x], 1)])
    upper = np.stack([0 * i, count + i + 1, count + i], 1)
    lower = np.stack([i, i + 1, 0 * i + 2 * count - 1], 1)
    return TriangleMesh.from_arrays(points, np.concatenate([upper, lower]))


@functools.cache
def random_spheroid(count: int) -> TriangleMesh:
    return shapes.random_sphere(count, seed=1, radii=STRETCH)


@functools.cache
def differentiated() -> tuple[TriangleMesh, jax.Array, jax.Array]:
    mesh = random_spheroid(700)
    random = np.random.default_rng(5)
    weights = random.standard_normal(mesh.topology.n_edges)
    return mesh, jnp.asarray(weights), jnp.asarray(random.standard_normal(mesh.vertices.shape))


def central_difference(function, x, direction, step):
    return (function(x + step * direction) - function(x - step * direction)) / (2 * step)
