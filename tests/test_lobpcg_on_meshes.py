"""LOBPCG on the Killing operator of spheres: no eigenvalue missed, clusters to rounding."""

import equinox as eqx
import jax
import numpy as np
import pytest
import scipy.linalg

from jaxkvf import geometry as g
from jaxkvf import shapes
from jaxkvf.eigen import LOBPCG, GeneralizedEigenproblem, ScipyEigsh, eigsolve
from jaxkvf.killing import Regge
from jaxkvf.preconditioning import Chebyshev
from jaxkvf.sparse import assembled, to_scipy


@eqx.filter_jit
def killing_problem(mesh):
    problem = Regge().eigenproblem(g.edge_lengths(mesh.vertices, mesh.topology), mesh.topology)
    return GeneralizedEigenproblem(assembled(problem.A), assembled(problem.B))


@pytest.mark.slow
def test_clusters_of_the_sphere():
    """Of 3, 3, 5 and 12, down to rounding."""
    problem = killing_problem(shapes.icosphere(6))
    exact = eigsolve(problem, 23, ScipyEigsh(rtol=0.0))
    found = eigsolve(problem, 23, LOBPCG(rtol=0.0, preconditioner=Chebyshev()))
    scale = float(exact.eigenvalues[22])
    np.testing.assert_allclose(found.eigenvalues, exact.eigenvalues, rtol=1e-9, atol=1e-12 * scale)
    B = to_scipy(problem.B).toarray()
    for start, stop in ((0, 3), (3, 6), (6, 11), (11, 23)):
        x, y = (solution.eigenvectors[:, start:stop] for solution in (exact, found))
        x, y = np.asarray(x), np.asarray(y)
        assert (
            np.linalg.norm(y - x @ (x.T @ (B @ y)), 2) < 1e-10
        )  # the sine of the largest angle between them
    for solution in (exact, found):
        assert float(solution.residuals.max()) < 4e-15


@pytest.mark.slow
def test_no_eigenvalue_is_missed_and_a_warm_start_pays():
    """The inertia of A − sB counts the eigenvalues below s (Sylvester), here between any two neighbours found."""
    mesh = shapes.random_sphere(500, seed=3)
    problem = killing_problem(mesh)
    solver = LOBPCG(preconditioner=Chebyshev())
    nowhere = jax.random.normal(jax.random.key(1), (problem.size, 6))
    solution = eigsolve(problem, 6, solver, guess=nowhere)
    A, B = (to_scipy(operator).toarray() for operator in (problem.A, problem.B))
    values = np.asarray(solution.eigenvalues)
    for count in range(1, 6):
        _, D, _ = scipy.linalg.ldl(A - 0.5 * (values[count - 1] + values[count]) * B)
        assert (np.linalg.eigvalsh(D) < 0).sum() == count

    moved = killing_problem(shapes.add_normal_noise(mesh, 0.001, seed=0))
    cold = eigsolve(moved, 6, solver, guess=nowhere)
    warm = eigsolve(moved, 6, solver, guess=solution.eigenvectors)
    np.testing.assert_allclose(warm.eigenvalues, cold.eigenvalues, atol=1e-8)
    assert int(warm.stats["steps"]) <= 0.6 * int(cold.stats["steps"])
