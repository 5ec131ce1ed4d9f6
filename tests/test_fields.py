"""Killing fields against exact spectra, the paper's figures, real meshes and one another's solvers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkvf
from jaxkvf import ScipyEigsh, TriangleMesh, reference, shapes
from jaxkvf import geometry as g
from jaxkvf.eigen import Cholmod, SuperLU
from jaxkvf.killing import vector_mass


def relative_l2(values, exact):
    return np.linalg.norm(np.asarray(values) - exact) / np.linalg.norm(exact)


def spheroid_spectrum(k, height=1.6):
    return reference.surface_of_revolution_spectrum(np.sin, lambda t: height * np.cos(t), k)


@pytest.mark.slow
@pytest.mark.parametrize(("discretization", "bound"), [("dec", 0.0017), ("regge", 8e-4)])
def test_the_papers_sphere(discretization, bound):
    """§3.3: 180 eigenvalues of a sphere of 20,252 vertices; the paper reports a relative l2 error of 0.0016."""
    mesh = shapes.icosphere(45)
    assert mesh.topology.n_vertices == 20_252
    values = jaxkvf.killing_eigenvalues(mesh, 180, discretization=discretization)
    assert relative_l2(values, reference.sphere_spectrum(180)) <= bound


def test_three_rotations_of_the_sphere_at_fourth_order():
    lowest = [np.asarray(jaxkvf.killing_eigenvalues(shapes.icosphere(f), 4)) for f in (8, 16, 32)]
    assert (lowest[2][:3] <= 1e-7).all() and (lowest[2][:3] >= 0).all()
    orders = np.log2([lowest[0][0] / lowest[1][0], lowest[1][0] / lowest[2][0]])
    assert (orders >= 3.5).all()
    np.testing.assert_allclose(lowest[2][3], 4, rtol=1e-3)


def test_spheroid_against_the_meridian_problem():
    values = np.asarray(jaxkvf.killing_eigenvalues(shapes.ellipsoid(32), 20))
    assert relative_l2(values, spheroid_spectrum(20)) <= 5e-4
    assert 0 <= values[0] <= 1e-7


@pytest.mark.parametrize("discretization", ["regge", "dec"])
def test_second_order_on_the_spheroid(discretization):
    exact = spheroid_spectrum(10, 1.2)
    errors = [
        relative_l2(
            jaxkvf.killing_eigenvalues(shapes.ellipsoid(f, (1, 1, 1.2)), 10, discretization=discretization),
            exact,
        )
        for f in (8, 16)
    ]
    assert errors[1] < 0.02 and np.log2(errors[0] / errors[1]) > 1.7


@pytest.mark.parametrize("discretization", ["regge", "dec"])
def test_the_solution_is_what_it_says(discretization):
    mesh = shapes.icosphere(10)
    fields = jaxkvf.killing_fields(mesh, 8, discretization=discretization)
    assert fields.eigenvalues.shape == (8,) and fields.vectors.shape == (8, mesh.topology.n_vertices, 3)
    assert fields.result == jaxkvf.eigen.RESULTS.successful
    assert (np.diff(np.asarray(fields.eigenvalues)) >= -1e-9).all()
    assert float(fields.residuals.max()) < 1e-12
    assert fields.clusters.tolist() == [0, 0, 0, 1, 1, 1, 2, 2]
    lengths = g.edge_lengths(mesh.vertices, mesh.topology)
    np.testing.assert_allclose(fields.area, g.surface_area(lengths, mesh.topology), rtol=1e-14)
    np.testing.assert_allclose(fields.dimensionless, fields.eigenvalues * fields.area)
    # Tangent, and of unit norm.
    normals = g.vertex_normals(mesh.vertices, mesh.topology)
    assert float(jnp.abs(jnp.einsum("kvd,vd->kv", fields.vectors, normals)).max()) < 1e-12
    mass = vector_mass(lengths, mesh.topology)
    frames = g.vertex_frames(mesh.vertices, mesh.topology)
    flat = g.project(fields.vectors, frames).reshape(8, -1)
    np.testing.assert_allclose([x @ mass.mv(x) for x in flat], 1, rtol=1e-12)
    # The energy of each field is its eigenvalue.
    energies = [float(jaxkvf.killing_energy(mesh, u)) for u in fields.vectors]
    tolerance = 1e-9 if discretization == "regge" else 0.05
    np.testing.assert_allclose(energies, fields.eigenvalues, atol=tolerance)


def test_a_solution_passes_through_jit():
    """Whole, the words about its solver included; counts of work are numbers."""
    mesh = shapes.ellipsoid(3)
    inside = jax.jit(lambda x: jaxkvf.killing_fields(mesh.with_vertices(x), 2))(mesh.vertices)
    outside = jaxkvf.killing_fields(mesh, 2)
    np.testing.assert_allclose(inside.eigenvalues, outside.eigenvalues, rtol=1e-9, atol=1e-12)
    assert inside.solver == outside.solver == "DenseEigh: 92 vertices are few"
    traced = jax.jit(lambda x: jaxkvf.killing_fields(mesh.with_vertices(x), 2, solver=ScipyEigsh()))
    assert {name: int(count) for name, count in traced(mesh.vertices).stats.items()}["solves"] > 0


@pytest.mark.slow
def test_a_guess_is_a_warm_start():
    """The fields of a surface, or their coefficients, for one nearby; with fewer steps, and the same values."""
    mesh = shapes.ellipsoid(8)
    moved = mesh.with_vertices(mesh.vertices * jnp.asarray([[1.0, 1.0, 1.001]]))
    solver = jaxkvf.multigrid_solver(mesh)
    before = jaxkvf.killing_fields(mesh, 4, solver=solver)
    cold = jaxkvf.killing_fields(moved, 4, solver=solver)
    warm = jaxkvf.killing_fields(moved, 4, solver=solver, guess=before)
    assert int(warm.stats["steps"]) < int(cold.stats["steps"])
    np.testing.assert_allclose(warm.eigenvalues, cold.eigenvalues, rtol=1e-7, atol=1e-9)
    same = jaxkvf.killing_eigenvalues(moved, 4, solver=solver, guess=before.coefficients)
    np.testing.assert_allclose(same, cold.eigenvalues, rtol=1e-7, atol=1e-9)
    with pytest.raises(ValueError, match=r"guess must have coefficients \[any, 1284\], got \[4, 184\]"):
        jaxkvf.killing_fields(mesh, 1, guess=jnp.zeros((4, 184)))


def test_the_trace_of_a_function_of_the_operator():
    mesh = shapes.icosphere(4)

    def heat(x):
        return jaxkvf.killing_spectral_sum(mesh.with_vertices(x), lambda value: jnp.exp(-0.1 * value), 6)

    values = jaxkvf.killing_eigenvalues(mesh, 6)
    np.testing.assert_allclose(heat(mesh.vertices), np.exp(-0.1 * np.asarray(values)).sum(), rtol=1e-10)
    # By scaling: λ goes with the inverse square of size.
    rate = jax.jvp(heat, (mesh.vertices,), (mesh.vertices,))[1]
    np.testing.assert_allclose(rate, (0.2 * values * np.exp(-0.1 * np.asarray(values))).sum(), rtol=1e-6)


def test_positions_of_few_digits_are_refused():
    mesh = shapes.icosphere(2)
    for dtype in (jnp.bfloat16, jnp.float16):
        with pytest.raises(ValueError, match=f"must be of float32 or float64, got {dtype.__name__}"):
            jaxkvf.killing_eigenvalues(mesh.with_vertices(mesh.vertices.astype(dtype)), 2)


def test_the_lowest_field_of_a_spheroid_is_its_rotation():
    mesh = shapes.ellipsoid(16)
    field = np.asarray(jaxkvf.killing_fields(mesh, 1).vectors[0])
    x = np.asarray(mesh.vertices)
    rotation = np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1)
    cosine = (field * rotation).sum() / np.linalg.norm(field) / np.linalg.norm(rotation)
    assert abs(cosine) > 1 - 1e-5


REAL = ("boat", "fish", "hammer", "penguin", "plane_holes", "spot", "wingnut")


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_real_meshes(real_mesh_folder, name):
    """Five positive λ·area, the same by two factorizations to 1e-8, and no negative eigenvalue to rounding."""
    mesh = TriangleMesh.load(real_mesh_folder / f"{name}.obj")
    fields = jaxkvf.killing_fields(mesh, 5, solver=ScipyEigsh(SuperLU()))
    other = jaxkvf.killing_eigenvalues(mesh, 5, solver=ScipyEigsh(Cholmod()))
    assert (np.asarray(fields.dimensionless) > 0).all()
    np.testing.assert_allclose(fields.eigenvalues, other, rtol=1e-8)
    assert float(fields.residuals.max()) < 1e-12


def test_components_are_solved_together():
    one, far = shapes.icosphere(6), shapes.icosphere(6)
    n = one.topology.n_vertices
    both = TriangleMesh.from_arrays(
        np.concatenate([np.asarray(one.vertices), np.asarray(far.vertices) + 5]),
        np.concatenate([np.asarray(one.faces), np.asarray(far.faces) + n]),
    )
    values = np.asarray(jaxkvf.killing_eigenvalues(both, 7))
    np.testing.assert_allclose(values[:6], float(jaxkvf.killing_eigenvalues(one, 1)[0]), atol=1e-10)
    assert values[6] > 1


# Derivatives ---------------------------------------------------------------------------------------------------------


def central_difference(f, x, direction):
    """Fourth order."""
    h = 1e-4
    return (
        8 * (f(x + h * direction) - f(x - h * direction))
        - (f(x + 2 * h * direction) - f(x - 2 * h * direction))
    ) / (12 * h)


@pytest.fixture(scope="module")
def noisy_spheroid():
    return shapes.add_normal_noise(shapes.ellipsoid(6, (1, 1, 1.3)), 0.03, seed=1)


@pytest.mark.parametrize("discretization", ["regge", pytest.param("dec", marks=pytest.mark.slow)])
def test_derivative_of_a_simple_eigenvalue(noisy_spheroid, discretization):
    mesh = noisy_spheroid
    direction = jnp.asarray(np.random.default_rng(0).standard_normal(mesh.vertices.shape))

    @jax.jit
    def lowest(x):
        return jaxkvf.killing_eigenvalues(mesh.with_vertices(x), 1, discretization=discretization)[0]

    expected = central_difference(lowest, mesh.vertices, direction)
    forward = jax.jvp(lowest, (mesh.vertices,), (direction,))[1]
    reverse = (jax.jit(jax.grad(lowest))(mesh.vertices) * direction).sum()
    np.testing.assert_allclose(forward, expected, rtol=1e-6)
    np.testing.assert_allclose(reverse, expected, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("discretization", ["regge", "dec"])
def test_derivative_of_the_sum_of_the_spheres_triple(discretization):
    """At the round sphere the triple is split by any perturbation, but its sum is smooth. The four-fold sum of the
    triples λ₀…λ₂ and λ₃…λ₅ is asked too, whose derivative is not near zero."""
    mesh = shapes.icosphere(5)
    direction = jnp.asarray(np.random.default_rng(0).standard_normal(mesh.vertices.shape))
    for last in (3, 6):

        @jax.jit
        def total(x, last=last):
            values = jaxkvf.killing_eigenvalues(mesh.with_vertices(x), last, discretization=discretization)
            return values.sum()

        expected = central_difference(total, mesh.vertices, direction)
        forward = jax.jvp(total, (mesh.vertices,), (direction,))[1]
        reverse = (jax.grad(total)(mesh.vertices) * direction).sum()
        np.testing.assert_allclose(forward, expected, rtol=1e-6)
        np.testing.assert_allclose(reverse, expected, rtol=1e-6)


@pytest.mark.slow
def test_derivative_with_respect_to_lengths(noisy_spheroid):
    mesh = noisy_spheroid
    lengths = g.edge_lengths(mesh.vertices, mesh.topology)
    direction = lengths * jnp.asarray(np.random.default_rng(0).standard_normal(lengths.shape))

    def lowest(lengths):
        return jaxkvf.intrinsic_killing_eigenvalues(lengths, mesh.topology, 1)[0]

    expected = central_difference(jax.jit(lowest), lengths, direction)
    np.testing.assert_allclose((jax.grad(lowest)(lengths) * direction).sum(), expected, rtol=1e-6)


@pytest.mark.slow
def test_vmap_over_vertices(noisy_spheroid):
    mesh = noisy_spheroid
    batch = jnp.stack([mesh.vertices, 2 * mesh.vertices, shapes.ellipsoid(6, (1, 1, 1.3)).vertices])

    def lowest(x):
        return jaxkvf.killing_eigenvalues(mesh.with_vertices(x), 3)

    together = jax.vmap(lowest)(batch)
    np.testing.assert_allclose(together, jnp.stack([lowest(x) for x in batch]), rtol=1e-9, atol=1e-12)
    gradients = jax.vmap(jax.grad(lambda x: lowest(x)[0]))(batch)
    np.testing.assert_allclose(
        gradients[0], jax.grad(lambda x: lowest(x)[0])(batch[0]), rtol=1e-8, atol=1e-12
    )
    np.testing.assert_allclose(gradients[1], gradients[0] / 8, rtol=1e-6, atol=1e-9)


def test_euler_identity_of_the_gradient(noisy_spheroid):
    """λ is homogeneous of degree −2 in the positions: ⟨∇λ, x⟩ = −2λ; and blind to translations."""
    mesh = noisy_spheroid
    value, gradient = jax.value_and_grad(lambda x: jaxkvf.killing_eigenvalues(mesh.with_vertices(x), 1)[0])(
        mesh.vertices
    )
    np.testing.assert_allclose((gradient * mesh.vertices).sum(), -2 * value, rtol=1e-9)
    np.testing.assert_allclose(gradient.sum(axis=0), 0, atol=1e-9)
