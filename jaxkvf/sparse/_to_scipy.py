"""Operators as SciPy matrices, on the host."""

import functools

import lineax as lx
import numpy as np
import scipy.sparse as sp

from ._operators import RowSparseOperator, SymmetricBlockOperator, TransposedRowSparseOperator


@functools.singledispatch
def to_scipy(operator: lx.AbstractLinearOperator) -> sp.csr_array:
    """The operator as a SciPy CSR array on the host; its arrays must be concrete (JAX or NumPy).

    Raises:
        TypeError: an operator with no sparse form (materialise it first).
    """
    raise TypeError(
        f"{type(operator).__name__} has no sparse form; pass `lineax.materialise(operator)` to use it as a dense matrix"
    )


@to_scipy.register
def _(operator: RowSparseOperator) -> sp.csr_array:
    columns, values = np.asarray(operator.columns), np.asarray(operator.values)
    rows = np.repeat(np.arange(columns.shape[0]), columns.shape[1])
    return sp.csr_array(
        (values.ravel(), (rows, columns.ravel())), shape=(columns.shape[0], operator.n_columns)
    )


@to_scipy.register
def _(operator: TransposedRowSparseOperator) -> sp.csr_array:
    return sp.csr_array(to_scipy(operator.of).T)


@to_scipy.register
def _(operator: SymmetricBlockOperator) -> sp.csr_array:
    diagonal, upper = np.asarray(operator.diagonal), np.asarray(operator.upper)
    tail, head = np.asarray(operator.edges).T
    n, b, _ = diagonal.shape
    nodes = np.arange(n)
    rows = np.concatenate([nodes, tail, head])
    columns = np.concatenate([nodes, head, tail])
    blocks = np.concatenate([diagonal, upper, upper.transpose(0, 2, 1)])
    order = np.lexsort((columns, rows))
    starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))])
    matrix = sp.bsr_array((blocks[order], columns[order], starts), shape=(n * b, n * b))
    return matrix.tocsr()


@to_scipy.register
def _(operator: lx.MatrixLinearOperator) -> sp.csr_array:
    return sp.csr_array(np.asarray(operator.matrix))


@to_scipy.register
def _(operator: lx.DiagonalLinearOperator) -> sp.csr_array:
    return sp.csr_array(sp.diags_array(np.asarray(operator.diagonal)))


@to_scipy.register
def _(operator: lx.IdentityLinearOperator) -> sp.csr_array:
    return sp.csr_array(sp.eye_array(operator.in_size()))


@to_scipy.register
def _(operator: lx.TaggedLinearOperator) -> sp.csr_array:
    return to_scipy(operator.operator)


@to_scipy.register
def _(operator: lx.ComposedLinearOperator) -> sp.csr_array:
    return sp.csr_array(to_scipy(operator.operator1) @ to_scipy(operator.operator2))


@to_scipy.register
def _(operator: lx.AddLinearOperator) -> sp.csr_array:
    return sp.csr_array(to_scipy(operator.operator1) + to_scipy(operator.operator2))


@to_scipy.register
def _(operator: lx.MulLinearOperator) -> sp.csr_array:
    return sp.csr_array(to_scipy(operator.operator) * float(operator.scalar))


@to_scipy.register
def _(operator: lx.NegLinearOperator) -> sp.csr_array:
    return sp.csr_array(-to_scipy(operator.operator))
