"""Harmonic fields: as many as the topology asks for, in the kernel, right at boundaries, constant against Killing fields."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxkvf
from jaxkvf import TriangleMesh, shapes
from jaxkvf import geometry as g
from jaxkvf.exterior import d1, hodge_laplacian1
from jaxkvf.sparse import to_scipy


def two_handled(n=9):
    """A closed surface of genus 2: the boundary of a slab of cubes with two holes."""
    solid = np.ones((n, 5, 1), bool)
    solid[2, 2] = solid[6, 2] = False
    corner, quads = {}, []
    padded = np.pad(solid, 1)
    for cell in np.argwhere(padded):
        for axis in range(3):
            for side in (0, 1):
                other = cell.copy()
                other[axis] += 2 * side - 1
                if padded[tuple(other)]:
                    continue
                u, v = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
                start = cell + side * np.eye(3, dtype=int)[axis]
                ring = [start, start + u, start + u + v, start + v]
                ids = [corner.setdefault(tuple(p), len(corner)) for p in ring]
                quads.append(ids if side else ids[::-1])
    q = np.array(quads)
    return TriangleMesh.from_arrays(
        np.array(list(corner), float), np.concatenate([q[:, :3], q[:, [0, 2, 3]]])
    )


def in_the_kernel(mesh, forms):
    lengths = g.edge_lengths(mesh.vertices, mesh.topology)
    laplacian = to_scipy(hodge_laplacian1(lengths, mesh.topology))
    return np.abs(laplacian @ np.asarray(forms).T).max() / np.abs(np.asarray(forms)).max()


@pytest.mark.parametrize(
    ("make", "count"),
    [
        pytest.param(lambda: shapes.icosphere(3), 0, marks=pytest.mark.slow),
        (lambda: shapes.torus(16, 8), 2),
        pytest.param(two_handled, 4, marks=pytest.mark.slow),
        pytest.param(lambda: shapes.disk(3), 0, marks=pytest.mark.slow),
        (lambda: shapes.annulus(4), 1),
        pytest.param(lambda: shapes.cylinder(12), 1, marks=pytest.mark.slow),
    ],
    ids=["sphere", "torus", "genus 2", "disk", "annulus", "cylinder"],
)
def test_as_many_as_the_topology_asks_for(make, count):
    mesh = make()
    for boundary in ("tangential", "normal"):
        found = jaxkvf.harmonic_fields(mesh, boundary=boundary)
        assert found.vectors.shape == (count, mesh.topology.n_vertices, 3)
        assert found.forms.shape == (count, mesh.topology.n_edges)
        if count:
            curl = to_scipy(d1(mesh.topology, float)) @ np.asarray(found.forms).T
            assert np.abs(curl).max() < 1e-11
    if count and not np.asarray(mesh.topology.is_boundary_edge).any() and count == 2:
        assert in_the_kernel(mesh, found.forms) < 1e-9


def test_on_an_annulus_they_are_the_angle_and_the_logarithm():
    mesh = shapes.annulus(12)
    x, y, _ = np.asarray(mesh.vertices).T
    r2 = x**2 + y**2
    scale = 1 / np.sqrt(2 * np.pi * np.log(2))  # ∫ r⁻² = 2π log(outer / inner)
    for boundary, direction in (("tangential", (-y, x)), ("normal", (x, y))):
        field = np.asarray(jaxkvf.harmonic_fields(mesh, boundary=boundary).vectors[0])
        exact = scale * np.stack([*direction, 0 * x], axis=1) / r2[:, None]
        sign = np.sign((field * exact).sum())
        assert np.abs(sign * field - exact).max() < 0.05 * np.abs(exact).max()
        assert np.linalg.norm(sign * field - exact) < 0.02 * np.linalg.norm(exact)


def variation(n_major):
    """Coefficient of variation of the products of both harmonic fields of a torus with the turn about its axis."""
    mesh = shapes.torus(n_major, n_major // 2)
    x = np.asarray(mesh.vertices)
    turn = np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1)
    products = np.einsum("bvd,vd->bv", np.asarray(jaxkvf.harmonic_fields(mesh).vectors), turn)
    areas = np.asarray(
        g.barycentric_vertex_areas(g.edge_lengths(mesh.vertices, mesh.topology), mesh.topology)
    )
    mean = products @ areas / areas.sum()
    spread = np.sqrt((products - mean[:, None]) ** 2 @ areas / areas.sum())
    largest = np.abs(mean).max()
    return mesh.topology.n_vertices, spread.max() / largest


@pytest.mark.slow
def test_the_product_with_a_killing_field_is_constant():
    """Fig. 12, after Yano."""
    (_, coarse), (n, fine) = variation(70), variation(142)
    assert n > 10_000 and fine <= 0.01 and fine < 0.5 * coarse


@pytest.mark.slow
def test_orthonormal_and_whatever_the_components():
    torus = shapes.torus(16, 8)
    n = torus.topology.n_vertices
    both = TriangleMesh.from_arrays(
        np.concatenate([np.asarray(torus.vertices), np.asarray(torus.vertices) + 10]),
        np.concatenate([np.asarray(torus.faces), np.asarray(torus.faces) + n]),
    )
    found = jaxkvf.harmonic_fields(both)
    assert found.vectors.shape == (4, 2 * n, 3)
    areas = g.barycentric_vertex_areas(g.edge_lengths(both.vertices, both.topology), both.topology)
    products = jnp.einsum("avd,v,bvd->ab", found.vectors, areas, found.vectors)
    np.testing.assert_allclose(products, np.eye(4), atol=0.02)


def test_an_unknown_boundary_is_named():
    with pytest.raises(ValueError, match="boundary must be 'tangential' or 'normal', got 'open'"):
        jaxkvf.harmonic_fields(shapes.disk(2), boundary="open")
