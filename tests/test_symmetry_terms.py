"""Prices of moving a mesh, against closed forms."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxkvf
from jaxkvf import shapes
from jaxkvf.symmetrization import (
    Configuration,
    LengthFidelity,
    NormalFidelity,
    PositionFidelity,
    ShapeBarrier,
    VolumeFidelity,
)


def price(term, mesh, vertices):
    return float(term(Configuration.of(mesh.with_vertices(vertices)), Configuration.of(mesh)))


def test_of_a_shift():
    mesh = shapes.icosphere(3)
    unit = float(Configuration.of(mesh).unit)
    shifted = mesh.vertices + jnp.asarray([[0.1 * unit, 0, 0]])
    np.testing.assert_allclose(price(PositionFidelity(2.0), mesh, shifted), 2 * 0.01, rtol=1e-12)
    # The mean square of a component of a sphere's normals is a third.
    np.testing.assert_allclose(price(NormalFidelity(2.0), mesh, shifted), 2 * 0.01 / 3, rtol=1e-3)
    for term in (ShapeBarrier(1.0), LengthFidelity(1.0), VolumeFidelity(1.0)):
        np.testing.assert_allclose(price(term, mesh, shifted), 0, atol=1e-20)


def test_of_a_stretch():
    mesh = shapes.icosphere(3)
    edges = np.asarray(Configuration.of(mesh).lengths)
    for s in (0.5, 2.0):
        stretched = s * mesh.vertices
        # ½ (2s² + 2/s²) − 2
        np.testing.assert_allclose(price(ShapeBarrier(1.0), mesh, stretched), s**2 + s**-2 - 2, rtol=1e-10)
        np.testing.assert_allclose(
            price(VolumeFidelity(3.0), mesh, stretched), 3 * (s**3 - 1) ** 2, rtol=1e-10
        )
        radii = (np.asarray(mesh.vertices) ** 2).sum(axis=1)
        displaced = (s - 1) ** 2 * radii.mean() / edges.mean() ** 2
        np.testing.assert_allclose(price(PositionFidelity(2.0), mesh, stretched), 2 * displaced, rtol=1e-10)
        mean_square = (edges**2).mean() / edges.mean() ** 2
        np.testing.assert_allclose(
            price(LengthFidelity(1.0), mesh, stretched), (s - 1) ** 2 * mean_square, rtol=1e-10
        )


def test_the_barrier_is_symmetric_dirichlet_energy():
    """Of random affine maps of a triangle, by singular values."""
    random = np.random.default_rng(0)
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0.3, 0.8, 0]])
    mesh = jaxkvf.TriangleMesh.from_arrays(triangle, [[0, 1, 2]])
    for _ in range(3):
        J = random.standard_normal((2, 2))
        s = np.linalg.svd(J, compute_uv=False)
        moved = np.zeros((3, 3))
        moved[:, :2] = triangle[:, :2] @ J.T
        expected = 0.5 * (s**2 + s**-2).sum() - 2
        np.testing.assert_allclose(price(ShapeBarrier(1.0), mesh, jnp.asarray(moved)), expected, rtol=1e-9)


def test_the_barrier_grows_without_bound_towards_slivers():
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0.8, 0]])
    mesh = jaxkvf.TriangleMesh.from_arrays(triangle, [[0, 1, 2]])
    prices = [
        price(ShapeBarrier(1.0), mesh, jnp.asarray(triangle * [1, height, 1]))
        for height in (1e-1, 1e-2, 1e-3)
    ]
    np.testing.assert_allclose(np.diff(np.log10(prices)), 2, atol=0.05)


def test_volume_needs_a_closed_surface():
    disk = shapes.disk(2)
    with pytest.raises(ValueError, match="closed surfaces"):
        price(VolumeFidelity(), disk, disk.vertices)


def test_the_barrier_weighs_triangles_by_their_area():
    """Two, apart, of which the larger is stretched by 2 in one direction: ½ (4 + ¼ + 2) − 2, times its share."""
    triangles = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 0, 0], [9, 0, 0], [5, 2, 0]])
    mesh = jaxkvf.TriangleMesh.from_arrays(triangles, [[0, 1, 2], [3, 4, 5]])
    moved = triangles.copy()
    moved[4, 0] += 4
    expected = 3 * (0.5 * 6.25 - 2) * 4 / 4.5
    np.testing.assert_allclose(price(ShapeBarrier(3.0), mesh, jnp.asarray(moved)), expected, rtol=1e-12)
    with pytest.raises(ValueError, match="weight must be finite and at least 0, got -1"):
        ShapeBarrier(-1.0)
