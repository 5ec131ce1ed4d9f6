"""What a mesh cannot bear is seen: needles, spikes, extreme scales, and too few triangles."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bad_triangles import central_difference

from jaxkvf import TriangleMesh, intrinsic_killing_eigenvalues, killing_eigenvalues, killing_fields, shapes
from jaxkvf.geometry import edge_lengths, intrinsic_delaunay, length_unit, subdivided, surface_area
from jaxkvf.killing import Pieces, thin_faces


def lathe() -> tuple[np.ndarray, np.ndarray]:
    """A spheroid 1 : 1.6 of 7 rings of 12 vertices and two tips, exactly symmetric: λ₀ = 0."""
    mesh = shapes.surface_of_revolution(np.sin, lambda t: -1.6 * np.cos(t), 8, 12)
    return np.array(mesh.vertices), np.array(mesh.faces)


def with_cap(vertices: np.ndarray, faces: np.ndarray, height: float) -> TriangleMesh:
    """One more vertex in face 60, so near the middle of its first side that a face is `height` of it high."""
    a, b, c = faces[60]
    middle = (vertices[a] + vertices[b]) / 2
    point, number = middle + height * (vertices[c] - middle), len(vertices)
    around = [(a, b, number), (b, c, number), (c, a, number)]
    return TriangleMesh.from_arrays(
        np.vstack([vertices, point]), np.vstack([np.delete(faces, 60, axis=0), around])
    )


def test_faces_that_are_mollified_are_named():
    vertices, faces = lathe()
    for height, count in ((1e-3, 0), (1e-7, 1)):
        mesh = with_cap(vertices, faces, height)
        thin = np.flatnonzero(thin_faces(edge_lengths(mesh.vertices, mesh.topology), mesh.topology))
        assert len(thin) == count
        assert (np.asarray(mesh.faces)[thin] == len(vertices)).any(axis=1).all()  # at the vertex put in


def box() -> tuple[np.ndarray, np.ndarray]:
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([face for a, b, c, d in sides for face in ((a, b, c), (a, c, d))])


def lowest(mesh: TriangleMesh, k: int) -> np.ndarray:
    pieces = Pieces(edge_lengths(mesh.vertices, mesh.topology), mesh.topology)
    return pieces.smallest(np.arange(mesh.topology.n_faces), k)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_flat_face_however_thin_leaves_the_others_their_energy(dtype):
    vertices, faces = lathe()
    least = 1e-12 if dtype is np.float64 else 1e-6
    expected = lowest(TriangleMesh.from_arrays(vertices, faces), 3)
    slack = 2e-3 if dtype is np.float64 else 2e-2
    for height in np.geomspace(1e-2, least, 6):
        mesh = with_cap(vertices.astype(dtype), faces, height)
        found = lowest(mesh, 3)
        assert found[0] > (-1e-6 if dtype is np.float64 else -5e-3)
        np.testing.assert_allclose(found[:2], expected[:2], rtol=2e-3, atol=slack)


def test_derivatives_pass_through_a_mollified_face():
    """As through a thicker one, where differences still tell them: the surface is the same."""

    def slope_and_difference(height: float) -> tuple[float, float]:
        mesh = with_cap(*lathe(), height)
        direction = jnp.asarray(np.random.default_rng(0).standard_normal(mesh.vertices.shape))
        direction = direction.at[-1].set(direction[np.asarray(mesh.faces)[-3, :2]].mean(axis=0))  # stays thin

        @jax.jit
        def energy(x):
            lengths = edge_lengths(x, mesh.topology)
            return intrinsic_killing_eigenvalues(lengths, mesh.topology, 2).sum()

        slope = jnp.vdot(jax.grad(energy)(mesh.vertices), direction)
        return float(slope), float(central_difference(energy, mesh.vertices, direction, 1e-6))

    slope, expected = slope_and_difference(1e-3)
    np.testing.assert_allclose(slope, expected, rtol=1e-4)
    np.testing.assert_allclose(slope_and_difference(1e-6)[0], slope, rtol=1e-2)


def test_flips_leave_every_vertex_the_edges_that_hold_its_vector():
    vertices, faces = lathe()
    for outlier in (8.0, 10.0, 20.0, 1000.0):
        spiked = vertices.copy()
        spiked[41] *= outlier
        mesh = TriangleMesh.from_arrays(spiked, faces)
        found = intrinsic_delaunay(mesh, least_degree=3)
        assert int(found.flips) > 0 and np.asarray(found.topology.vertex_degrees).min() >= 3
        values = Pieces(found.lengths, found.topology).smallest(np.arange(len(faces)), 1)
        assert 0.5 * lowest(mesh, 1)[0] < values[0] < 2 * lowest(mesh, 1)[0]


def test_values_are_the_same_at_every_scale():
    """Powers of two change no digit; others but the last ones."""
    mesh = shapes.icosphere(2)
    expected = killing_fields(mesh, 5)
    for exponent in (-480, -100, 100, 480):
        found = killing_fields(mesh.with_vertices(mesh.vertices * 2.0**exponent), 5)
        np.testing.assert_array_equal(found.dimensionless, expected.dimensionless)
        np.testing.assert_array_equal(found.vectors * 2.0**exponent, expected.vectors)
        np.testing.assert_array_equal(found.coefficients * 2.0**exponent, expected.coefficients)
    for scale in (1e-140, 1e-30, 1e30, 1e140):
        found = killing_eigenvalues(mesh.with_vertices(mesh.vertices * scale), 5) * scale**2
        np.testing.assert_allclose(found, expected.eigenvalues, rtol=1e-9, atol=1e-9)
    assert length_unit(jnp.asarray([3.0, 3.5, 3.9])) == 4.0


def test_a_subdivision_is_the_same_surface():
    mesh = shapes.icosphere(2)
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    finer, topology = subdivided(lengths, mesh.topology)
    x = np.asarray(mesh.vertices)
    tail, head = np.asarray(mesh.topology.edges).T
    x = np.concatenate([x, (x[tail] + x[head]) / 2])
    tail, head = np.asarray(topology.edges).T
    np.testing.assert_allclose(finer, np.linalg.norm(x[tail] - x[head], axis=1), rtol=1e-12)
    assert topology.euler_characteristic == 2 and topology.n_faces == 4 * mesh.topology.n_faces
    np.testing.assert_allclose(
        surface_area(finer, topology), surface_area(lengths, mesh.topology), rtol=1e-12
    )


def test_zeros_of_a_coarse_mesh_are_not_trusted_and_those_of_a_symmetric_one_are():
    cube = killing_fields(TriangleMesh.from_arrays(*box()), 4)
    assert (np.abs(np.asarray(cube.dimensionless)[:3]) < 1e-9).all() and not np.asarray(cube.trusted)[
        :3
    ].any()
    icosahedron = killing_fields(shapes.icosphere(1), 3)
    assert (np.abs(np.asarray(icosahedron.dimensionless)) < 1e-9).all()
    assert not np.asarray(icosahedron.trusted).any()
    for mesh, count in ((shapes.icosphere(2), 3), (TriangleMesh.from_arrays(*lathe()), 1)):
        fields = killing_fields(mesh, count)
        assert (np.abs(np.asarray(fields.dimensionless)) < 1e-3).all() and np.asarray(fields.trusted).all()
