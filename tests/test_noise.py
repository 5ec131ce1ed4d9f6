"""Noise along the normals: seeded, of the scale that was asked for."""

import numpy as np

from jaxkvf import TriangleMesh
from jaxkvf.mesh import shapes


def edge_lengths(mesh: TriangleMesh) -> np.ndarray:
    vertices, edges = np.asarray(mesh.vertices), np.asarray(mesh.topology.edges)
    return np.linalg.norm(vertices[edges[:, 1]] - vertices[edges[:, 0]], axis=1)


def test_noise_moves_vertices_along_their_normals_by_its_scale():
    mesh = shapes.icosphere(24, radius=3.0)
    noisy = shapes.add_normal_noise(mesh, 0.05, seed=7)
    moved = np.asarray(noisy.vertices) - np.asarray(mesh.vertices)
    radial = np.asarray(mesh.vertices) / 3
    along = (moved * radial).sum(axis=1)
    assert np.linalg.norm(moved - along[:, None] * radial, axis=1).max() < 0.02 * np.abs(along).max()
    numbers = np.random.default_rng(7).standard_normal(len(along))
    assert np.allclose(along, 0.05 * edge_lengths(mesh).mean() * numbers, rtol=1e-3)
    assert np.array_equal(noisy.faces, mesh.faces)


def test_noise_seeds_and_no_noise():
    mesh = shapes.icosphere(3)
    one, same, other = (shapes.add_normal_noise(mesh, 0.1, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.vertices, same.vertices)
    assert not np.array_equal(one.vertices, other.vertices)
    assert np.array_equal(shapes.add_normal_noise(mesh, 0).vertices, mesh.vertices)
