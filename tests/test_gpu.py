"""On an accelerator: the same numbers as on the CPU, from the same calls. Run by `pytest -m gpu` where JAX sees one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import subspace_angles

import jaxkvf
from jaxkvf import shapes
from jaxkvf.eigen import LOBPCG, GeneralizedEigenproblem, ScipyEigsh
from jaxkvf.geometry import edge_lengths
from jaxkvf.killing import Regge
from jaxkvf.sparse import assembled, block_product, to_scipy

pytestmark = pytest.mark.gpu


@pytest.fixture(autouse=True)
def an_accelerator():
    if jax.default_backend() == "cpu":
        pytest.skip("JAX sees no accelerator")


def on_the_cpu(mesh):
    """The same mesh there, and with it all that is computed from it."""
    return jax.device_put(mesh, jax.devices("cpu")[0])


def problem_of(mesh):
    problem = Regge().eigenproblem(edge_lengths(mesh.vertices, mesh.topology), mesh.topology)
    return GeneralizedEigenproblem(assembled(problem.A), assembled(problem.B))


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_sparse_products_are_those_of_scipy(dtype):
    problem = problem_of(shapes.bumpy_sphere(12))
    problem = jax.tree.map(lambda x: x.astype(dtype) if x.dtype == jnp.float64 else x, problem)
    x = np.random.default_rng(0).standard_normal((problem.size, 8)).astype(dtype)
    for operator in (problem.A, problem.B):
        matrix = to_scipy(operator)
        y = np.asarray(jax.jit(lambda M, x: block_product(M)(x))(operator, jnp.asarray(x)))
        scale = np.abs(matrix).max() * np.abs(x).max()
        np.testing.assert_allclose(y, matrix @ x, rtol=0, atol=50 * float(jnp.finfo(dtype).eps) * scale)


@pytest.mark.parametrize("discretization", ["regge", "dec"])
def test_multigrid_there_finds_what_shift_invert_does(discretization):
    mesh = shapes.bumpy_sphere(24)
    solver = jaxkvf.multigrid_solver(mesh, discretization=discretization, rtol=1e-10)
    found = jaxkvf.killing_fields(mesh, 6, discretization=discretization, solver=solver)
    assert not bool(found.stats["fell_back"])
    expected = jaxkvf.killing_fields(on_the_cpu(mesh), 6, discretization=discretization, solver=ScipyEigsh())
    np.testing.assert_allclose(found.eigenvalues, expected.eigenvalues, rtol=1e-9)
    angles = subspace_angles(*(np.asarray(f.vectors).reshape(6, -1).T for f in (found, expected)))
    assert angles.max() < 1e-6


def test_clusters_of_the_sphere():
    mesh = shapes.icosphere(24)
    found = jaxkvf.killing_fields(mesh, 8, solver=jaxkvf.multigrid_solver(mesh))
    expected = jaxkvf.killing_fields(on_the_cpu(mesh), 8, solver=ScipyEigsh())
    np.testing.assert_array_equal(found.clusters, expected.clusters)
    np.testing.assert_allclose(
        found.eigenvalues, expected.eigenvalues, rtol=1e-9, atol=1e-9 * expected.eigenvalues[-1]
    )


def test_gradients_are_those_of_the_cpu():
    mesh = shapes.bumpy_sphere(10)
    solver = LOBPCG(rtol=1e-11, preconditioner=jaxkvf.multigrid_preconditioner(mesh))

    def gradient(mesh, solver):
        def energy(vertices):
            return jaxkvf.killing_eigenvalues(mesh.with_vertices(vertices), 3, solver=solver).sum()

        return jax.jit(jax.grad(energy))(mesh.vertices)

    here, there = gradient(mesh, solver), gradient(on_the_cpu(mesh), ScipyEigsh())
    assert here.devices() != there.devices()
    np.testing.assert_allclose(here, there, rtol=0, atol=1e-7 * np.abs(there).max())


def test_a_batch_of_surfaces():
    mesh = shapes.bumpy_sphere(8)
    solver = LOBPCG(preconditioner=jaxkvf.multigrid_preconditioner(mesh))
    stretched = jnp.stack([mesh.vertices * jnp.asarray([[1.0, 1.0, s]]) for s in (0.9, 1.0, 1.2)])

    def spectrum(vertices):
        return jaxkvf.killing_eigenvalues(mesh.with_vertices(vertices), 4, solver=solver)

    together = jax.jit(jax.vmap(spectrum))(stretched)
    alone = [spectrum(vertices) for vertices in stretched]
    np.testing.assert_allclose(together, jnp.stack(alone), rtol=1e-8)


def test_in_single_precision():
    mesh = shapes.bumpy_sphere(12)
    single = mesh.with_vertices(mesh.vertices.astype(jnp.float32))
    found = jaxkvf.killing_fields(single, 6, solver=jaxkvf.multigrid_solver(single))
    assert found.eigenvalues.dtype == jnp.float32
    expected = jaxkvf.killing_fields(mesh, 6)
    np.testing.assert_allclose(found.dimensionless, expected.dimensionless, rtol=2e-3)


def test_shift_invert_is_called_from_there():
    mesh = shapes.bumpy_sphere(8)
    found = jax.jit(lambda mesh: jaxkvf.killing_eigenvalues(mesh, 3, solver=ScipyEigsh()))(mesh)
    expected = jaxkvf.killing_eigenvalues(on_the_cpu(mesh), 3, solver=ScipyEigsh())
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_a_flow_is_that_of_the_cpu():
    mesh = shapes.ellipsoid(16)
    field = np.asarray(jaxkvf.killing_fields(mesh, 1).vectors[0])
    here, there = (jaxkvf.advect_vertices(m, field, 0.3) for m in (mesh, on_the_cpu(mesh)))
    assert here.devices() != there.devices()
    np.testing.assert_allclose(here, there, rtol=0, atol=1e-9)


def test_symmetrization():
    outcome = jaxkvf.symmetrize(shapes.add_normal_noise(shapes.ellipsoid(12), 0.02, seed=0))
    assert outcome.history[-1].dimensionless[0] < 1e-3 * outcome.history[0].dimensionless[0]
