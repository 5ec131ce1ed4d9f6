"""Symmetrization: how far λ·area falls, at what displacement, and what it leaves alone."""

import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

import jaxkvf
from jaxkvf import geometry as g
from jaxkvf import shapes
from jaxkvf.symmetry import OUTCOMES, PositionFidelity, ShapeBarrier


def smallest_angle(mesh):
    lengths = g.edge_lengths(mesh.vertices, mesh.topology)
    return float(g.corner_angles(lengths, mesh.topology).min())


def test_a_noisy_spheroid_becomes_symmetric():
    """5 % normal noise on 1,442 vertices: λ₀·area falls by 1e5, moving the vertices by less than the noise did."""
    clean = shapes.ellipsoid(12)
    noisy = shapes.add_normal_noise(clean, 0.05, seed=0)
    before = float(jaxkvf.killing_fields(noisy, 1).dimensionless[0])
    seen = []
    done = jaxkvf.symmetrize(noisy, callback=seen.append)
    after = float(jaxkvf.killing_fields(done.mesh, 1).dimensionless[0])
    assert done.result == OUTCOMES.successful
    assert before / after >= 1e5
    unit = float(g.edge_lengths(clean.vertices, clean.topology).mean())

    def rms(x, y):
        return np.sqrt((np.asarray(x - y) ** 2).sum(1).mean()) / unit

    assert rms(done.mesh.vertices, noisy.vertices) <= rms(noisy.vertices, clean.vertices)
    assert smallest_angle(done.mesh) >= 0.8 * smallest_angle(noisy)

    assert seen == list(done.history)
    last = done.history[-1]
    np.testing.assert_allclose(last.dimensionless[0], after, rtol=1e-6)
    np.testing.assert_allclose(last.rms_displacement, rms(done.mesh.vertices, noisy.vertices), rtol=0.02)
    np.testing.assert_allclose(np.radians(last.smallest_angle), smallest_angle(done.mesh), rtol=1e-9)
    objective = [step.dimensionless[0] + step.terms.sum() for step in done.history]
    assert (np.diff(objective) <= 0).all()


@pytest.mark.slow
def test_three_symmetries_of_a_noisy_sphere():
    noisy = shapes.add_normal_noise(shapes.icosphere(6), 0.05, seed=1)
    done = jaxkvf.symmetrize(noisy, count=3, rtol=1e-3)
    first, last = done.history[0], done.history[-1]
    assert last.dimensionless[:3].sum() <= 1e-3 * first.dimensionless[:3].sum() + 1e-9
    assert done.result == OUTCOMES.successful


def test_it_is_deterministic_and_leaves_its_input_alone():
    noisy = shapes.add_normal_noise(shapes.ellipsoid(5), 0.05, seed=2)
    copy = np.array(noisy.vertices)
    one, two = (jaxkvf.symmetrize(noisy, max_steps=8) for _ in range(2))
    np.testing.assert_array_equal(one.mesh.vertices, two.mesh.vertices)
    np.testing.assert_array_equal(noisy.vertices, copy)
    assert one.result == OUTCOMES.max_steps_reached and "max_steps" in OUTCOMES[one.result]
    assert one.stats["evaluations"] == 8


@pytest.mark.slow
@pytest.mark.parametrize(
    "minimiser", [optx.BFGS(1e-8, 1e-8), optx.NonlinearCG(1e-8, 1e-8)], ids=["BFGS", "CG"]
)
def test_other_minimisers_do(minimiser):
    noisy = shapes.add_normal_noise(shapes.ellipsoid(3), 0.05, seed=3)
    done = jaxkvf.symmetrize(noisy, minimiser=minimiser, max_steps=25)
    assert done.history[-1].dimensionless[0] < 0.3 * done.history[0].dimensionless[0]
    lowest = float(jaxkvf.killing_fields(done.mesh, 1).dimensionless[0])
    np.testing.assert_allclose(done.history[-1].dimensionless[0], lowest, rtol=1e-5)


def test_a_shape_without_symmetry_comes_to_rest_and_says_so():
    done = jaxkvf.symmetrize(
        shapes.bumpy_sphere(4), terms=(PositionFidelity(1e3), ShapeBarrier(1.0)), max_steps=200
    )
    assert done.result == OUTCOMES.no_symmetry_nearby
    assert "no symmetric mesh is nearby" in OUTCOMES[done.result]


def test_terms_price_what_they_say():
    mesh = shapes.icosphere(4)
    unit = float(g.edge_lengths(mesh.vertices, mesh.topology).mean())
    shift = jnp.asarray([[0.1 * unit, 0, 0]])
    moved = mesh.with_vertices(mesh.vertices + shift)
    np.testing.assert_allclose(PositionFidelity(2.0)(moved, mesh), 2 * 0.01, rtol=1e-12)
    np.testing.assert_allclose(ShapeBarrier(1.0)(moved, mesh), 0, atol=1e-12)
    # A uniform stretch by s: ½ (2s² + 2/s²) − 2.
    for s in (0.5, 2.0):
        stretched = mesh.with_vertices(s * mesh.vertices)
        np.testing.assert_allclose(ShapeBarrier(1.0)(stretched, mesh), s**2 + s**-2 - 2, rtol=1e-10)


def test_the_barrier_grows_without_bound_towards_slivers():
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0.8, 0]])
    mesh = jaxkvf.TriangleMesh.from_arrays(triangle, [[0, 1, 2]])
    prices = []
    for height in (1e-1, 1e-2, 1e-3):
        flat = jnp.asarray(triangle * [1, height, 1])
        prices.append(float(ShapeBarrier(1.0)(mesh.with_vertices(flat), mesh)))
    np.testing.assert_allclose(np.diff(np.log10(prices)), 2, atol=0.05)


def test_inflation_does_not_pay():
    """λ·area, the objective, is blind to scale; the terms alone hold the size."""
    noisy = shapes.add_normal_noise(shapes.ellipsoid(4), 0.1, seed=4)
    values = [
        float(jaxkvf.killing_fields(noisy.with_vertices(s * noisy.vertices), 1).dimensionless[0])
        for s in (0.1, 1, 10)
    ]
    np.testing.assert_allclose(values, values[1], rtol=1e-8)


def test_bad_options_are_refused():
    mesh = shapes.icosphere(2)
    for options, message in (
        ({"count": 0}, "count must be a positive integer, got 0"),
        ({"count": 4}, "at most 3"),
        ({"max_steps": 0}, "max_steps must be a positive integer"),
        ({"rtol": -1.0}, "rtol and atol must not be negative"),
    ):
        with pytest.raises(ValueError, match=message):
            jaxkvf.symmetrize(mesh, **options)


def test_a_failing_eigensolve_at_the_start_is_reported():
    mesh = shapes.icosphere(2)
    broken = mesh.with_vertices(mesh.vertices * jnp.nan)
    done = jaxkvf.symmetrize(broken)
    assert done.result == OUTCOMES.eigensolver_failed
