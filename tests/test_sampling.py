"""Points spread over surfaces, and surfaces taken apart at their creases."""

import numpy as np
import pytest
from pictures import sphere
from scipy.spatial import cKDTree

from jaxkvf import shapes
from jaxkvf.geometry import normal_displacements, split_at_creases, spread_evenly, vertex_normals


def test_samples_are_even_on_uneven_triangles_and_on_both_sides_of_a_wing():
    x, f = sphere(2000)
    dense = np.concatenate(
        [x, 0.3 * x[:, [1, 2, 0]]]
    )  # a second, denser sphere with the same number of faces
    faces = np.concatenate([f, f + len(x)])
    samples = spread_evenly(dense, faces, 400)
    places = (samples.barycentric[:, :, None] * dense[faces[samples.faces]]).sum(axis=1)
    nearest = cKDTree(places).query(places, k=2)[0][:, 1]
    assert nearest.min() > 0.55 * samples.spacing and nearest.max() < 1.5 * samples.spacing
    inner = (np.linalg.norm(places, axis=1) < 0.5).mean()
    assert abs(inner - 0.09 / 1.09) < 0.02
    wing = x * [1.0, 1.0, 0.002]
    samples = spread_evenly(wing, f, 200)
    assert abs((x[f[samples.faces]].mean(axis=1)[:, 2] > 0).mean() - 0.5) < 0.04
    again = spread_evenly(wing, f, 200)
    np.testing.assert_array_equal(again.barycentric, samples.barycentric)


def quarter_turn(degrees):
    """Two squares that meet in an edge along y, the second turned up by so much."""
    a = np.radians(degrees)
    x = np.array([[-1.0, 0, 0], [0, 0, 0], [np.cos(a), 0, np.sin(a)]])
    x = np.concatenate([x, x + np.array([0, 1.0, 0])])
    return x, np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])


@pytest.mark.parametrize("degrees", [35.0, 45.0, 90.0, 150.0])
def test_an_edge_is_a_crease_where_it_turns_more(degrees):
    x, f = quarter_turn(degrees)
    faces, copied = split_at_creases(x, f, 40.0)
    np.testing.assert_array_equal(copied[faces], f)
    assert len(copied) == 6 + 2 * (degrees > 40)
    np.testing.assert_array_equal(copied[:6], np.arange(6))
    assert (len({1, 4} & set(faces[2:].ravel()) & set(faces[:2].ravel())) == 2) == (degrees < 40)


def test_a_crease_may_end_in_a_smooth_part():
    n = 11
    across, along = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, n), np.linspace(0, 2, n)))
    x = np.stack(
        [across, along, np.abs(across) * np.maximum(1 - along, 0) ** 2], axis=1
    )  # a roof that flattens out
    row, column = (grid.ravel() for grid in np.mgrid[: n - 1, : n - 1])
    a = n * row + column
    f = np.stack([a, a + 1, a + n + 1, a, a + n + 1, a + n], axis=1).reshape(-1, 3)
    faces, copied = split_at_creases(x, f, 40.0)
    np.testing.assert_array_equal(copied[faces], f)
    doubled = np.sort(copied[len(x) :])
    ridge = np.flatnonzero(across == 0)
    np.testing.assert_array_equal(doubled, ridge[: len(doubled)])
    assert len(doubled) and 0.1 < along[doubled[-1]] < 0.4  # 2 arctan((1 − y)²) is 40 degrees at y = 0.4


def test_a_round_thing_has_no_creases_and_each_facet_some_at_a_small_angle():
    for mesh in (shapes.cylinder(24), shapes.icosphere(6)):
        x, f = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        np.testing.assert_array_equal(split_at_creases(x, f, 40.0)[0], f)
        assert len(split_at_creases(x, f, 4.0)[1]) > 1.9 * len(x)


def test_what_is_no_orderly_edge_is_a_crease_and_a_flat_triangle_none():
    x, f = quarter_turn(0.0)
    assert len(split_at_creases(x, f[[0, 1, 2, 3]], 1.0)[1]) == 6
    flipped = np.array([*f[:2], *f[2:, ::-1]])
    assert len(split_at_creases(x, flipped, 179.0)[1]) == 8
    third = np.concatenate([f, [[1, 4, 6]]])
    assert len(split_at_creases(np.vstack([x, [0, 0.5, 1.0]]), third, 179.0)[1]) == 7 + 4
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0], [1, -1, 0]])
    needle = np.array([[0, 1, 3], [1, 2, 3], [0, 2, 1], [0, 4, 2]])
    assert len(split_at_creases(flat, needle, 40.0)[1]) == 5


def test_displacement_along_the_normal_is_signed():
    mesh = shapes.icosphere(12)
    for factor in (1.1, 0.9):
        moved = normal_displacements(mesh.vertices, factor * mesh.vertices, mesh.topology)
        np.testing.assert_allclose(moved, factor - 1, rtol=0.01)
    turned = mesh.vertices + np.cross([0.0, 0, 0.01], np.asarray(mesh.vertices))
    assert np.abs(normal_displacements(mesh.vertices, turned, mesh.topology)).max() < 1e-4
    normals = np.asarray(vertex_normals(mesh.vertices, mesh.topology))
    assert (normals * np.asarray(mesh.vertices)).sum(axis=1).min() > 0.999
