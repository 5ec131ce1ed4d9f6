"""Fast products with sparse matrices, their diagonals, and the preconditioners made of nothing but these."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest

from jaxkvf import geometry as g
from jaxkvf import shapes
from jaxkvf.eigen import LOBPCG, GeneralizedEigenproblem, eigsolve
from jaxkvf.killing import Dec
from jaxkvf.preconditioning import BlockJacobi, Chebyshev
from jaxkvf.sparse import (
    Graph,
    RowProduct,
    SymmetricBlockOperator,
    block_product,
    cheap_diagonal,
    matmat,
    to_scipy,
)


def block_matrix(edges, n, b, seed=0):
    rng = np.random.default_rng(seed)
    diagonal = rng.standard_normal((n, b, b))
    return SymmetricBlockOperator(
        jnp.asarray(diagonal + diagonal.transpose(0, 2, 1)),
        jnp.asarray(rng.standard_normal((len(edges), b, b))),
        Graph.of_edges(jnp.asarray(edges, dtype=jnp.int32).reshape(-1, 2), n),
    )


GRAPHS = {
    "a mesh": (np.asarray(shapes.icosphere(3).topology.edges), 92),
    "a star, whose centre overflows": (
        np.stack([np.full(3000, 7), np.delete(np.arange(3001), 7)], axis=1),
        3001,
    ),
    "no edges": (np.zeros((0, 2), np.int32), 5),
    "one edge": (np.array([[2, 0]]), 4),
    "loops and repeated edges": (np.array([[0, 0], [1, 2], [2, 1], [1, 2], [3, 3]]), 4),
}


@pytest.mark.parametrize(("name", "b"), [("a mesh", 1), ("a mesh", 3), *((name, 2) for name in GRAPHS)])
def test_fast_products(name, b):
    edges, n = GRAPHS[name]
    operator = block_matrix(edges, n, b)
    x = jnp.asarray(np.random.default_rng(1).standard_normal((n * b, 4)))

    @jax.jit
    def products(operator, x):
        fast = block_product(operator)
        assert isinstance(fast, RowProduct) or len(edges) == 0
        return fast(x), matmat(operator, x)

    for product in products(operator, x):
        np.testing.assert_allclose(product, to_scipy(operator) @ np.asarray(x), atol=1e-11)


def test_products_of_composed_operators():
    mesh = shapes.icosphere(2)
    problem = Dec().eigenproblem(g.edge_lengths(mesh.vertices, mesh.topology), mesh.topology)
    x = jnp.asarray(np.random.default_rng(1).standard_normal((problem.size, 3)))
    products = jax.jit(lambda p, x: [block_product(M)(x) for M in (p.A, p.B)])(problem, x)
    for operator, product in zip((problem.A, problem.B), products, strict=True):
        np.testing.assert_allclose(product, to_scipy(operator) @ np.asarray(x), atol=1e-10)
        np.testing.assert_allclose(cheap_diagonal(operator), to_scipy(operator).diagonal(), rtol=1e-12)


# Preconditioners


@eqx.filter_jit
def as_matrix(preconditioner, problem):
    return preconditioner.prepare(problem).apply(jnp.eye(problem.size))


@pytest.mark.parametrize("preconditioner", [BlockJacobi(), Chebyshev(9)], ids=["jacobi", "chebyshev"])
@pytest.mark.parametrize("definite", [True, False])
def test_cheap_preconditioners_are_positive_definite(preconditioner, definite):
    edges, n = GRAPHS["a mesh"]
    operator = block_matrix(edges, n, 2)
    if definite:
        operator = dataclasses.replace(operator, diagonal=operator.diagonal + 20 * jnp.eye(2)[None])
    problem = GeneralizedEigenproblem(operator, lx.IdentityLinearOperator(operator.in_structure()))
    T = np.asarray(as_matrix(preconditioner, problem))
    np.testing.assert_allclose(T, T.T, atol=1e-10 * np.abs(T).max())
    assert np.linalg.eigvalsh(0.5 * (T + T.T)).min() > 0
    if definite:
        spread = np.linalg.eigvals(T @ to_scipy(operator).toarray()).real
        assert spread.max() / spread.min() < {BlockJacobi: 9, Chebyshev: 2.2}[type(preconditioner)]


def test_preconditioners_need_the_diagonal():
    numbers = jax.ShapeDtypeStruct((9,), jnp.float64)
    hidden = lx.FunctionLinearOperator(lambda x: 2 * x, numbers, lx.positive_semidefinite_tag)
    problem = GeneralizedEigenproblem(hidden, lx.IdentityLinearOperator(numbers))
    with pytest.raises(
        ValueError, match="need the diagonal of A, which FunctionLinearOperator does not tell"
    ):
        eigsolve(problem, 2, LOBPCG(preconditioner=BlockJacobi()))


def test_diagonals_of_sums_and_multiples():
    edges, n = GRAPHS["a mesh"]
    operator = block_matrix(edges, n, 2)
    diagonal = lx.DiagonalLinearOperator(jnp.linspace(30, 40, 2 * n))
    A = lx.TaggedLinearOperator(2.0 * operator + diagonal, lx.symmetric_tag)
    problem = GeneralizedEigenproblem(A, lx.IdentityLinearOperator(A.in_structure()))
    T = as_matrix(BlockJacobi(), problem)
    np.testing.assert_allclose(T, np.diag(1 / np.abs(to_scipy(A).diagonal())), rtol=1e-12)
