"""Pieces of a surface: regions, local symmetry, decomposition, components."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxkvf import (
    DenseEigh,
    TriangleMesh,
    component_shares,
    killing_eigenvalues,
    killing_fields,
    local_symmetry,
    shapes,
    symmetric_parts,
)
from jaxkvf.geometry import edge_lengths, intrinsic_delaunay, surface_area
from jaxkvf.killing import Pieces, Regge
from jaxkvf.sparse import to_scipy


def two_spheres() -> TriangleMesh:
    a, b = shapes.ellipsoid(3), shapes.icosphere(3)
    n = a.topology.n_vertices
    vertices = np.concatenate([np.asarray(a.vertices), np.asarray(b.vertices) + 5])
    return TriangleMesh.from_arrays(vertices, np.concatenate([np.asarray(a.faces), np.asarray(b.faces) + n]))


def test_a_region_is_the_mesh_of_its_faces():
    mesh = shapes.icosphere(4)
    mask = np.asarray(mesh.vertices)[np.asarray(mesh.faces)][..., 2].min(axis=1) > 0.2
    piece, origins = mesh.submesh(mask)
    assert piece.topology.boundary_loops()[0] == 1
    np.testing.assert_array_equal(piece.vertices, np.asarray(mesh.vertices)[origins])
    fields = killing_fields(mesh, 2, region=mask, solver=DenseEigh())
    np.testing.assert_allclose(
        fields.eigenvalues, killing_eigenvalues(piece, 2, solver=DenseEigh()), atol=1e-10
    )
    by_number = killing_fields(mesh, 2, region=np.flatnonzero(mask), solver=DenseEigh())
    np.testing.assert_allclose(by_number.eigenvalues, fields.eigenvalues, atol=1e-12)
    speed = np.linalg.norm(np.asarray(fields.vectors), axis=2)
    outside = np.setdiff1d(np.arange(mesh.topology.n_vertices), origins)
    assert not speed[:, outside].any() and (speed[0, origins] > 0).any()


def test_faces_that_touch_in_a_point_are_cut_there():
    mesh = shapes.icosphere(3)
    around = np.flatnonzero((np.asarray(mesh.faces) == 20).any(axis=1))
    ring = (
        np.asarray(mesh.topology.spoke_corners)[np.asarray(mesh.topology.spoke_starts)[20] :][: len(around)]
        // 3
    )
    piece, origins = mesh.submesh(ring[[0, 2]])
    assert piece.topology.components()[0] == 2 and (origins == 20).sum() == 2


def test_what_is_no_region_is_refused():
    mesh = shapes.icosphere(1)
    for region, message in (
        (np.zeros(20, bool), "has no face"),
        (np.ones(3, bool), r"must have shape \[20\]"),
        ([0, 99], "must name faces"),
        ([0, 0], "each once"),
        ([0.5], "a mask or numbers"),
    ):
        with pytest.raises(ValueError, match=message):
            killing_fields(mesh, 1, region=region)


@pytest.mark.slow
def test_components_are_told_apart():
    mesh = two_spheres()
    count, component = mesh.topology.components()
    assert count == 2
    fields = killing_fields(mesh, 6, solver=DenseEigh())
    shares = component_shares(mesh, fields)
    np.testing.assert_allclose(shares.sum(axis=1), 1)
    apart = [
        killing_eigenvalues(
            mesh.submesh(component[np.asarray(mesh.faces)[:, 0]] == c)[0], 6, solver=DenseEigh()
        )
        for c in range(2)
    ]
    np.testing.assert_allclose(fields.eigenvalues, np.sort(np.concatenate(apart))[:6], rtol=1e-9, atol=1e-12)
    slow = killing_fields(mesh, 6, region=component[np.asarray(mesh.faces)[:, 0]] == 0, solver=DenseEigh())
    np.testing.assert_allclose(component_shares(mesh, slow)[:, 0], 1)


@pytest.mark.slow
def test_a_piece_has_the_matrices_of_regge():
    """The whole of a closed surface is its `regge` on the intrinsic Delaunay triangulation; a flat piece has a symmetry."""
    mesh = shapes.random_sphere(200, seed=4, radii=(1.0, 1.5, 2.0))
    found = intrinsic_delaunay(mesh, least_degree=3)
    whole = Pieces(found.lengths, found.topology).smallest(np.arange(mesh.topology.n_faces), 1)[0]
    area = surface_area(found.lengths, found.topology)
    expected = killing_eigenvalues(mesh, 1, discretization="regge-delaunay", solver=DenseEigh())[0] * area
    np.testing.assert_allclose(whole, expected, rtol=1e-7)
    disk = shapes.disk(6)
    piece = Pieces(edge_lengths(disk.vertices, disk.topology), disk.topology)
    assert np.abs(piece.smallest(np.arange(100), 3)).max() < 1e-10


def test_the_matrices_of_all_faces_are_those_of_regge():
    mesh = shapes.random_sphere(60, seed=4, radii=(1.0, 1.5, 2.0))
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    problem = Regge().eigenproblem(lengths, mesh.topology)
    A, B, vertices = Pieces(lengths, mesh.topology).matrices(np.arange(mesh.topology.n_faces))
    np.testing.assert_array_equal(vertices, np.arange(60))
    np.testing.assert_allclose(A.toarray(), to_scipy(problem.A).toarray(), atol=1e-12 * abs(A).max())
    np.testing.assert_allclose(B.toarray(), to_scipy(problem.B).toarray(), atol=1e-14)


def test_a_region_that_touches_itself_is_refused_and_the_remedy_works():
    mesh = shapes.icosphere(3)
    around = np.flatnonzero((np.asarray(mesh.faces) == 20).any(axis=1))
    starts, corners = np.asarray(mesh.topology.spoke_starts), np.asarray(mesh.topology.spoke_corners)
    ring = corners[starts[20] :][: len(around)] // 3
    with pytest.raises(ValueError, match=r"touches itself in vertex 20, .*`mesh.submesh\(region\)`"):
        killing_fields(mesh, 1, region=ring[[0, 2]])
    piece, origins = mesh.submesh(ring[[0, 2]])
    both = np.flatnonzero(origins == 20)
    fields = killing_fields(piece, 6, solver=DenseEigh())  # two loose triangles: three symmetries each
    assert (np.abs(np.asarray(fields.dimensionless)) < 1e-10).all()
    assert (np.linalg.norm(np.asarray(fields.vectors)[:, both], axis=2).max(axis=0) > 0.1).all()


def test_a_component_without_a_sample_has_no_value():
    sphere = shapes.icosphere(2)
    x, faces, n = np.asarray(sphere.vertices), np.asarray(sphere.faces), sphere.topology.n_vertices
    three = TriangleMesh.from_arrays(
        np.concatenate([x, x * [1, 1, 2] + 5, x * [1, 2, 3] + 10]),
        np.concatenate([faces, faces + n, faces + 2 * n]),
    )
    values = local_symmetry(three, 10.0, samples=2).values.reshape(3, n)
    sampled = np.isfinite(values).all(axis=1)
    assert sampled.sum() == 2 and np.isnan(values[~sampled]).all()


@pytest.mark.slow
def test_local_symmetry_tells_a_smooth_end_from_a_bumpy_one():
    sphere = shapes.ellipsoid(8, (0.6, 0.6, 2.0))
    x = np.array(sphere.vertices)
    bumpy = x[:, 2] > 0.4
    angle = np.arctan2(x[:, 1], x[:, 0])
    x[:, :2] *= (
        1 + np.where(bumpy, 0.35 * np.clip(x[:, 2] - 0.4, 0, 0.4) / 0.4 * np.cos(3 * angle), 0.0)[:, None]
    )
    mesh = sphere.with_vertices(jnp.asarray(x))
    found = local_symmetry(mesh, 1.0, samples=12)
    assert found.values.shape == (mesh.topology.n_vertices,) and (found.sample_values >= -1e-9).all()
    z = x[:, 2]
    assert np.median(found.values[z > 0.9]) > 10 * np.median(found.values[z < -0.9])

    parts = symmetric_parts(mesh, 0.05, most=2, samples=6)
    assert (parts.values <= 0.05).all() and len(parts.values) >= 1
    largest = parts.vertex_parts == 0
    assert z[largest].mean() < 0 and largest.sum() > 0.3 * len(z)
    area = surface_area(edge_lengths(mesh.vertices, mesh.topology), mesh.topology)
    assert 0.25 * area < parts.areas[0] < area


def test_wrong_arguments_are_refused():
    mesh = shapes.icosphere(1)
    for bad, message in (
        (lambda: local_symmetry(mesh, 0.0), "radius must be positive"),
        (lambda: local_symmetry(mesh, 1.0, samples=0), "samples must be an integer of at least 1"),
        (lambda: symmetric_parts(mesh, -1.0), "tolerance must be positive"),
    ):
        with pytest.raises(ValueError, match=message):
            bad()


@pytest.mark.slow
def test_the_hammers_handle_is_more_symmetric_than_its_head(real_mesh_folder):
    mesh = TriangleMesh.load(real_mesh_folder / "hammer.obj")
    x = np.asarray(mesh.vertices)
    axis = np.ptp(x, axis=0).argmax()
    along = (x[:, axis] - x[:, axis].min()) / np.ptp(x[:, axis])
    found = local_symmetry(mesh, 0.15 * np.ptp(x[:, axis]), samples=24)
    handle, head = (along > 0.25) & (along < 0.6), along > 0.93
    assert np.median(found.values[head]) > 10 * np.median(found.values[handle])
