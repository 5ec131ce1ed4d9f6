"""LOBPCG on matrices with prescribed spectra and on spheres."""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest
import scipy.linalg
from threadpoolctl import threadpool_limits

from jaxkvf.eigen import (
    LOBPCG,
    RESULTS,
    AbstractApproximateInverse,
    AbstractPreconditioner,
    DenseEigh,
    GeneralizedEigenproblem,
    eigsolve,
)
from jaxkvf.preconditioning import Chebyshev
from jaxkvf.sparse import spectral_norm

SIZE = 120
SHARP = LOBPCG(rtol=1e-12)


@pytest.fixture(autouse=True)
def _one_blas_thread():
    """NumPy's threads beside those of XLA make products of 120 × 120 matrices take a second."""
    with threadpool_limits(1, user_api="blas"):
        yield


def problem_of(A, B):
    A = lx.MatrixLinearOperator(jnp.asarray(0.5 * (A + A.T)), lx.symmetric_tag)
    return GeneralizedEigenproblem(A, lx.MatrixLinearOperator(jnp.asarray(B), lx.positive_semidefinite_tag))


def matrices(lowest, condition=10, size=SIZE, seed=0):
    """A and B with A x = λ B x at the given λ and at others from a gap above them to 50; B of this condition."""
    rng = np.random.default_rng(seed)
    top = max(lowest, default=0) + 1
    spectrum = np.concatenate([np.sort(lowest), np.linspace(top, top + 50, size - len(lowest))])
    q, _ = np.linalg.qr(rng.standard_normal((size, size)))
    half = q * np.sqrt(np.geomspace(1, condition, size)) @ q.T
    basis, _ = np.linalg.qr(rng.standard_normal((size, size)))
    return half @ (basis * spectrum @ basis.T) @ half, half @ half


def prescribed(lowest, **settings):
    return problem_of(*matrices(lowest, **settings))


def largest_angle(x, y, B):
    """Between the B-orthonormal spans of x and y. Radians."""
    x, y = np.asarray(x), np.asarray(y)
    return np.linalg.norm(y - x @ (x.T @ (np.asarray(B) @ y)), 2)


def check(solution, problem, lowest):
    """Values, orthonormality, residuals and the space of the wanted vectors, against LAPACK."""
    k = len(lowest)
    A, B = np.asarray(problem.A.as_matrix()), np.asarray(problem.B.as_matrix())
    exact = DenseEigh().compute(problem, k, None)[0]
    values, x = np.asarray(solution.eigenvalues), np.asarray(solution.eigenvectors)
    assert solution.result == RESULTS.successful
    np.testing.assert_allclose(values, lowest, rtol=1e-9, atol=1e-9 * 50)
    np.testing.assert_allclose(values, exact.eigenvalues, rtol=1e-9, atol=1e-9 * 50)
    assert (np.diff(values) >= 0).all()
    np.testing.assert_allclose(x.T @ B @ x, np.eye(k), atol=1e-11)
    residuals = (
        np.linalg.norm(A @ x - B @ x * values, axis=0) / np.linalg.norm(A, 2) / np.linalg.norm(x, axis=0)
    )
    np.testing.assert_allclose(solution.residuals, residuals, rtol=0.1, atol=1e-15)
    assert largest_angle(exact.eigenvectors, x, B) < 1e-6


SPECTRA = {
    "clusters of 2 and 3": [1, 1, 2, 2, 2, 3],
    "a cluster of 5": [0.5, 3, 3, 3, 3, 3],
    "a cluster of 12": [1.0] * 12,
    "tiny gaps": [1, 1 + 1e-9, 1 + 1e-7, 1 + 1e-5, 1 + 1e-3, 2],
    "no kernel": [0.1, 0.2, 0.3, 4, 5, 6],
    "kernel of dimension 1": [0, 0.2, 0.3, 4, 5, 6],
    "kernel of dimension 2": [0, 0, 0.3, 4, 5, 6],
    "kernel of dimension 3": [0, 0, 0, 4, 5, 6],
    "near-kernel": [1e-9, 2e-6, 1e-3, 4, 4, 5],
    "indefinite": [-3, -0.5, -1e-3, 0, 0, 1],
    "negative": [-90, -80, -80, -70, -60, -60],
    "wide": [1e-6, 1e-3, 1, 10, 100, 1000],
}


@pytest.mark.parametrize("name", SPECTRA)
def test_prescribed_spectra(name):
    lowest = np.array(SPECTRA[name], float)
    problem = prescribed(lowest)
    check(eigsolve(problem, len(lowest), SHARP), problem, lowest)


def test_a_cluster_cut_in_two():
    """Of 9 equal eigenvalues 6 are wanted, and 8 fit into the block."""
    problem = prescribed([1.0] * 9)
    solution = eigsolve(problem, 6, SHARP)
    np.testing.assert_allclose(solution.eigenvalues, 1.0, rtol=1e-9)
    assert float(solution.residuals.max()) < 2e-12


def test_many_pairs():
    """Twice the block exceeds the number of unknowns here."""
    k = 50
    lowest = np.linspace(1, 9, k)
    problem = prescribed(lowest)
    check(eigsolve(problem, k, SHARP), problem, lowest)


def test_a_problem_of_one_unknown():
    solution = eigsolve(problem_of(np.array([[6.0]]), np.array([[2.0]])), 1, LOBPCG())
    np.testing.assert_allclose(solution.eigenvalues, [3.0])


# Starts

LOWEST = np.array([0, 0, 1, 1, 1, 2.0])


def guesses():
    rng = np.random.default_rng(5)
    problem = prescribed(LOWEST)
    exact = DenseEigh().compute(problem, SIZE, None)[0].eigenvectors
    poor = rng.standard_normal((SIZE, 6))
    poisoned = poor.copy()
    poisoned[3, 2], poisoned[5, 4] = np.nan, np.inf
    return {
        "random": poor,
        "more than the block": rng.standard_normal((SIZE, 40)),
        "exact": exact[:, :6],
        "exact, from the wrong end": exact[:, -6:],
        "exact, some missing": exact[:, jnp.array([0, 2, 5, 9, 30, 70])],
        "zeros": np.zeros((SIZE, 6)),
        "six times the same": np.tile(poor[:, :1], 6),
        "forty times the same": np.tile(poor[:, :1], 40),
        "nearly the same": poor[:, :1] + 1e-13 * poor,
        "of all sizes": poor * np.geomspace(1e-150, 1e150, 6),
        "NaN and infinity": poisoned,
    }


@pytest.mark.parametrize("name", guesses())
def test_any_guess_will_do(name):
    problem = prescribed(LOWEST)
    solution = eigsolve(problem, 6, SHARP, guess=jnp.asarray(guesses()[name]))
    check(solution, problem, LOWEST)
    if name == "exact":
        assert int(solution.stats["steps"]) == 0


@pytest.mark.parametrize("seed", range(5))
def test_matrices_of_other_seeds(seed):
    problem = prescribed(LOWEST, seed=seed)
    check(eigsolve(problem, 6, SHARP), problem, LOWEST)


# Constraints


@pytest.mark.parametrize("kind", ["eigenvectors", "any", "repeated", "none"])
def test_constraints(kind):
    """The problem is then that of A and B on the B-orthogonal complement."""
    A, B = matrices(LOWEST)
    Y = {
        "eigenvectors": np.asarray(DenseEigh().compute(problem_of(A, B), 5, None)[0].eigenvectors),
        "any": np.random.default_rng(2).standard_normal((SIZE, 5)),
        "repeated": np.random.default_rng(2).standard_normal((SIZE, 2))[:, [0, 1, 1, 0, 0]],
        "none": np.zeros((SIZE, 5)),
    }[kind]
    complement = scipy.linalg.null_space((B @ Y).T, rcond=1e-10)
    exact = scipy.linalg.eigh(complement.T @ A @ complement, complement.T @ B @ complement, eigvals_only=True)
    solution = eigsolve(problem_of(A, B), 4, LOBPCG(rtol=1e-11, constraints=jnp.asarray(Y)))
    np.testing.assert_allclose(solution.eigenvalues, exact[:4], rtol=1e-9, atol=1e-9 * 50)
    np.testing.assert_allclose(np.asarray(solution.eigenvectors).T @ B @ Y, 0, atol=1e-9)
    assert float(solution.residuals.max()) < 1e-11


def test_constraints_are_checked():
    problem = prescribed([1.0])
    with pytest.raises(ValueError, match=r"constraints must have shape \[120, any\], got \[7, 1\]"):
        eigsolve(problem, 1, LOBPCG(constraints=jnp.ones((7, 1))))
    with pytest.raises(ValueError, match="119 constraints leave 1 dimensions, too few for k = 2"):
        eigsolve(problem, 2, LOBPCG(constraints=jnp.ones((SIZE, 119))))


# Transformations and dtypes


def test_inside_jit_and_vmap():
    """One batch member converges long before the other, and one has another kernel."""
    spectra = [LOWEST, np.array([0, 0, 0, 1e-4, 1e-3, 2.0])]
    A, B = (jnp.asarray(np.stack(part)) for part in zip(*(matrices(s, seed=1) for s in spectra), strict=True))

    @jax.jit
    @jax.vmap
    def values(A, B):
        problem = GeneralizedEigenproblem(
            lx.MatrixLinearOperator(A, lx.symmetric_tag),
            lx.MatrixLinearOperator(B, lx.positive_semidefinite_tag),
        )
        return eigsolve(problem, 6, SHARP).eigenvalues

    np.testing.assert_allclose(values(A, B), spectra, atol=1e-9 * 50)


@pytest.mark.slow
def test_derivatives_flow_through_the_problem():
    A, B = matrices([0.5, 1, 2.0])
    rate = jax.grad(
        lambda s: eigsolve(problem_of(jnp.asarray(A) * s, jnp.asarray(B)), 2, SHARP).eigenvalues[1]
    )(1.0)
    np.testing.assert_allclose(rate, 1.0, rtol=1e-9)


def test_float32():
    """Converges to its own rounding by default; eigenvalues to that of A times the condition of B."""
    A, B = matrices(LOWEST, condition=10)
    problem = problem_of(A.astype(np.float32), B.astype(np.float32))
    solution = eigsolve(problem, 6, LOBPCG())
    assert solution.eigenvectors.dtype == solution.residuals.dtype == np.float32
    np.testing.assert_allclose(solution.eigenvalues, LOWEST, atol=1e-3)
    x = np.asarray(solution.eigenvectors)
    np.testing.assert_allclose(x.T @ B.astype(np.float32) @ x, np.eye(6), atol=2e-5)
    assert float(solution.residuals.max()) < 2e-6


# Failures


class Given(AbstractPreconditioner):
    """This very matrix."""

    matrix: jax.Array

    def prepare(self, problem):
        return _Given(self.matrix)


class _Given(AbstractApproximateInverse):
    matrix: jax.Array

    def apply(self, block):
        return self.matrix @ block

    def starting_vectors(self, count):
        return None


def sharp_with(matrix):
    return LOBPCG(rtol=1e-12, preconditioner=Given(jnp.asarray(matrix)))


@pytest.mark.parametrize("factor", [0.0, np.nan])
def test_useless_preconditioners_are_reported(factor):
    solver = sharp_with(factor * np.eye(SIZE))
    solution = eigsolve(prescribed(LOWEST), 6, solver, throw=False)
    assert solution.result == RESULTS.stagnated
    assert np.isfinite(solution.eigenvalues).all()
    with pytest.raises(eqx.EquinoxRuntimeError, match="pass another preconditioner"):
        eigsolve(prescribed(LOWEST), 6, solver)


def test_a_preconditioner_of_the_wrong_sign_still_converges():
    problem = prescribed(LOWEST)
    check(eigsolve(problem, 6, sharp_with(-np.eye(SIZE))), problem, LOWEST)


@pytest.mark.parametrize("condition", [1, 1e3, 1e6])
def test_conditions_of_the_mass(condition):
    """With the best preconditioner there is: few steps."""
    A, B = matrices(LOWEST, condition=condition)
    solution = eigsolve(problem_of(A, B), 6, sharp_with(np.linalg.inv(A + B)))
    np.testing.assert_allclose(solution.eigenvalues, LOWEST, atol=1e-9 * 50)
    x = np.asarray(solution.eigenvectors)
    np.testing.assert_allclose(x.T @ B @ x, np.eye(6), atol=1e-10)
    assert int(solution.stats["steps"]) < 20


def test_residuals_that_rounding_holds_up_are_reported():
    """λ‖B‖ is far above ‖A‖ here, and so is the rounding of λ B x."""
    mass = np.append(1.0, np.full(SIZE - 1, 1e-9))
    q, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((SIZE, SIZE)))
    problem = problem_of((q * mass * np.linspace(0, 50, SIZE)) @ q.T, (q * mass) @ q.T)
    solution = eigsolve(problem, 6, SHARP, throw=False)
    assert solution.result == RESULTS.stagnated
    np.testing.assert_allclose(solution.eigenvalues, np.linspace(0, 50, SIZE)[:6], atol=1e-3)
    with pytest.raises(eqx.EquinoxRuntimeError, match="Loosen it if rounding stands in its way"):
        eigsolve(problem, 6, SHARP)


def test_running_out_of_steps_returns_the_best_found():
    problem = prescribed(LOWEST)
    A, B = np.asarray(problem.A.as_matrix()), np.asarray(problem.B.as_matrix())
    few = eigsolve(problem, 6, LOBPCG(max_steps=3), throw=False)
    assert few.result == RESULTS.max_steps_reached
    assert int(few.stats["steps"]) == 3
    assert int(few.stats["converged"]) < 6
    assert float(few.residuals.max()) > 1e-8
    assert (few.eigenvalues >= LOWEST - 1e-9).all()
    assert (few.eigenvalues < np.diag(A).mean() / np.diag(B).mean()).all()
    x = np.asarray(few.eigenvectors)
    np.testing.assert_allclose(x.T @ B @ x, np.eye(6), atol=1e-11)
    residuals = np.linalg.norm(A @ x - B @ x * np.asarray(few.eigenvalues), axis=0) / np.linalg.norm(
        x, axis=0
    )
    np.testing.assert_allclose(few.residuals, residuals / np.linalg.norm(A, 2), rtol=0.1)
    with pytest.raises(eqx.EquinoxRuntimeError, match="Raise `max_steps`"):
        eigsolve(problem, 6, LOBPCG(max_steps=3))


def test_bad_matrices_are_reported():
    A, B = matrices(LOWEST)
    hidden = B.copy()  # indefinite, with a positive diagonal
    hidden[0, 1] = hidden[1, 0] = 3 * np.sqrt(B[0, 0] * B[1, 1])
    assert (hidden.diagonal() > 0).all()
    hole = A.copy()
    hole[3, 4] = np.nan
    for case, result, message in (
        (problem_of(A, -B), RESULTS.indefinite_mass, "not positive definite"),
        (problem_of(A, hidden), RESULTS.indefinite_mass, "not positive definite"),
        (problem_of(A, B * np.inf), RESULTS.nonfinite_input, "NaN or infinity"),
        (problem_of(hole, B), RESULTS.nonfinite_input, "NaN or infinity"),
    ):
        assert eigsolve(case, 6, SHARP, throw=False).result == result
        with pytest.raises(eqx.EquinoxRuntimeError, match=message):
            eigsolve(case, 6, SHARP)


def test_settings_are_checked():
    for settings, message in (
        ({"rtol": -1.0}, "rtol and atol must not be negative"),
        ({"atol": float("nan")}, "rtol and atol must not be negative"),
        ({"max_steps": -1}, "max_steps must not be negative"),
        ({"guard_vectors": -1}, "guard_vectors must not be negative"),
    ):
        with pytest.raises(ValueError, match=message):
            LOBPCG(**settings)
    with pytest.raises(ValueError, match="degree must be at least 1"):
        Chebyshev(degree=0)


# Operators


@pytest.mark.parametrize("seed", range(3))
def test_the_norm_is_estimated_from_below(seed):
    A, _ = matrices([0.0, 1], condition=1, seed=seed)
    estimate = float(spectral_norm(lambda x: jnp.asarray(A) @ x, SIZE, jnp.float64))
    assert 0.9 * np.linalg.norm(A, 2) < estimate <= np.linalg.norm(A, 2) * (1 + 1e-12)


def test_operators_of_any_kind():
    """A composition, its diagonal unknown, and a multiple."""
    _, A = matrices([], condition=100)
    root = lx.MatrixLinearOperator(jnp.asarray(scipy.linalg.sqrtm(A).real))
    composed = lx.TaggedLinearOperator(root @ root.T, lx.symmetric_tag)
    mass = lx.TaggedLinearOperator(
        2.0 * lx.IdentityLinearOperator(composed.in_structure()), lx.positive_semidefinite_tag
    )
    found = eigsolve(GeneralizedEigenproblem(composed, mass), 6, SHARP)
    np.testing.assert_allclose(found.eigenvalues, np.geomspace(1, 100, SIZE)[:6] / 2, rtol=1e-9)
