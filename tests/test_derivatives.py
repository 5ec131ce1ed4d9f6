"""Derivatives of eigenpairs against dense eigh, finite differences, and what clusters allow."""

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest

import jaxkvf
from jaxkvf import eigen, shapes
from jaxkvf.eigen import LOBPCG, DenseEigh, GeneralizedEigenproblem, ScipyEigsh, eigsolve, spectral_sum
from jaxkvf.killing import vector_hierarchy
from jaxkvf.preconditioning import Multigrid

SOLVERS = {"dense": DenseEigh(), "scipy": ScipyEigsh(), "lobpcg": LOBPCG(rtol=1e-13)}
N, K = 30, 4


def symmetric(random):
    m = random.standard_normal((N, N))
    return 0.5 * (m + m.T)


class Family:
    """A(t), B(t) through matrices of a given spectrum, quadratic in t."""

    def __init__(self, spectrum, seed=0):
        random = np.random.default_rng(seed)
        q, _ = np.linalg.qr(random.standard_normal((N, N)))
        half = q * np.sqrt(np.geomspace(1, 10, N)) @ q.T
        basis, _ = np.linalg.qr(random.standard_normal((N, N)))
        self.A = [half @ (basis * spectrum @ basis.T) @ half, symmetric(random), symmetric(random)]
        self.B = [half @ half, 0.1 * symmetric(random), 0.1 * symmetric(random)]
        self.weights = jnp.asarray(random.standard_normal(N))

    def matrices(self, t):
        return tuple(M[0] + t * M[1] + t**2 * M[2] for M in (self.A, self.B))

    def problem(self, t):
        A, B = self.matrices(t)
        return GeneralizedEigenproblem(
            lx.MatrixLinearOperator(0.5 * (A + A.T), lx.symmetric_tag),
            lx.MatrixLinearOperator(B, lx.positive_semidefinite_tag),
        )

    def dense(self, t):
        """All pairs by jnp.linalg.eigh, whose derivatives are JAX's own."""
        A, B = self.matrices(t)
        factor = jnp.linalg.cholesky(B)
        reduced = jnp.linalg.solve(factor, jnp.linalg.solve(factor, A).T)
        values, vectors = jnp.linalg.eigh(0.5 * (reduced + reduced.T))
        return values, jnp.linalg.solve(factor.T, vectors)


SIMPLE = Family(np.linspace(1, 30, N))
DOUBLE = Family(np.concatenate([[1, 2, 2], np.linspace(5, 30, N - 3)]))  # λ₁ = λ₂


def read_out(values, vectors):
    return jnp.concatenate([values[:K], (SIMPLE.weights @ vectors[:, :K]) ** 2])


@pytest.mark.parametrize(
    "solver", ["scipy", *(pytest.param(name, marks=pytest.mark.slow) for name in ("dense", "lobpcg"))]
)
def test_first_and_second_derivatives_match_dense_eigh(solver):
    def ours(t):
        solution = eigsolve(SIMPLE.problem(t), K, SOLVERS[solver])
        return read_out(solution.eigenvalues, solution.eigenvectors)

    def theirs(t):
        return read_out(*SIMPLE.dense(t))

    points = jnp.asarray([0.0, 0.01])
    for forward, reverse in ((jax.jacfwd, jax.jacrev), (lambda f: jax.jacfwd(jax.jacrev(f)), None)):
        expected = jax.jit(jax.vmap(forward(theirs)))(points)
        found = jax.jit(jax.vmap(forward(ours)))(points)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8)
        if reverse is not None:
            np.testing.assert_allclose(jax.jit(reverse(ours))(0.01), expected[1], rtol=1e-6, atol=1e-8)


@pytest.mark.slow
def test_third_derivatives_match_dense_eigh():
    def third(function):
        return jax.jit(jax.jacfwd(jax.jacfwd(jax.jacfwd(function))))(0.0)

    found = third(lambda t: eigen.eigenvalues(SIMPLE.problem(t), K, DenseEigh()))
    np.testing.assert_allclose(found, third(lambda t: SIMPLE.dense(t)[0][:K]), rtol=1e-8)


def test_the_rules_are_not_eighs_own():
    """Ours find nothing when differentiated but linear algebra with k vectors: no eigh of size n in the tangent."""
    linear = jax.linearize(lambda t: eigen.eigenvalues(SIMPLE.problem(t), K, ScipyEigsh()), 0.0)[1]
    tangent = str(jax.make_jaxpr(linear)(1.0))
    assert "eigh" not in tangent and f"{N},{K}" in tangent


def test_first_derivative_of_eigenvalues_alone_solves_nothing():
    def jaxpr(function):
        return str(jax.make_jaxpr(lambda t: jax.jvp(function, (t,), (1.0,)))(0.0))

    alone = jaxpr(lambda t: eigen.eigenvalues(SIMPLE.problem(t), K, ScipyEigsh()))
    pairs = jaxpr(lambda t: eigsolve(SIMPLE.problem(t), K, ScipyEigsh()).eigenvectors)
    assert alone.count("pure_callback[") < pairs.count("pure_callback[")


@pytest.mark.parametrize("k", [pytest.param(2, marks=pytest.mark.slow), 3])  # 2 cuts the cluster
def test_a_single_eigenvalue_of_a_cluster_is_an_error_that_names_it(k):
    def second(t):
        return eigen.eigenvalues(DOUBLE.problem(t), k)[1]

    with pytest.raises(Exception, match=f"Eigenvalues? 1{'' if k == 2 else ' to 2'} .*one cluster"):
        jax.grad(second)(0.0)
    # Forward mode does not see what is asked: the mean's derivative, or none.
    mean = jax.jacfwd(lambda t: DOUBLE.dense(t)[0][1:3].sum() / 2)(0.0)
    np.testing.assert_allclose(jax.jacfwd(second)(0.0), mean if k == 3 else np.nan, rtol=1e-8)


@pytest.mark.slow
def test_what_is_symmetric_in_a_cluster_has_derivatives():
    """Sums, spectral functions and projectors, to second order, against central differences of dense eigh."""

    def sums(t):
        values = eigen.eigenvalues(DOUBLE.problem(t), 3)
        return eigen.cluster_sums(values, jnp.asarray([0, 1, 1]))[1]

    def spectral(t):
        return spectral_sum(lambda value: jnp.exp(-value), DOUBLE.problem(t), 3)

    def projector(t, degenerate="mean"):
        X = eigsolve(DOUBLE.problem(t), 3, degenerate=degenerate).eigenvectors[:, 1:]
        return ((DOUBLE.weights @ X) ** 2).sum()

    def dense(t):
        values, vectors = DOUBLE.dense(t)
        values, X = values[:3], vectors[:, 1:3]
        return jnp.stack([values[1:].sum(), jnp.exp(-values).sum(), ((DOUBLE.weights @ X) ** 2).sum()])

    h = 1e-3
    nodes = h * jnp.arange(-2.0, 3.0)
    samples = jax.vmap(dense)(nodes)
    first = jnp.asarray([1.0, -8, 0, 8, -1]) @ samples / (12 * h)
    second = jnp.asarray([-1.0, 16, -30, 16, -1]) @ samples / (12 * h**2)
    for number, function in enumerate((sums, spectral, projector)):
        np.testing.assert_allclose(jax.grad(function)(0.0), first[number], rtol=1e-6)
        np.testing.assert_allclose(jax.jacfwd(jax.grad(function))(0.0), second[number], rtol=1e-4)
    np.testing.assert_allclose(jax.grad(jax.grad(sums))(0.0), second[0], rtol=1e-4)
    np.testing.assert_allclose(jax.grad(lambda t: projector(t, "error"))(0.0), first[2], rtol=1e-6)


def test_the_switch_gives_the_mean():
    def values(t):
        return eigen.eigenvalues(DOUBLE.problem(t), 3, degenerate="mean")

    rates = jax.jacfwd(values)(0.0)
    np.testing.assert_allclose(rates, jax.jacrev(values)(0.0), rtol=1e-12)
    dense = jax.jacfwd(lambda t: DOUBLE.dense(t)[0][:3].sum())(0.0)  # the trace, where eigh is right too
    np.testing.assert_allclose(rates[1], rates[2], rtol=1e-12)
    np.testing.assert_allclose(rates.sum(), dense, rtol=1e-8)
    with pytest.raises(ValueError, match="degenerate must be 'error' or 'mean', got 'median'"):
        eigsolve(DOUBLE.problem(0.0), 3, degenerate="median")


def test_an_eigenvector_of_a_cluster_is_an_error():
    with pytest.raises(Exception, match=r"Eigenvalues 1 to 2 .* eigenvectors have no derivative"):
        jax.grad(lambda t: (DOUBLE.weights @ eigsolve(DOUBLE.problem(t), 3).eigenvectors[:, 1]) ** 2)(0.0)
    first = jax.grad(lambda t: (DOUBLE.weights @ eigsolve(DOUBLE.problem(t), 3).eigenvectors[:, 0]) ** 2)(0.0)
    dense = jax.jacfwd(lambda t: (DOUBLE.weights @ DOUBLE.dense(t)[1][:, 0]) ** 2)(0.0)
    np.testing.assert_allclose(first, dense, rtol=1e-8)


@pytest.fixture(scope="module")
def noisy():
    return shapes.add_normal_noise(shapes.ellipsoid(4), 0.05, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("solver", [None, "multigrid"], ids=["default", "multigrid"])
def test_hessian_vector_products_on_a_mesh(noisy, solver):
    if solver == "multigrid":
        lengths = jaxkvf.geometry.edge_lengths(noisy.vertices, noisy.topology)
        hierarchy = vector_hierarchy(lengths, noisy.topology, direct_below=10)
        assert len(hierarchy) == 2
        solver = LOBPCG(rtol=1e-12, preconditioner=Multigrid(hierarchy))
    direction = jnp.asarray(np.random.default_rng(0).standard_normal(noisy.vertices.shape))

    @jax.jit
    def gradient(x):
        return jax.grad(lambda x: jaxkvf.killing_eigenvalues(noisy.with_vertices(x), 1, solver=solver)[0])(x)

    product = jax.jvp(gradient, (noisy.vertices,), (direction,))[1]
    h = 1e-5
    differences = gradient(noisy.vertices + h * direction) - gradient(noisy.vertices - h * direction)
    error = np.linalg.norm(product - differences / (2 * h)) / np.linalg.norm(product)
    assert error < 1e-5


@pytest.mark.slow
def test_the_three_rotations_of_a_sphere_are_one_cluster():
    sphere = shapes.icosphere(3)

    def values(x, k):
        return jaxkvf.killing_eigenvalues(sphere.with_vertices(x), k)

    with pytest.raises(Exception, match=r"Eigenvalue 0 .*may go on beyond the 1 asked for"):
        jax.grad(lambda x: values(x, 1)[0])(sphere.vertices)
    # The sum scales as length⁻² …
    gradient = jax.grad(lambda x: values(x, 3).sum())(sphere.vertices)
    np.testing.assert_allclose(
        (gradient * sphere.vertices).sum(), -2 * values(sphere.vertices, 3).sum(), rtol=1e-6
    )
    # … and is blind to rotation.
    turning = np.cross([0.0, 0, 1], sphere.vertices)
    np.testing.assert_allclose((gradient * turning).sum(), 0, atol=1e-12)


@pytest.mark.slow
def test_inside_a_larger_jitted_loss(noisy):
    """λ₀ · area next to a network's loss, say: one gradient through both, equal to finite differences."""

    @jax.jit
    @jax.value_and_grad
    def loss(parameters):
        scale, offset = parameters
        mesh = noisy.with_vertices(
            noisy.vertices * scale[None, :] + 0.01 * jnp.sin(3 * noisy.vertices + offset)
        )
        lengths = jaxkvf.geometry.edge_lengths(mesh.vertices, mesh.topology)
        area = jaxkvf.geometry.surface_area(lengths, mesh.topology)
        return jaxkvf.killing_eigenvalues(mesh, 1)[0] * area + (area - 12) ** 2

    at = (jnp.asarray([1.0, 1.1, 1.2]), jnp.asarray(0.3))
    _, (scale_gradient, offset_gradient) = loss(at)
    h = 1e-6
    for i in range(3):
        step = h * jnp.eye(3)[i]
        difference = (loss((at[0] + step, at[1]))[0] - loss((at[0] - step, at[1]))[0]) / (2 * h)
        np.testing.assert_allclose(scale_gradient[i], difference, rtol=1e-6)
    difference = (loss((at[0], at[1] + h))[0] - loss((at[0], at[1] - h))[0]) / (2 * h)
    np.testing.assert_allclose(offset_gradient, difference, rtol=1e-5)
