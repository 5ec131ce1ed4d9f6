"""Sparse linear operators for lineax: written once as a formula, used as products in JAX and as SciPy matrices.

lineax gives sums, products, scalings and transposes of operators, and declared structure (symmetric, positive
semi-definite). Here are the sparse leaves that meshes need, and products with a block of vectors.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float, Int

from ._blocks import gathered_or_zero
from ._graph import Graph


class RowSparseOperator(lx.AbstractLinearOperator):
    """A rectangular matrix with the same number of entries in every row: (M x)_r = Σ_s values[r, s] x[columns[r, s]]."""

    columns: Int[Array, "m width"]
    values: Float[Array, "m width"]
    n_columns: int = eqx.field(static=True)

    def mv(self, vector: Float[Array, " n"]) -> Float[Array, " m"]:
        return (self.values * vector[self.columns]).sum(axis=1)

    def as_matrix(self) -> Float[Array, "m n"]:
        rows = jnp.arange(self.columns.shape[0])[:, None]
        empty = jnp.zeros((self.columns.shape[0], self.n_columns), self.values.dtype)
        return empty.at[rows, self.columns].add(self.values)

    def transpose(self) -> "TransposedRowSparseOperator":
        return TransposedRowSparseOperator(self)

    def in_structure(self) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct((self.n_columns,), self.values.dtype)

    def out_structure(self) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(self.columns.shape[:1], self.values.dtype)


class TransposedRowSparseOperator(lx.AbstractLinearOperator):
    """The transpose of a `RowSparseOperator`: a gather becomes a scatter."""

    of: RowSparseOperator

    def mv(self, vector: Float[Array, " m"]) -> Float[Array, " n"]:
        spread = self.of.values * vector[:, None]
        return jax.ops.segment_sum(spread.ravel(), self.of.columns.ravel(), num_segments=self.of.n_columns)

    def as_matrix(self) -> Float[Array, "n m"]:
        return self.of.as_matrix().T

    def transpose(self) -> RowSparseOperator:
        return self.of

    def in_structure(self) -> jax.ShapeDtypeStruct:
        return self.of.out_structure()

    def out_structure(self) -> jax.ShapeDtypeStruct:
        return self.of.in_structure()


class SymmetricBlockOperator(lx.AbstractLinearOperator):
    """A symmetric positive semi-definite matrix of b × b blocks on the edges of a graph.

    Row block i has `diagonal[i]` and, for each edge (i, j), `upper[e]` at column j; row j has its transpose at column i.
    Unknown c of node i is number b i + c.
    """

    diagonal: Float[Array, "n b b"]
    """Symmetric blocks."""
    upper: Float[Array, "m b b"]
    graph: Graph

    @property
    def edges(self) -> Int[Array, "m 2"]:
        return self.graph.edges

    def blocks(self, numbers: Int[Array, "*shape"]) -> Float[Array, "*shape b b"]:
        """By number: the n diagonal ones, the m upper ones, the m transposed upper ones; zero for numbers out of bounds."""
        n, m = len(self.diagonal), len(self.upper)
        lower = numbers >= n + m
        edge = jnp.where(numbers < n, m, numbers - n - jnp.where(lower, m, 0))
        beside = gathered_or_zero(self.upper, edge)
        beside = jnp.where(lower[..., None, None], beside.mT, beside)
        return gathered_or_zero(self.diagonal, numbers) + beside

    @property
    def block_size(self) -> int:
        return self.diagonal.shape[1]

    def mv(self, vector: Float[Array, " nb"]) -> Float[Array, " nb"]:
        return matmat(self, vector[:, None])[:, 0]

    def as_matrix(self) -> Float[Array, "nb nb"]:
        return matmat(self, jnp.eye(self.in_size(), dtype=self.diagonal.dtype))

    def transpose(self) -> "SymmetricBlockOperator":
        return self

    def in_structure(self) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct((self.diagonal.shape[0] * self.block_size,), self.diagonal.dtype)

    def out_structure(self) -> jax.ShapeDtypeStruct:
        return self.in_structure()


def declare_leaf(kind: type[lx.AbstractLinearOperator], *, positive_semidefinite: bool) -> None:
    """Tells lineax about a new kind of operator: symmetric positive semi-definite, or without structure."""
    for declared in (lx.is_symmetric, lx.is_positive_semidefinite):
        declared.register(kind)(lambda operator: positive_semidefinite)
    for undeclared in (
        lx.is_diagonal,
        lx.is_tridiagonal,
        lx.is_lower_triangular,
        lx.is_upper_triangular,
        lx.is_negative_semidefinite,
        lx.has_unit_diagonal,
    ):
        undeclared.register(kind)(lambda operator: False)
    lx.linearise.register(kind)(lambda operator: operator)
    lx.conj.register(kind)(lambda operator: operator)
    lx.materialise.register(kind)(lambda operator: lx.MatrixLinearOperator(operator.as_matrix()))


declare_leaf(RowSparseOperator, positive_semidefinite=False)
declare_leaf(TransposedRowSparseOperator, positive_semidefinite=False)
declare_leaf(SymmetricBlockOperator, positive_semidefinite=True)


@functools.singledispatch
def assembled(operator: lx.AbstractLinearOperator) -> lx.AbstractLinearOperator:
    """The operator as one sparse matrix, where it has such a form beside its factors; what solvers work with."""
    return operator


@functools.singledispatch
def matmat(operator: lx.AbstractLinearOperator, block: Float[Array, "n k"]) -> Float[Array, "m k"]:
    """The operator applied to each column of `block`; unknowns first, so that a gather fetches whole rows."""
    return jax.vmap(operator.mv, in_axes=1, out_axes=1)(block)


@matmat.register
def _(operator: lx.TaggedLinearOperator, block: Float[Array, "n k"]) -> Float[Array, "m k"]:
    return matmat(operator.operator, block)


@matmat.register
def _(operator: lx.MulLinearOperator, block: Float[Array, "n k"]) -> Float[Array, "m k"]:
    return matmat(operator.operator, block) * operator.scalar


@matmat.register
def _(operator: lx.AddLinearOperator, block: Float[Array, "n k"]) -> Float[Array, "m k"]:
    return matmat(operator.operator1, block) + matmat(operator.operator2, block)


@matmat.register
def _(operator: lx.ComposedLinearOperator, block: Float[Array, "n k"]) -> Float[Array, "m k"]:
    return matmat(operator.operator1, matmat(operator.operator2, block))


@matmat.register
def _(operator: RowSparseOperator, block: Float[Array, "n k"]) -> Float[Array, "m k"]:
    terms = (
        operator.values[:, s, None] * block[operator.columns[:, s]] for s in range(operator.values.shape[1])
    )
    return functools.reduce(jnp.add, terms)


@matmat.register
def _(operator: TransposedRowSparseOperator, block: Float[Array, "m k"]) -> Float[Array, "n k"]:
    spread = operator.of.values[:, :, None] * block[:, None, :]
    columns = operator.of.columns.ravel()
    return jax.ops.segment_sum(spread.reshape(len(columns), -1), columns, num_segments=operator.of.n_columns)


@matmat.register
def _(operator: lx.DiagonalLinearOperator, block: Float[Array, "n k"]) -> Float[Array, "n k"]:
    return operator.diagonal[:, None] * block


@matmat.register
def _(operator: SymmetricBlockOperator, block: Float[Array, "n k"]) -> Float[Array, "n k"]:
    n, b, _ = operator.diagonal.shape
    x = block.reshape(n, b, -1)
    tail, head = operator.edges.T
    y = operator.diagonal @ x
    y = y + jax.ops.segment_sum(operator.upper @ x[head], tail, num_segments=n)
    y = y + jax.ops.segment_sum(operator.upper.mT @ x[tail], head, num_segments=n)
    return y.reshape(block.shape)
