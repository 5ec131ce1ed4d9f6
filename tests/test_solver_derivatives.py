"""First and second derivatives with every solver, with constraints or not, against `eigh` on the complement."""

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest

from jaxkvf import eigen
from jaxkvf.eigen import (
    LOBPCG,
    AbstractStatelessEigensolver,
    DenseEigh,
    GeneralizedEigenproblem,
    ScipyEigsh,
    WithFallback,
    eigsolve,
)

N, K, C = 24, 3, 3
RANDOM = np.random.default_rng(7)
AWAY = RANDOM.standard_normal((N, C))  # constraints that are no eigenvectors, and not orthonormal


def symmetric(scale=1.0):
    m = RANDOM.standard_normal((N, N))
    return scale * 0.5 * (m + m.T)


A0, A1, A2 = np.diag(np.arange(1.0, N + 1)), symmetric(), symmetric()
B0, B1, B2 = np.diag(np.linspace(1, 3, N)), symmetric(0.1), symmetric(0.1)
WEIGHTS = RANDOM.standard_normal(N)


class Custom(AbstractStatelessEigensolver):
    """What a user would write: the solve alone."""

    def compute(self, problem, k, guess):
        solution, _ = DenseEigh().compute(problem, k, guess)
        return solution, None


def matrices(t, dtype):
    return tuple(
        jnp.asarray(M[0], dtype) + t * jnp.asarray(M[1], dtype) + t**2 * jnp.asarray(M[2], dtype)
        for M in ((A0, A1, A2), (B0, B1, B2))
    )


def problem(t, tag=lx.symmetric_tag, dtype=np.float64):
    A, B = matrices(t, dtype)
    B = lx.MatrixLinearOperator(B, lx.positive_semidefinite_tag)
    return GeneralizedEigenproblem(lx.MatrixLinearOperator(A, tag), B)


def read_out(values, vectors):
    weights = jnp.asarray(WEIGHTS, vectors.dtype)
    return jnp.concatenate([values[:K], (weights @ vectors[:, :K]) ** 2])


def dense(t, constraints=None):
    """By `jnp.linalg.eigh`, whose derivatives are JAX's own, in coordinates of the complement."""
    A, B = matrices(t, np.float64)
    basis = jnp.eye(N)
    if constraints is not None:
        BY = B @ constraints
        rest = np.linalg.qr(constraints, mode="complete")[0][:, constraints.shape[1] :]
        basis = rest - constraints @ jnp.linalg.solve(constraints.T @ BY, BY.T @ rest)
    factor = jnp.linalg.cholesky(basis.T @ B @ basis)
    reduced = jnp.linalg.solve(factor, jnp.linalg.solve(factor, basis.T @ A @ basis).T)
    values, vectors = jnp.linalg.eigh(0.5 * (reduced + reduced.T))
    return read_out(values, basis @ jnp.linalg.solve(factor.T, vectors))


SHARP = LOBPCG(rtol=1e-13)
KEPT_OFF = LOBPCG(rtol=1e-13, constraints=jnp.asarray(AWAY))
GUESS = jnp.asarray(np.eye(N)[:, :K])
CASES = {  # solver, tag of A, guess, dtype
    "scipy": (ScipyEigsh(), lx.symmetric_tag, None, np.float64),
    "dense": (DenseEigh(), lx.positive_semidefinite_tag, None, np.float64),
    "lobpcg, constraints": (KEPT_OFF, lx.symmetric_tag, None, np.float64),
    "lobpcg": (SHARP, lx.positive_semidefinite_tag, GUESS, np.float64),
    "lobpcg, constraints, guess": (KEPT_OFF, lx.positive_semidefinite_tag, GUESS, np.float64),
    "scipy, guess": (ScipyEigsh(), lx.positive_semidefinite_tag, GUESS, np.float64),
    "fallback unused": (WithFallback(SHARP, ScipyEigsh()), lx.symmetric_tag, None, np.float64),
    "fallback used": (
        WithFallback(LOBPCG(max_steps=1), ScipyEigsh()),
        lx.symmetric_tag,
        None,
        np.float64,
    ),
    "fallback, constraints": (
        WithFallback(LOBPCG(max_steps=1, constraints=jnp.asarray(AWAY)), KEPT_OFF),
        lx.symmetric_tag,
        None,
        np.float64,
    ),
    "custom": (Custom(), lx.symmetric_tag, None, np.float64),
    "dense, float32": (DenseEigh(), lx.symmetric_tag, None, np.float32),
    "scipy, float32": (ScipyEigsh(), lx.symmetric_tag, None, np.float32),
    "lobpcg, float32": (LOBPCG(), lx.symmetric_tag, GUESS.astype(np.float32), np.float32),
}
QUICK = ("scipy", "dense", "lobpcg, constraints")


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.exhaustive) for name in CASES]
)
def test_first_and_second_derivatives(name):
    solver, tag, guess, dtype = CASES[name]
    constraints = None if solver.constraints is None else AWAY

    def ours(t):
        solution = eigsolve(problem(t, tag, dtype), K, solver, guess=guess)
        return read_out(solution.eigenvalues, solution.eigenvectors)

    at = 0.05
    first, second = jax.jit(jax.vmap(lambda t: (jax.jacfwd(ours)(t), jax.jacfwd(jax.jacrev(ours))(t))))(
        jnp.asarray([at], dtype)
    )
    rtol, scale = (1e-7, 1e-9) if dtype == np.float64 else (5e-3, 5e-4)
    for found, expected in (
        (first[0], jax.jacfwd(lambda t: dense(t, constraints))(at)),
        (second[0], jax.jacfwd(jax.jacrev(lambda t: dense(t, constraints)))(at)),
    ):
        np.testing.assert_allclose(found, expected, rtol=rtol, atol=scale * np.abs(expected).max())


def test_constraints_of_a_rotating_problem():
    """λ₀ of A + s A₁ off three random columns: its second derivative by central differences of SciPy's `eigh`."""
    import scipy.linalg  # noqa: PLC0415

    rest = scipy.linalg.null_space(AWAY.T)

    def lowest(s):
        return np.linalg.eigvalsh(rest.T @ (A0 + s * A1) @ rest)[0]

    def ours(s):
        A = lx.MatrixLinearOperator(jnp.asarray(A0) + s * jnp.asarray(A1), lx.symmetric_tag)
        B = lx.MatrixLinearOperator(jnp.eye(N), lx.positive_semidefinite_tag)
        return eigen.eigenvalues(GeneralizedEigenproblem(A, B), 1, KEPT_OFF)[0]

    h = 1e-3
    second = (lowest(h) - 2 * lowest(0.0) + lowest(-h)) / h**2
    np.testing.assert_allclose(jax.jit(jax.grad(jax.grad(ours)))(0.0), second, rtol=1e-4)


def test_all_pairs_but_none_or_one_have_gradients():
    """Where one pair more than asked for is all there are, or is not there."""
    for solver, room in ((ScipyEigsh(), N), (KEPT_OFF, N - C)):
        for k in (room - 1, room):
            gradient = jax.grad(lambda t, k=k, s=solver: eigen.eigenvalues(problem(t), k, s).sum())(0.05)
            h = 1e-5
            sums = [float(eigen.eigenvalues(problem(0.05 + d), k, solver).sum()) for d in (h, -h)]
            np.testing.assert_allclose(gradient, (sums[0] - sums[1]) / (2 * h), rtol=1e-6)


def test_solvers_of_a_fallback_have_the_same_constraints():
    with pytest.raises(ValueError, match="same constraints"):
        WithFallback(KEPT_OFF, ScipyEigsh())
