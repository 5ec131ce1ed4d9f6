"""What a Killing flow does to lengths and distances; its period, its discrete groups, and the algebra of the sphere."""

import numpy as np
import pytest

import jaxkvf
from jaxkvf import geometry as g
from jaxkvf import shapes, surface_positions, vertex_points
from jaxkvf.flows import (
    FlowStatus,
    distance_distortion,
    flow,
    integral_curves,
    isometry_error,
    lie_bracket,
    orbit,
    period,
)


def turning(mesh):
    x = np.asarray(mesh.vertices)
    return np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1)


def killing(mesh):
    """The lowest field and its angular velocity."""
    field = jaxkvf.killing_fields(mesh, 1).vectors[0]
    turn = turning(mesh)
    return field, float((np.asarray(field) * turn).sum() / (turn**2).sum())


def whole_period(frequency):
    mesh = shapes.ellipsoid(frequency)
    field, angular = killing(mesh)
    found = period(mesh, field, curves=32)
    change = isometry_error(mesh, field, found.period)
    edge = float(g.edge_lengths(mesh.vertices, mesh.topology).mean())
    gap = np.linalg.norm(np.asarray(change.vertices - mesh.vertices), axis=1).mean() / edge
    return found.period / (2 * np.pi / abs(angular)) - 1, change, gap, found


@pytest.mark.slow
def test_a_period_of_a_spheroid_is_nearly_an_isometry():
    error, change, gap, found = whole_period(16)
    assert abs(error) <= 3e-3 and gap <= 0.2
    assert change.relative_rms <= 1.3e-3 and change.finished == 1
    assert change.err == change.relative_rms / 7680
    assert found.closed.all() and found.spread < 2e-3 and np.nanmax(found.gaps) < 1e-3


@pytest.mark.slow
def test_the_spheroid_of_10_242_vertices():
    error, change, gap, found = whole_period(32)
    assert abs(error) <= 1e-3 and found.spread < 1e-3
    assert change.relative_rms <= 5e-4 and change.err <= 2e-8
    assert change.finished == 1 and gap <= 0.2
    order = np.log2(whole_period(8)[1].relative_rms / change.relative_rms) / 2
    assert order >= 1.8


def test_geodesic_distances_are_kept():
    mesh = shapes.ellipsoid(8)
    kept = distance_distortion(mesh, turning(mesh), 0.2, sources=2)
    x = np.asarray(mesh.vertices)
    gradient = np.array([0, 0, 1.0]) * np.ones_like(x)  # moves points towards a pole: no isometry
    lost = distance_distortion(mesh, gradient, 0.2, sources=2)
    assert kept.largest < 0.02 and kept.rms < 0.003
    assert lost.largest > 0.1 and lost.rms > 10 * kept.rms


@pytest.mark.slow
def test_orbits_are_regular_polygons():
    mesh = shapes.ellipsoid(16)
    field = 0.5 * turning(mesh)
    start = vertex_points(mesh, [300, 700, 1100])
    found = orbit(mesh, field, 5, start, period=4 * np.pi)
    assert found.points.faces.shape == (5, 3) and found.points.barycentric.shape == (5, 3, 3)
    x = np.asarray(surface_positions(mesh, found.points))
    angle = np.arctan2(x[..., 1], x[..., 0])
    steps = np.mod(np.diff(angle, axis=0, append=angle[:1]), 2 * np.pi)
    np.testing.assert_allclose(steps, 2 * np.pi / 5, atol=5e-3)
    np.testing.assert_allclose(x[..., 2], np.broadcast_to(x[:1, :, 2], (5, 3)), atol=2e-3)
    assert float(found.closure.max()) < 5e-3
    # The default period is the same.
    again = orbit(mesh, field, 5, start)
    np.testing.assert_allclose(np.asarray(again.closure), 0, atol=5e-3)


def test_the_spheres_algebra_closes():
    """so(3): the brackets of the three computed fields lie in their span, and have so(3)'s structure constants."""
    mesh = shapes.icosphere(16)
    fields = np.asarray(jaxkvf.killing_fields(mesh, 3).vectors)
    basis = fields.reshape(3, -1)
    areas = np.repeat(
        np.asarray(g.barycentric_vertex_areas(g.edge_lengths(mesh.vertices, mesh.topology), mesh.topology)), 3
    )
    structure = np.zeros((3, 3, 3))
    for i, j in ((0, 1), (1, 2), (2, 0)):
        bracket = np.asarray(lie_bracket(mesh, fields[i], fields[j])).ravel()
        coefficients = basis @ (areas * bracket)
        rest = bracket - coefficients @ basis
        assert np.sqrt((areas * rest**2).sum() / (areas * bracket**2).sum()) < 5e-3
        structure[i, j], structure[j, i] = coefficients, -coefficients
    # Unit norm is angular velocity √(3/8π); in such a basis the structure constants are ± that number.
    size = np.sqrt(3 / (8 * np.pi))
    expected = np.zeros((3, 3, 3))
    sign = np.sign(structure[0, 1, 2])
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        expected[i, j, k], expected[j, i, k] = sign * size, -sign * size
    np.testing.assert_allclose(structure, expected, atol=5e-3 * size)


def test_linear_combinations_flow_along_the_sum():
    """Fig. 14 (e): on the sphere the sum of two turns is a turn about the axis between."""
    mesh = shapes.icosphere(8)
    x = np.asarray(mesh.vertices)
    both = turning(mesh) + np.cross([1.0, 0, 0], x)
    found = period(mesh, both, curves=32)
    assert found.period == pytest.approx(2 * np.pi / np.sqrt(2), rel=5e-3)
    assert found.closed.all()


def test_integral_curves_have_times_and_end_at_the_boundary():
    mesh = shapes.disk(6)
    vectors = np.tile([1.0, 0, 0], (mesh.topology.n_vertices, 1))
    start = vertex_points(mesh, [0, 1])
    curves = integral_curves(mesh, vectors, 2.0, start, samples=20)
    assert curves.positions.shape == (2, 21, 3) and curves.times.shape == (2, 21)
    assert (curves.status == FlowStatus.LEFT).all()
    np.testing.assert_allclose(curves.times[:, :8], np.tile(0.1 * np.arange(8), (2, 1)))
    for x, line, t in zip(
        np.asarray(mesh.vertices)[:2], curves.polylines(), np.asarray(curves.times), strict=True
    ):
        np.testing.assert_allclose(line[:, 0], x[0] + t[: len(line)], atol=1e-12)
        assert len(line) < 21 and np.hypot(*line[-1, :2]) > np.cos(np.pi / 36) - 1e-12


def test_bad_input_is_named():
    mesh = shapes.icosphere(4)
    turn, points = turning(mesh), vertex_points(mesh, [5])
    for m in (0, -1):
        with pytest.raises(ValueError, match="m must be an integer of at least 1"):
            orbit(mesh, turn, m, points, period=1.0)
    with pytest.raises(ValueError, match="zero everywhere"):
        period(mesh, 0 * turn)
    x = np.asarray(mesh.vertices)
    with pytest.raises(ValueError, match="the field has no period: none of 32 integral curves closes"):
        period(mesh, np.array([0, 0, 1.0]) - x[:, 2:] * x, curves=32)
    with pytest.raises(ValueError, match="samples must be an integer"):
        integral_curves(mesh, turn, 1.0, points, samples=0)
    assert flow(mesh, turn, 0.0, points).status.tolist() == [FlowStatus.ARRIVED]
