"""Symmetrization: how far λ·area falls, at what displacement, and what it leaves alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkvf
from jaxkvf import geometry as g
from jaxkvf import shapes
from jaxkvf.symmetrization import (
    OUTCOMES,
    ChosenField,
    Configuration,
    Displacements,
    EdgeLengths,
    LowestFields,
    Parameters,
    PositionFidelity,
    ShapeBarrier,
    symmetry_report,
)
from jaxkvf.symmetrization._objective import Accepted, SymmetryObjective


def smallest_angle(mesh):
    lengths = g.edge_lengths(mesh.vertices, mesh.topology)
    return float(g.corner_angles(lengths, mesh.topology).min())


def test_a_noisy_spheroid_becomes_symmetric():
    """5 % normal noise on 642 vertices: λ₀·area falls below the noise-free mesh's own, moving the vertices by less than the
    noise did."""
    clean = shapes.ellipsoid(8)
    noisy = shapes.add_normal_noise(clean, 0.05, seed=0)
    before = float(jaxkvf.killing_fields(noisy, 1).dimensionless[0])
    seen = []
    done = jaxkvf.symmetrize(noisy, callback=seen.append)
    after = float(jaxkvf.killing_fields(done.mesh, 1).dimensionless[0])
    assert done.result == OUTCOMES.successful
    assert before / after >= 1e3
    assert after <= 20 / noisy.topology.n_faces**2 + 5e-7 * before
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
    assert (np.diff([step.dimensionless[0] for step in done.history]) <= 0).all()
    assert after <= float(jaxkvf.killing_fields(clean, 1).dimensionless[0])

    account = symmetry_report(noisy, done)
    assert (account.exact_before, account.exact_after, account.flipped_faces) == (0, 1, 0)
    np.testing.assert_allclose(account.rms_displacement, last.rms_displacement, rtol=1e-12)
    np.testing.assert_allclose(account.dimensionless_after[0], after, rtol=1e-6)
    worst = account.as_dict()["most_changed_faces"][0]
    assert worst["stretch"] == account.stretches.max() > 1


@pytest.mark.slow
def test_three_symmetries_of_a_noisy_sphere():
    clean = shapes.icosphere(6)
    done = jaxkvf.symmetrize(shapes.add_normal_noise(clean, 0.05, seed=1), 3)
    assert done.result == OUTCOMES.successful
    last = done.history[-1].dimensionless[:3].sum()
    assert last <= 3e-4 * done.history[0].dimensionless[:3].sum()
    assert last <= jaxkvf.killing_fields(clean, 3).dimensionless.sum()


@pytest.fixture(scope="module")
def small():
    return shapes.add_normal_noise(shapes.ellipsoid(4), 0.05, seed=2)


@pytest.mark.slow
def test_the_solver_of_large_meshes_goes_the_same_way(small, monkeypatch):
    """With a preconditioner that is made anew after 4 and 8 steps; also from a state between the two."""
    go_on = {"rtol": 0.0, "atol": 0.0}
    expected = jaxkvf.symmetrize(small, max_steps=12, **go_on)
    monkeypatch.setattr("jaxkvf.solvers._MANY_SOLVES_FROM", 0)
    whole = jaxkvf.symmetrize(small, max_steps=12, **go_on)
    for one, other in zip(whole.history, expected.history, strict=True):
        assert one.steps == other.steps
        np.testing.assert_allclose(one.dimensionless[0], other.dimensionless[0], rtol=1e-3)
    np.testing.assert_allclose(whole.mesh.vertices, expected.mesh.vertices, atol=1e-5)
    half = jaxkvf.symmetrize(small, max_steps=6, **go_on)
    resumed = jaxkvf.symmetrize(small, max_steps=12, resume=half.state, **go_on)
    np.testing.assert_array_equal(resumed.mesh.vertices, whole.mesh.vertices)


@pytest.mark.slow
def test_a_shape_without_symmetry_comes_to_rest_and_says_so():
    done = jaxkvf.symmetrize(
        shapes.bumpy_sphere(4), terms=(PositionFidelity(1e3), ShapeBarrier(1.0)), max_steps=200
    )
    assert done.result == OUTCOMES.no_symmetry_nearby
    assert "no symmetric mesh is nearby" in OUTCOMES[done.result]


def test_the_objective_cannot_be_gamed():
    """Neither size, nor needles, nor slivers make a noisy mesh look more symmetric: λ·area is blind to the first, and the
    others cost more than they can ever save."""
    noisy = shapes.add_normal_noise(shapes.ellipsoid(4), 0.1, seed=4)
    objective = SymmetryObjective(
        Configuration.of(noisy), Displacements(), LowestFields(), (PositionFidelity(), ShapeBarrier()), None
    )
    unit = float(objective.original.unit)

    @jax.jit
    def parts(vertices):
        anything = Accepted(None, jnp.asarray(jnp.inf))
        total, evaluation = objective((vertices - noisy.vertices) / unit, anything)
        return total, evaluation.dimensionless[0]

    total, asymmetry = parts(noisy.vertices)
    for scale in (0.1, 10.0):
        scaled, same = parts(scale * noisy.vertices)
        np.testing.assert_allclose(same, asymmetry, rtol=1e-8)
        assert scaled > total
    needle = noisy.vertices * jnp.asarray([[0.02, 0.02, 1.0]])
    assert parts(needle)[0] > total
    first, second, _ = noisy.faces[0]
    for remaining in (1e-2, 1e-4, 1e-6):  # of the side that vanishes
        sliver = noisy.vertices.at[first].set(
            remaining * noisy.vertices[first] + (1 - remaining) * noisy.vertices[second]
        )
        assert parts(sliver)[0] > total


@pytest.mark.slow
def test_fixed_vertices_stay_and_gradients_may_be_smooth(small):
    fixed = small.vertices[:, 2] > 1.2
    done = jaxkvf.symmetrize(small, unknowns=Displacements(fixed, smoothing=2.0), max_steps=15)
    moved = np.linalg.norm(done.mesh.vertices - small.vertices, axis=1)
    assert (moved[np.asarray(fixed)] == 0).all() and (moved[~np.asarray(fixed)] > 0).all()
    assert done.history[-1].dimensionless[0] < 0.5 * done.history[0].dimensionless[0]


@pytest.mark.slow
def test_edge_lengths_can_be_varied_instead(small):
    done = jaxkvf.symmetrize(small, unknowns=EdgeLengths(), max_steps=60)
    assert done.mesh is None
    lowest = jaxkvf.intrinsic_killing_eigenvalues(done.lengths, small.topology, 1)[0]
    area = g.surface_area(done.lengths, small.topology)
    np.testing.assert_allclose(lowest * area, done.history[-1].dimensionless[0], rtol=1e-6)
    assert done.history[-1].dimensionless[0] < 1e-2 * done.history[0].dimensionless[0]
    with pytest.raises(ValueError, match="needs vertex positions"):
        jaxkvf.symmetrize(small, unknowns=EdgeLengths(), terms=(PositionFidelity(),))


@pytest.mark.slow
def test_any_parameters_of_a_surface_will_do():
    """An ellipsoid 1 : 1.2 : 1.6 by its three axes: they come to be those of a surface of revolution."""
    ball = shapes.icosphere(4)
    start = jnp.asarray([1.0, 1.2, 1.6])
    mesh = ball.with_vertices(ball.vertices * start[None, :])
    axes = Parameters(lambda axes: ball.vertices * axes[None, :], start)
    done = jaxkvf.symmetrize(mesh, unknowns=axes, terms=(), reach=10.0, rtol=1e-3)
    a, b, c = np.sort(np.asarray(done.unknowns))
    assert min(b - a, c - b) < 0.02 < max(b - a, c - b) or c - a < 0.02
    assert done.history[-1].dimensionless[0] < 0.02 * done.history[0].dimensionless[0]
    with pytest.raises(ValueError, match=r"have shape \[162, 3\], the mesh's \[42, 3\]"):
        jaxkvf.symmetrize(shapes.icosphere(2), unknowns=axes)


@pytest.mark.slow
def test_a_chosen_field_is_kept(small):
    """The turn around the x axis, which no field of the spheroid is near to, becomes more and more Killing."""
    field = jnp.cross(jnp.asarray([[1.0, 0, 0]]), small.vertices)
    done = jaxkvf.symmetrize(small, ChosenField(field), max_steps=20, reach=10.0)
    values = [step.dimensionless[0] for step in done.history]
    assert (np.diff(values) <= 0).all() and values[-1] < 0.8 * values[0]
    with pytest.raises(ValueError, match=r"vectors must have shape \[162, 3\]"):
        jaxkvf.symmetrize(small, ChosenField(field[1:]))


def test_bad_options_are_refused():
    mesh = shapes.icosphere(2)
    for options, message in (
        ({"target": 0}, "number of fields must be an integer between 1 and"),
        ({"target": 4}, "the most independent symmetries of a surface, 3, got 4"),
        ({"reach": 0.0}, "reach must be positive"),
        ({"max_steps": 0}, "max_steps must be an integer of at least 1, got 0"),
        ({"max_steps": True}, "max_steps must be an integer of at least 1, got True"),
        ({"rtol": -1.0}, "rtol must be finite and at least 0"),
        ({"atol": float("nan")}, "atol must be finite and at least 0"),
    ):
        with pytest.raises(ValueError, match=message):
            jaxkvf.symmetrize(mesh, **options)
    with pytest.raises(ValueError, match="smoothing must be finite and at least 0, got nan"):
        Displacements(smoothing=float("nan"))
    with pytest.raises(ValueError, match=r"fixed must have shape \[42\], one a vertex, got \[3\]"):
        jaxkvf.symmetrize(mesh, unknowns=Displacements(np.zeros(3, bool)))


def test_a_failing_eigensolve_at_the_start_is_reported():
    done = jaxkvf.symmetrize(shapes.ellipsoid(4).with_vertices(jnp.full((162, 3), jnp.nan)))
    assert done.result == OUTCOMES.eigensolver_failed
