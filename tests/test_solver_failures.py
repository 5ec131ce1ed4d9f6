"""What solvers do where it is hard: wide kernels, guesses that cancel, threads, lost digits, samples that fail."""

import threading

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from jaxkvf import eigen
from jaxkvf.eigen import (
    LOBPCG,
    RESULTS,
    AbstractStatelessEigensolver,
    DegenerateEigenvalueError,
    DenseEigh,
    GeneralizedEigenproblem,
    ScipyEigsh,
    SuperLU,
    WithFallback,
    eigsolve,
)

SOLVERS = {"dense": DenseEigh(), "scipy": ScipyEigsh(), "lobpcg": LOBPCG(rtol=1e-10)}
EACH = ["dense", "scipy", pytest.param("lobpcg", marks=pytest.mark.exhaustive)]


def problem_of(A, B=None, tag=lx.symmetric_tag):
    B = jnp.eye(len(A), dtype=A.dtype) if B is None else B
    return GeneralizedEigenproblem(
        lx.MatrixLinearOperator(jnp.asarray(A), tag), lx.MatrixLinearOperator(B, lx.positive_semidefinite_tag)
    )


def rotated(spectrum, seed=0):
    q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((len(spectrum), len(spectrum))))
    A = (q * spectrum) @ q.T
    return jnp.asarray(0.5 * (A + A.T))


class Counted(AbstractStatelessEigensolver):
    """`DenseEigh` on the host, counting the problems that it is given."""

    calls: list = eqx.field(static=True)

    def compute(self, problem, k, guess):
        def on_host(A, B):
            self.calls.append(1)
            values, vectors = np.linalg.eigh(np.asarray(A))
            return values[:k], vectors[:, :k]

        n = problem.size
        shapes = (jax.ShapeDtypeStruct((k,), jnp.float64), jax.ShapeDtypeStruct((n, k), jnp.float64))
        A, B = problem.A.as_matrix(), problem.B.as_matrix()
        values, vectors = jax.pure_callback(on_host, shapes, A, B, vmap_method="sequential")
        return eigen.EigenSolution(values, vectors, 0 * values, RESULTS.successful, {}), None

    def __hash__(self):
        return id(self.calls)


class Picky(AbstractStatelessEigensolver):
    """`DenseEigh`, which gives up where the first entry of A is above 100."""

    def compute(self, problem, k, guess):
        solution, _ = DenseEigh().compute(problem, k, guess)
        refused = problem.A.as_matrix()[0, 0] > 100
        result = RESULTS.where(refused, RESULTS.max_steps_reached, solution.result)
        values = jnp.where(refused, jnp.nan, solution.eigenvalues)
        return eigen.EigenSolution(values, solution.eigenvectors, solution.residuals, result, {}), None


SPREAD = np.linspace(1, 30, 30)


def test_a_solve_that_converges_never_calls_the_fallback():
    calls = []
    solver = WithFallback(Picky(), Counted(calls))
    A, change = rotated(SPREAD), jnp.diag(jnp.arange(30.0))

    def lowest(s):
        return eigen.eigenvalues(problem_of(A * s), 2, solver)[0]

    def component(s):
        return eigsolve(problem_of(A + s * change), 1, solver).eigenvectors[0, 0] ** 2

    two = jnp.asarray([1.0, 2.0])
    np.testing.assert_allclose(lowest(1.0), 1, rtol=1e-8)
    np.testing.assert_allclose(jax.jit(lambda: eigsolve(problem_of(A), 2, solver).eigenvalues)(), [1, 2])
    np.testing.assert_allclose(jax.jit(jax.vmap(lowest))(two), two, rtol=1e-8)
    np.testing.assert_allclose(jax.vmap(jax.grad(lowest))(two), 1, rtol=1e-8)
    assert np.isfinite(jax.jit(jax.vmap(jax.grad(component)))(two)).all()
    assert not calls


def test_the_fallback_is_called_for_the_samples_that_fail_alone():
    calls = []
    solver = WithFallback(Picky(), Counted(calls))
    A = rotated(SPREAD)
    batch = jnp.stack([A, 200 * A, 300 * A])
    found = jax.jit(jax.vmap(lambda A: eigsolve(problem_of(A), 2, solver)))(batch)
    np.testing.assert_allclose(found.eigenvalues, [[1, 2], [200, 400], [300, 600]], rtol=1e-8)
    assert found.stats["fell_back"].tolist() == [False, True, True] and len(calls) == 2
    outside = eigsolve(problem_of(200 * A), 2, solver)
    assert bool(outside.stats["fell_back"]) and len(calls) == 3


def test_a_factorization_serves_the_derivative_too():
    made = []

    class Counting(eigen.AbstractFactorization):
        def factorize(self, matrix):
            made.append(matrix.shape)
            return SuperLU().factorize(matrix)

    A, change = rotated(SPREAD), jnp.diag(jnp.arange(30.0))

    def component(s):
        solution = eigsolve(problem_of(A + s * change), 2, ScipyEigsh(Counting()))
        return (solution.eigenvectors[0] ** 2).sum() + solution.eigenvalues[1]

    expected = jax.jacfwd(lambda s: (jnp.linalg.eigh(A + s * change)[1][0, :2] ** 2).sum())(0.0)
    expected += (jnp.linalg.eigh(A)[1][:, 1] ** 2 * jnp.arange(30.0)).sum()
    for differentiated in (jax.grad(component), jax.jacfwd(component), jax.jit(jax.grad(component))):
        made.clear()
        np.testing.assert_allclose(differentiated(0.0), expected, rtol=1e-8)
        assert len(made) == 1


@pytest.mark.parametrize("solver", EACH)
@pytest.mark.parametrize("width", [5, 40])
def test_kernels_wider_than_k(solver, width):
    """Many loose pieces of a mesh have three dimensions of kernel each."""
    spectrum = np.concatenate([np.zeros(width), np.linspace(1, 1000, 90 - width)])
    solution = eigsolve(problem_of(rotated(spectrum)), 6, SOLVERS[solver])
    np.testing.assert_allclose(solution.eigenvalues, np.sort(spectrum)[:6], atol=1e-8)
    assert float(solution.residuals.max()) < 1e-9


@pytest.mark.parametrize(
    "guess",
    [np.eye(60)[:, :2] @ np.array([[1, -1], [0, 0]]), np.zeros((60, 3)), np.full((60, 2), np.nan)],
    ids=["cancels", "zero", "not finite"],
)
def test_guesses_without_a_direction(guess):
    A = rotated(np.arange(60.0))
    found = eigsolve(problem_of(A), 3, ScipyEigsh(), guess=jnp.asarray(guess))
    np.testing.assert_allclose(found.eigenvalues, [0, 1, 2], atol=1e-10)


def test_two_threads_give_their_blas_threads_back():
    def threads():
        return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]

    problem = GeneralizedEigenproblem(
        lx.DiagonalLinearOperator(jnp.linspace(1, 100, 3000)),
        lx.TaggedLinearOperator(lx.DiagonalLinearOperator(jnp.ones(3000)), lx.positive_semidefinite_tag),
    )
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        workers = [
            threading.Thread(target=lambda: ScipyEigsh(SuperLU()).compute(problem, 5, None)) for _ in range(4)
        ]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        assert threads() == before


@pytest.mark.parametrize("solver", EACH)
def test_a_matrix_that_is_not_what_it_is_declared_to_be(solver):
    spectrum = np.concatenate([[-1e-3], np.linspace(1, 30, 29)])
    declared = problem_of(rotated(spectrum), tag=lx.positive_semidefinite_tag)
    assert eigsolve(declared, 2, SOLVERS[solver], throw=False).result == RESULTS.negative_energy
    with pytest.raises(eqx.EquinoxRuntimeError, match="far below zero"):
        eigsolve(declared, 2, SOLVERS[solver])
    # To rounding it may be, and undeclared it may be anything.
    eigsolve(
        problem_of(rotated(np.linspace(0, 30, 30)), tag=lx.positive_semidefinite_tag), 2, SOLVERS[solver]
    )
    np.testing.assert_allclose(
        eigsolve(problem_of(rotated(spectrum)), 2, SOLVERS[solver]).eigenvalues, [-1e-3, 1], rtol=1e-9
    )


@pytest.mark.parametrize("solver", EACH)
def test_a_residual_above_the_tolerance_is_a_failure(solver):
    """With a B that is singular in all but the last digits no solver has eigenpairs to show, nor says that it has."""
    A, B = rotated(SPREAD), rotated(np.geomspace(1e-15, 1, 30), 1)
    few = LOBPCG(max_steps=20) if solver == "lobpcg" else SOLVERS[solver]
    solution = eigsolve(problem_of(A, B), 25, few, throw=False)
    A, B = np.asarray(A), np.asarray(B)
    x, values = np.asarray(solution.eigenvectors), np.asarray(solution.eigenvalues)
    residuals = np.linalg.norm(A @ x - B @ x * values, axis=0) / 30 / np.linalg.norm(x, axis=0)
    assert (solution.result == RESULTS.successful) == bool((residuals < 1e-7).all())


@pytest.mark.parametrize("solver", EACH)
def test_a_sample_that_fails_has_no_gradient_and_leaves_the_others_alone(solver):
    """NaN is never taken for a cluster; clusters elsewhere are none of its business."""
    A, change = rotated(SPREAD), jnp.diag(jnp.arange(30.0))

    def loss(s):
        found = eigsolve(problem_of(A + s * change), 3, SOLVERS[solver], throw=False)
        return found.eigenvalues[1] + found.eigenvectors[0, 0] ** 2

    at = jnp.asarray([0.0, jnp.nan, 0.1])
    gradients = jax.jit(jax.vmap(jax.value_and_grad(loss)))(at)[1]
    assert np.isfinite(gradients).tolist() == [True, False, True]
    np.testing.assert_allclose(gradients[2], jax.jit(jax.grad(loss))(0.1), rtol=1e-6)
    with pytest.raises(RuntimeError, match="NaN or infinity"):
        jax.grad(lambda s: eigen.eigenvalues(problem_of(A + s * change), 3, SOLVERS[solver])[0])(jnp.nan)


def test_an_optimizer_can_skip_updates_that_are_not_finite():
    """What `optax.apply_if_finite` does: take the step where the gradient is finite, else stay."""
    A = rotated(SPREAD)

    @jax.jit
    @jax.value_and_grad
    def loss(s, data):
        found = eigsolve(problem_of(A * s + data), 2, throw=False)
        return found.eigenvalues.sum() ** 2

    s = 1.0
    for data in (0.0, jnp.inf, 0.0):
        value, gradient = loss(s, data)
        assert bool(jnp.isfinite(value)) == bool(jnp.isfinite(gradient)) == bool(np.isfinite(data))
        s = jnp.where(jnp.isfinite(gradient), s - 0.01 * gradient, s)
    assert 0 < float(s) < 1


def test_the_error_of_a_cluster_is_one_class_and_one_message():
    spectrum = np.concatenate([[1, 2, 2], np.linspace(5, 30, 27)])
    A, change = rotated(spectrum), jnp.diag(jnp.arange(30.0))

    def second(s):
        return eigen.eigenvalues(problem_of(A + s * change), 3)[1]

    message = r"Eigenvalues 1 to 2 \(counted from 0\) are in one cluster"
    with pytest.raises(DegenerateEigenvalueError, match=message) as eager:
        jax.grad(second)(0.0)
    assert "Traceback" not in str(eager.value) and len(str(eager.value)) < 600
    with pytest.raises(eqx.EquinoxRuntimeError, match=message):
        eqx.filter_jit(jax.grad(second))(0.0)
    with pytest.raises(RuntimeError, match=message):
        jax.jit(jax.grad(second))(0.0)
    assert issubclass(DegenerateEigenvalueError, eqx.EquinoxRuntimeError)
