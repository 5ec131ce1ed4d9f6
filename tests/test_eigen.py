"""Eigensolvers and their derivative on matrices with known spectra."""

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest
import scipy.sparse as sp

from jaxkvf import eigen, shapes
from jaxkvf import geometry as g
from jaxkvf.eigen import Cholmod, DenseEigh, GeneralizedEigenproblem, ScipyEigsh, SuperLU, eigsolve
from jaxkvf.killing import Regge
from jaxkvf.sparse import Graph, SymmetricBlockOperator, to_scipy

SOLVERS = {
    "dense": DenseEigh(),
    "superlu": ScipyEigsh(factorization=SuperLU()),
    "cholmod": ScipyEigsh(factorization=Cholmod()),
}
SPECTRUM = np.concatenate([[-0.5, 0, 0, 0, 1e-3, 1, 1, 1 + 1e-9], np.linspace(2, 50, 52)])


def matrices(spectrum=SPECTRUM, seed=0):
    """A and B with A x = λ B x at the given λ, B ill-conditioned."""
    rng = np.random.default_rng(seed)
    n = len(spectrum)
    q, _ = np.linalg.qr(rng.standard_normal((n, n)))
    half = q * np.sqrt(np.geomspace(1, 1e4, n)) @ q.T
    basis, _ = np.linalg.qr(rng.standard_normal((n, n)))
    return half @ (basis * spectrum @ basis.T) @ half, half @ half


def problem_of(A, B):
    A = lx.MatrixLinearOperator(jnp.asarray(0.5 * (A + A.T)), lx.symmetric_tag)
    return GeneralizedEigenproblem(A, lx.MatrixLinearOperator(jnp.asarray(B), lx.positive_semidefinite_tag))


@pytest.mark.parametrize("solver", SOLVERS)
def test_prescribed_spectrum(solver):
    A, B = matrices()
    solution = eigsolve(problem_of(A, B), 9, SOLVERS[solver])
    np.testing.assert_allclose(solution.eigenvalues, SPECTRUM[:9], atol=1e-9)
    x = np.asarray(solution.eigenvectors)
    np.testing.assert_allclose(x.T @ B @ x, np.eye(9), atol=1e-9)
    assert float(solution.residuals.max()) < 1e-12
    assert solution.result == eigen.RESULTS.successful


@pytest.mark.slow
def test_solvers_agree_on_a_mesh():
    mesh = shapes.ellipsoid(6)
    lengths = g.edge_lengths(mesh.vertices, mesh.topology)
    problem = Regge().eigenproblem(lengths, mesh.topology)
    values = {name: np.asarray(eigsolve(problem, 8, solver).eigenvalues) for name, solver in SOLVERS.items()}
    for name in ("superlu", "cholmod"):
        np.testing.assert_allclose(values[name], values["dense"], rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("solver", SOLVERS)
def test_inside_jit_and_vmap(solver):
    A, B = matrices()

    @jax.jit
    def lowest(scale):
        return eigsolve(problem_of(A, B * scale), 3, SOLVERS[solver]).eigenvalues

    scales = jnp.asarray([1.0, 2.0])
    expected = SPECTRUM[:3] / np.asarray(scales)[:, None]
    np.testing.assert_allclose(jax.vmap(lowest)(scales), expected, atol=1e-9)


def test_a_lucky_guess_is_used():
    A, B = matrices(spectrum=np.linspace(1, 40, 60))
    problem = problem_of(A, B)
    first = eigsolve(problem, 2, ScipyEigsh())
    again = eigsolve(problem, 2, ScipyEigsh(), guess=first.eigenvectors)
    np.testing.assert_allclose(again.eigenvalues, first.eigenvalues, rtol=1e-10)


@pytest.mark.parametrize("solver", ["superlu", "cholmod"])
def test_the_shift_moves_below_a_negative_spectrum(solver):
    """An eigenvalue far below zero is found, not skipped for one nearer to the first shift."""
    A, B = matrices(spectrum=np.concatenate([[-3000.0, -20.0], np.linspace(0, 50, 58)]))
    solution = eigsolve(problem_of(A, B), 3, SOLVERS[solver])
    np.testing.assert_allclose(solution.eigenvalues, [-3000, -20, 0], atol=1e-6)
    assert int(solution.stats["factorizations"]) > 1


@pytest.mark.parametrize("solver", SOLVERS)
def test_failures_are_reported_and_raised(solver):
    A, B = matrices()
    for problem, result, message in (
        (problem_of(A, -B), eigen.RESULTS.indefinite_mass, "not positive definite"),
        (problem_of(A * np.nan, B), eigen.RESULTS.nonfinite_input, "NaN or infinity"),
    ):
        assert eigsolve(problem, 2, SOLVERS[solver], throw=False).result == result
        with pytest.raises(Exception, match=message):
            eigsolve(problem, 2, SOLVERS[solver])


def test_running_out_of_steps_is_reported():
    solver = ScipyEigsh(max_steps=1, rtol=1e-15)
    rng = np.random.default_rng(0)
    A, B = matrices(spectrum=np.sort(rng.random(400)))
    solution = eigsolve(problem_of(A, B), 15, solver, throw=False)
    assert solution.result == eigen.RESULTS.max_steps_reached
    with pytest.raises(Exception, match="Raise `max_steps`"):
        eigsolve(problem_of(A, B), 15, solver)


def test_problems_must_declare_their_structure():
    plain = lx.MatrixLinearOperator(jnp.eye(3))
    symmetric = lx.MatrixLinearOperator(jnp.eye(3), lx.symmetric_tag)
    positive = lx.MatrixLinearOperator(jnp.eye(4), lx.positive_semidefinite_tag)
    with pytest.raises(ValueError, match="A must be symmetric"):
        GeneralizedEigenproblem(plain, positive)
    with pytest.raises(ValueError, match="B must be positive definite"):
        GeneralizedEigenproblem(symmetric, symmetric)
    with pytest.raises(ValueError, match=r"A acts on .*\(3,\).* but B on .*\(4,\)"):
        GeneralizedEigenproblem(symmetric, positive)


def test_k_and_guess_are_checked():
    problem = problem_of(*matrices())
    for k in (0, -1, 61, True):
        with pytest.raises(ValueError, match=r"k must be an integer between 1 and the number of unknowns 60"):
            eigsolve(problem, k)
    with pytest.raises(ValueError, match=r"guess must have shape \[60, any\], got \[59, 2\]"):
        eigsolve(problem, 2, guess=jnp.zeros((59, 2)))
    for k in (59, 60):  # where Lanczos has no room
        np.testing.assert_allclose(eigsolve(problem, k, ScipyEigsh()).eigenvalues, SPECTRUM[:k], atol=1e-9)
    assert eigsolve(problem, 60).eigenvalues.shape == (60,)


def test_clusters_are_told_by_their_gaps():
    values = jnp.asarray([1e-9, 2e-9, 4.0, 4.01, 4.02, 8.0])
    assert eigen.cluster_labels(values, atol=1e-6).tolist() == [0, 0, 1, 1, 1, 2]
    assert eigen.cluster_labels(values, rtol=1e-3, atol=1e-6).tolist() == [0, 0, 1, 2, 3, 4]
    sums = eigen.cluster_sums(values, eigen.cluster_labels(values, atol=1e-6))
    np.testing.assert_allclose(sums[2:5], 12.03)


def test_block_operator_matches_its_matrix():
    rng = np.random.default_rng(0)
    edges = np.array([[0, 1], [0, 3], [2, 3], [1, 2]])
    diagonal = rng.standard_normal((4, 2, 2))
    diagonal = diagonal + diagonal.transpose(0, 2, 1)
    upper = rng.standard_normal((4, 2, 2))
    operator = SymmetricBlockOperator(
        jnp.asarray(diagonal), jnp.asarray(upper), Graph.of_edges(jnp.asarray(edges), 4)
    )
    expected = np.zeros((8, 8))
    for i in range(4):
        expected[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = diagonal[i]
    for (i, j), block in zip(edges, upper, strict=True):
        expected[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = block
        expected[2 * j : 2 * j + 2, 2 * i : 2 * i + 2] = block.T
    np.testing.assert_allclose(operator.as_matrix(), expected, atol=1e-15)
    np.testing.assert_allclose(to_scipy(operator).toarray(), expected, atol=1e-15)
    assert isinstance(to_scipy(operator), sp.csr_array)


def test_an_operator_without_sparse_form_says_so():
    operator = lx.FunctionLinearOperator(lambda x: x, jax.ShapeDtypeStruct((3,), jnp.float64))
    with pytest.raises(TypeError, match="materialise"):
        to_scipy(operator)
