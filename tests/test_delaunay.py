"""The intrinsic Delaunay triangulation: what flips keep, what they reach, their derivatives; `dec` on top of it."""

import functools

import equinox as eqx
import igl
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from scipy.spatial import Delaunay

from jaxkvf import Topology, TriangleMesh, intrinsic_killing_eigenvalues, killing_fields, reference, shapes
from jaxkvf.eigen import DenseEigh, ScipyEigsh, eigsolve
from jaxkvf.exterior import d0, d1, flat, sharp
from jaxkvf.geometry import (
    IntrinsicDelaunay,
    circumcentric_vertex_areas,
    cone_angles,
    cotan_weights,
    delaunay_tolerance,
    edge_angles,
    edge_lengths,
    intrinsic_delaunay,
    project,
    surface_area,
    vertex_frames,
)
from jaxkvf.killing import Dec, vector_mass
from jaxkvf.sparse import to_scipy

STRETCH = (1.0, 1.0, 2.5)


def of(mesh: TriangleMesh) -> tuple[jax.Array, Topology]:
    return edge_lengths(mesh.vertices, mesh.topology), mesh.topology


def spindle(belt: int) -> TriangleMesh:
    """Two far tips over a ring of few vertices that runs up and down wildly."""
    angle = 2 * np.pi * np.arange(belt) / belt
    height = np.random.default_rng(0).uniform(-90, 90, belt)
    ring = np.stack([np.cos(angle), np.sin(angle), height], axis=1)
    i, j = np.arange(belt), (np.arange(belt) + 1) % belt
    top, bottom = np.full(belt, belt), np.full(belt, belt + 1)
    faces = np.concatenate([np.stack([i, j, top], 1), np.stack([j, i, bottom], 1)])
    return TriangleMesh.from_arrays(np.concatenate([ring, [[0, 0, 100.0], [0, 0, -100.0]]]), faces)


def stretched_plane(count: int) -> tuple[TriangleMesh, np.ndarray]:
    """Random points in a square, Delaunay, then stretched: flat, with convex boundary."""
    points = np.random.default_rng(4).uniform(size=(count, 2))
    triangles = Delaunay(points).simplices
    points = points * [8.0, 1.0]
    u, v = points[triangles[:, 1]] - points[triangles[:, 0]], points[triangles[:, 2]] - points[triangles[:, 0]]
    backwards = u[:, 0] * v[:, 1] < u[:, 1] * v[:, 0]
    triangles[backwards] = triangles[backwards][:, ::-1]
    return TriangleMesh.from_arrays(np.pad(points, [(0, 0), (0, 1)]), triangles), points


def sheared_torus(n: int, shear: int) -> tuple[jax.Array, Topology]:
    """A flat torus of n × n squares, given by the edges of a triangulation that shear has made long."""
    i, j = (part.ravel() for part in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))

    def vertex(a: int, b: int) -> np.ndarray:
        return (i + a) % n * n + (j + b) % n

    lower, upper = (vertex(0, 0), vertex(1, 0), vertex(1, 1)), (vertex(0, 0), vertex(1, 1), vertex(0, 1))
    topology = Topology.from_faces(np.concatenate([np.stack(lower, 1), np.stack(upper, 1)]))
    edges = np.asarray(topology.edges)
    step = np.stack([edges // n, edges % n], axis=-1)
    x, y = ((step[:, 1] - step[:, 0] + n // 2) % n - n // 2).T
    return jnp.asarray(np.hypot(x + shear * y, y)), topology


def thin_strip(count: int) -> TriangleMesh:
    """Two parallel lines of points, joined by one fan from each end: as far from Delaunay as can be."""
    x = np.linspace(0, 1, count)
    points = np.concatenate([np.stack([x, 0 * x, 0 * x], 1), np.stack([x, 0 * x + 0.01, 0 * x], 1)])
    i = np.arange(count - 1)
    faces = [np.stack([0 * i, count + i + 1, count + i], 1), np.stack([i, i + 1, 0 * i + 2 * count - 1], 1)]
    return TriangleMesh.from_arrays(points, np.concatenate(faces))


def grid_torus(n: int, m: int) -> TriangleMesh:
    """Quadrilaterals along the circles of a torus, cut in two: every diagonal's two faces share a circle."""
    u, v = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij")
    points = np.stack([(2 + 0.8 * np.cos(v)) * np.cos(u), (2 + 0.8 * np.cos(v)) * np.sin(u), 1.04 * np.sin(v)], -1)
    return TriangleMesh.from_arrays(points.reshape(-1, 3), sheared_torus_faces(n, m))


def sheared_torus_faces(n: int, m: int) -> np.ndarray:
    i, j = (part.ravel() for part in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    a, b, c, d = (((i + p) % n) * m + (j + q) % m for p, q in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
