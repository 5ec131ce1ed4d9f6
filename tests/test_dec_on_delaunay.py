"""`dec` on the intrinsic Delaunay triangulation: bad triangles do no harm, and fields come back to the mesh."""

import functools
import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from bad_triangles import central_difference, differentiated, grid_torus, random_spheroid, surface

from jaxkvf import (
    KillingFields,
    intrinsic_killing_eigenvalues,
    killing_eigenvalues,
    killing_fields,
    reference,
    shapes,
)
from jaxkvf.eigen import DenseEigh, ScipyEigsh, eigsolve
from jaxkvf.geometry import cotan_weights, intrinsic_delaunay, project, vertex_frames
from jaxkvf.killing import Dec, vector_mass
from jaxkvf.sparse import to_scipy

DEC = Dec()
slow = functools.partial(pytest.param, marks=pytest.mark.slow)


@functools.cache
def spheroid_reference() -> np.ndarray:
    return reference.surface_of_revolution_spectrum(np.sin, lambda t: 2.5 * np.cos(t), 10)


@functools.cache
def spheroid_fields(count: int, discretization: str) -> KillingFields:
    return killing_fields(random_spheroid(count), 10, discretization=discretization)


@pytest.mark.parametrize("count", [2562, slow(10242)])
def test_dec_on_bad_triangles(count):
    error = np.asarray(spheroid_fields(count, "dec").eigenvalues) - spheroid_reference()
    bound = {2562: 1.5e-3, 10242: 5e-4}[count]
    assert np.linalg.norm(error) < bound * np.linalg.norm(spheroid_reference())


def test_without_flips_bad_triangles_are_refused():
    with pytest.raises(eqx.EquinoxRuntimeError, match="B is not positive definite"):
        killing_fields(random_spheroid(700), 3, discretization=Dec(delaunay=False), solver=ScipyEigsh())


def test_flips_change_nothing_on_a_delaunay_mesh():
    plain, flipped = (
        eqx.filter_jit(discretization.eigenproblem)(*surface(shapes.icosphere(6)))
        for discretization in (Dec(delaunay=False), DEC)
    )
    assert eqx.tree_equal(plain, flipped)


@pytest.mark.slow
def test_fields_come_back_in_the_frames_of_the_mesh():
    """Eigenfields of `dec` over thousands of flips are those of `regge`, which knows nothing of them."""
    mesh = random_spheroid(2562)
    lengths, topology = surface(mesh)
    assert int(intrinsic_delaunay(lengths, topology).flips) > 1900
    mass, frames = vector_mass(lengths, topology), vertex_frames(mesh.vertices, topology)
    dec, regge = (
        project(spheroid_fields(2562, name).vectors[:4], frames).reshape(4, -1) for name in ("dec", "regge")
    )
    overlap = np.asarray(dec @ jax.vmap(mass.mv)(regge).T)
    np.testing.assert_allclose(np.abs(overlap[[0, 3], [0, 3]]), 1, atol=2e-3)
    np.testing.assert_allclose(np.linalg.svd(overlap[1:3, 1:3])[1], 1, atol=2e-3)  # a pair turns freely


@pytest.mark.slow
def test_eigenvalues_follow_the_vertices_across_flips():
    """Their derivative is right, and they stay continuous where edges change over to the other diagonal."""
    mesh, _, direction = differentiated()

    @jax.jit
    def low(x):
        return killing_eigenvalues(mesh.with_vertices(x), 3, discretization="dec", solver=ScipyEigsh())

    def total(x):
        return low(x).sum()

    slope = jnp.vdot(jax.jit(jax.grad(total))(mesh.vertices), direction)
    np.testing.assert_allclose(slope, central_difference(total, mesh.vertices, direction, 1e-6), rtol=1e-5)

    steps = np.linspace(0, 1e-3, 21)
    faces = [
        np.asarray(
            DEC.triangulation(*surface(mesh.with_vertices(mesh.vertices + s * direction))).topology.faces
        )
        for s in steps
    ]
    assert sum((a != b).any() for a, b in itertools.pairwise(faces)) >= 3
    along = np.array([low(mesh.vertices + s * direction) for s in steps])
    bend = np.abs(np.diff(along, n=2, axis=0)).max(axis=0)
    assert (bend < 0.5 * np.abs(np.diff(along, axis=0)).max(axis=0)).all()


def test_vertex_fields_survive_the_round_trip():
    """The rotation about the axis, to a form on the flipped edges and back, and its energy on the way."""
    mesh = random_spheroid(2562)
    lengths, topology = surface(mesh)
    x, y, _ = mesh.vertices.T
    rotation = project(jnp.stack([-y, x, 0 * x], axis=1), vertex_frames(mesh.vertices, topology))

    @jax.jit
    def there_and_back(lengths):
        form = DEC.from_vertex_vectors(rotation, lengths, topology)
        problem = DEC.eigenproblem(lengths, topology)
        products = form @ problem.A.mv(form), form @ problem.B.mv(form)
        return (
            DEC.to_vertex_vectors(form, lengths, topology),
            *products,
            DEC.energy(form, lengths, topology),
        )

    back, stiffness, mass, energy = there_and_back(lengths)
    assert float(jnp.abs(back - rotation).max()) < 5e-3
    np.testing.assert_allclose(energy, stiffness, rtol=1e-12)
    assert abs(float(stiffness / mass)) < 0.1 * spheroid_reference()[1]


# Edges of no weight


def test_edges_without_weight_join_faces_to_polygons():
    """A third of the edges have ⋆₁ = 0; eliminating their unknowns exactly gives the same eigenvalues."""
    lengths, topology = surface(grid_torus(12, 8))
    weights = np.asarray(cotan_weights(lengths, topology))
    none = np.abs(weights) < 1e-12
    assert none.sum() == topology.n_edges // 3
    problem = eqx.filter_jit(DEC.eigenproblem)(lengths, topology)
    A = to_scipy(problem.A).toarray()
    eliminated = A[np.ix_(~none, ~none)] - A[np.ix_(~none, none)] @ np.linalg.solve(
        A[np.ix_(none, none)], A[np.ix_(none, ~none)]
    )
    exact = scipy.linalg.eigh(eliminated, np.diag(weights[~none]), eigvals_only=True)[:10]
    for solver in (DenseEigh(), ScipyEigsh()):
        np.testing.assert_allclose(
            eqx.filter_jit(eigsolve)(problem, 10, solver).eigenvalues, exact, rtol=3e-6
        )


def test_a_grid_without_weight_is_like_a_mesh_beside_it():
    exact, near = (
        np.asarray(killing_eigenvalues(grid_torus(48, 30, noise), 8, discretization="dec"))
        for noise in (0.0, 1e-3)
    )
    np.testing.assert_allclose(exact, near, rtol=5e-3, atol=1e-4 * exact[-1])


@pytest.mark.slow
def test_derivatives_where_weights_leave_zero():
    """Shortening the diagonals gives them weight at once; the derivative is that from this side."""
    lengths, topology = surface(grid_torus(16, 10))
    weightless = jnp.abs(cotan_weights(lengths, topology)) < 1e-12
    rate = jnp.where(
        weightless, jnp.asarray(np.random.default_rng(1).uniform(0.5, 1.5, topology.n_edges)), 0.0
    )

    @jax.jit
    def two(t):
        shortened = lengths * (1 - t * rate)
        return intrinsic_killing_eigenvalues(
            shortened, topology, 2, discretization="dec", solver=ScipyEigsh()
        ).sum()

    h = 1e-4  # beyond the band of weights that count as zero
    one_sided = (-5 * two(h) + 8 * two(2 * h) - 3 * two(3 * h)) / (2 * h)
    np.testing.assert_allclose(jax.jit(jax.grad(two))(0.0), one_sided, rtol=1e-3)
