"""Whatever minimiser is passed to `symmetrize`: what it reports is what the returned surface has by itself."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

import jaxkvf
from jaxkvf import shapes
from jaxkvf.symmetrization import OUTCOMES, Parameters


def lowest(mesh):
    """By another solver than those on the way."""
    return float(jaxkvf.killing_fields(mesh, 1, solver=jaxkvf.eigen.DenseEigh()).dimensionless[0])


def check_honest(done, tolerance):
    """The last entry of the history is true of the mesh; success means that its own λ₀·area is at the tolerance."""
    values = np.array([step.dimensionless[0] for step in done.history])
    assert (np.diff(values) <= 0).all() and values[-1] > 0
    np.testing.assert_allclose(values[-1], lowest(done.mesh), rtol=1e-5)
    assert (done.result == OUTCOMES.successful) == (values[-1] <= tolerance)


class FalseClaims(optx.AbstractMinimiser):
    """Goes nowhere, and says that it evaluated a perfect surface."""

    rtol: float = 0.0
    atol: float = 0.0
    norm: object = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):  # noqa: PLR0917
        return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), aux_struct)

    def step(self, fn, y, args, options, state, tags):  # noqa: PLR0917
        return 1.01 * y, state, state

    def terminate(self, fn, y, args, options, state, tags):  # noqa: PLR0917
        return jnp.asarray(False), optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):  # noqa: PLR0917
        return y, aux, {}


@pytest.mark.parametrize(
    "minimiser",
    [
        pytest.param(optx.LBFGS(1e-8, 1e-8), marks=pytest.mark.exhaustive),
        pytest.param(optx.NonlinearCG(1e-8, 1e-8), marks=pytest.mark.exhaustive),
        pytest.param(optx.GradientDescent(0.02, 1e-8, 1e-8), marks=pytest.mark.exhaustive),
        pytest.param(optx.BestSoFarMinimiser(optx.BFGS(1e-8, 1e-8)), marks=pytest.mark.exhaustive),
        optx.NelderMead(1e-8, 1e-8),
        FalseClaims(),
    ],
    ids=lambda minimiser: type(minimiser).__name__,
)
def test_of_the_axes_of_an_ellipsoid(minimiser):
    """Three unknowns, so that even a simplex arrives: two axes must become equal."""
    ball = shapes.icosphere(2)
    begin = jnp.asarray([1.0, 1.15, 1.6])
    mesh = ball.with_vertices(ball.vertices * begin[None, :])
    axes = Parameters(lambda axes: ball.vertices * axes[None, :], begin)
    done = jaxkvf.symmetrize(
        mesh, unknowns=axes, terms=(), minimiser=minimiser, reach=20.0, rtol=0.0, atol=0.01, max_steps=60
    )
    check_honest(done, 0.01)
    assert done.stats["steps"] <= 60 and done.stats["accepted"] == len(done.history) - 1
    if isinstance(minimiser, FalseClaims):
        assert done.result != OUTCOMES.successful
    else:
        a, b, c = np.sort(np.asarray(done.unknowns))
        assert done.result == OUTCOMES.successful and min(b - a, c - b) < 0.04


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "minimiser", [optx.BFGS(1e-8, 1e-8), optx.NonlinearCG(1e-8, 1e-8)], ids=["BFGS", "CG"]
)
def test_of_the_vertices(minimiser):
    noisy = shapes.add_normal_noise(shapes.ellipsoid(3), 0.05, seed=3)
    done = jaxkvf.symmetrize(noisy, minimiser=minimiser, max_steps=25)
    assert done.history[-1].dimensionless[0] < 0.3 * done.history[0].dimensionless[0]
    check_honest(done, 20 / noisy.topology.n_faces**2 + 5e-7 * done.history[0].dimensionless[0])


@pytest.mark.exhaustive
def test_a_simplex_in_many_dimensions_does_not_report_what_it_has_not_reached():
    """It cannot get far in the 126 coordinates of a mesh."""
    noisy = shapes.add_normal_noise(shapes.ellipsoid(2), 0.05, seed=3)
    done = jaxkvf.symmetrize(noisy, minimiser=optx.NelderMead(1e-8, 1e-8), max_steps=40)
    check_honest(done, 20 / noisy.topology.n_faces**2 + 5e-7 * done.history[0].dimensionless[0])
    assert done.history[-1].dimensionless[0] > 0.3 * done.history[0].dimensionless[0]


@pytest.mark.exhaustive
def test_levenberg_marquardt_minimises_the_energy_as_squares():
    """In vertices and field at once, a few steps go far."""
    noisy = shapes.add_normal_noise(shapes.ellipsoid(2), 0.1, seed=3)
    done = jaxkvf.symmetrize(noisy, minimiser=optx.IndirectLevenbergMarquardt(1e-10, 1e-10), max_steps=40)
    assert done.result == OUTCOMES.successful and done.stats["steps"] <= 8
    check_honest(done, 20 / noisy.topology.n_faces**2 + 1e-6)
    assert done.history[-1].dimensionless[0] < 0.02 * done.history[0].dimensionless[0]


class Optimist(jaxkvf.eigen.AbstractStatelessEigensolver):
    """Right where there is no guess and it is asked first, and else finds that all is well."""

    calls: list = eqx.field(static=True)

    def compute(self, problem, k, guess):
        self.calls.append(guess is None)
        found, _ = jaxkvf.eigen.DenseEigh().compute(problem, k, None)
        if guess is None and len(self.calls) > 1:
            return eqx.tree_at(lambda s: s.eigenvectors, found, found.eigenvectors[:, ::-1]), None
        return found, None


def test_success_is_confirmed_from_scratch():
    """A solver that contradicts itself at the end."""
    noisy = shapes.add_normal_noise(shapes.ellipsoid(2), 0.02, seed=3)
    calls = []
    done = jaxkvf.symmetrize(noisy, solver=Optimist(calls), rtol=0.0, atol=0.005)
    assert calls[0] and calls[-1]
    assert done.result == OUTCOMES.not_confirmed
    assert "from scratch" in OUTCOMES[done.result]
