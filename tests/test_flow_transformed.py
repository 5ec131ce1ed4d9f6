"""The flow under jit, vmap and forward-mode differentiation; what works on the host says so."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkvf
from jaxkvf import SurfacePoints, advect_vertices, flow, shapes, surface_positions
from jaxkvf import patterns as p
from jaxkvf.flows import closed_field, isometry_error, period


@pytest.fixture(scope="module")
def swirl():
    """A surface without symmetry, a smooth field, and points on it."""
    mesh = shapes.bumpy_sphere(5)
    x, y, z = np.asarray(mesh.vertices).T
    vectors = jnp.asarray(np.stack([np.sin(3 * y) + z, np.cos(2 * z) * x, y * x + 0.3], axis=1))
    rng = np.random.default_rng(0)
    return (
        mesh,
        vectors,
        SurfacePoints(rng.integers(0, mesh.topology.n_faces, 60), rng.dirichlet((2, 2, 2), 60)),
    )


def test_jit_and_vmap_change_nothing(swirl):
    mesh, vectors, points = swirl
    end = flow(mesh, vectors, 0.5, points)
    jitted = jax.jit(flow)(mesh, vectors, 0.5, points)
    np.testing.assert_array_equal(jitted.points.faces, end.points.faces)
    np.testing.assert_allclose(jitted.points.barycentric, end.points.barycentric, atol=1e-10)
    moved = jax.jit(advect_vertices)(mesh, vectors, -0.3)
    np.testing.assert_allclose(moved, advect_vertices(mesh, vectors, -0.3), atol=1e-10)
    both = jax.vmap(lambda t: surface_positions(mesh, flow(mesh, vectors, t, points).points))(
        jnp.array([0.5, -0.5])
    )
    np.testing.assert_allclose(both[0], surface_positions(mesh, end.points), atol=1e-10)
    # What is not finite stays so, and for itself.
    bad = SurfacePoints(points.faces.at[3].set(-1), points.barycentric.at[5].set(2.0))
    weights = np.asarray(jax.jit(flow)(mesh, vectors, 0.5, bad).points.barycentric)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(weights).any(axis=1)), [3, 5])


@pytest.mark.parametrize("argument", ["vectors", "time", "vertices"])
def test_forward_mode_against_differences(swirl, argument):
    mesh, vectors, points = swirl
    rng = np.random.default_rng(1)
    change = jnp.asarray(rng.standard_normal(vectors.shape))

    def end(s):
        if argument == "vectors":
            return flow(mesh, vectors + s * change, 0.6, points)
        if argument == "time":
            return flow(mesh, vectors, 0.6 + s, points)
        moved = mesh.with_vertices(mesh.vertices + 0.05 * s * change)
        return flow(moved, vectors, 0.6, points)

    def where(s):
        return end(s).points.barycentric

    step = 1e-6
    before, after = jax.jit(end)(-step), jax.jit(end)(step)
    (_, found) = jax.jvp(jax.jit(where), (0.0,), (1.0,))
    expected = (after.points.barycentric - before.points.barycentric) / (2 * step)
    same = np.asarray(before.points.faces == after.points.faces)
    assert same.mean() > 0.9
    size = np.abs(expected[same]).max()
    gap = np.abs(found - expected)[same].max(axis=1) / size
    # A path that comes near a vertex passes it on one side or the other.
    assert np.mean(gap < 1e-5) > 0.9, np.sort(gap)[-6:]
    assert size > 1e-2


def test_fields_that_vanish_somewhere_have_derivatives():
    mesh = shapes.icosphere(4)
    x = np.asarray(mesh.vertices)
    turn = jnp.asarray(np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1))
    _, rate = jax.jvp(lambda s: advect_vertices(mesh, (1 + s) * turn, 0.2), (0.0,), (1.0,))
    assert np.isfinite(rate).all()
    speed = np.linalg.norm(np.asarray(rate), axis=1)
    np.testing.assert_allclose(speed, 0.2 * np.hypot(x[:, 0], x[:, 1]), atol=0.02)


def test_reverse_mode_is_refused_in_words(swirl):
    mesh, vectors, points = swirl
    with pytest.raises(Exception, match=r"jax\.jvp or jax\.jacfwd"):
        jax.grad(lambda u: flow(mesh, u, 0.5, points).points.barycentric[0, 0])(vectors)


def test_what_works_on_the_host_says_so(swirl):
    mesh, vectors, _ = swirl
    for name, call in (
        ("period", lambda u: period(mesh, u).period),
        ("closed_field", lambda u: closed_field(mesh, u).coefficients),
        ("isometry_error", lambda u: isometry_error(mesh, u, 1.0).err),
        ("pattern", lambda u: p.pattern(mesh, u, [0], 3).radius),
        ("stripes", lambda u: p.stripes(mesh, u, 3)),
        ("closest_points", lambda u: jaxkvf.closest_points(mesh, u).barycentric),
    ):
        for transformed in (jax.jit, lambda f: jax.vmap(f, in_axes=0)):
            argument = vectors if transformed is jax.jit else vectors[None]
            with pytest.raises(TypeError, match=f"{name} runs on the host"):
                transformed(call)(argument)
