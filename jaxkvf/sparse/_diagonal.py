"""Diagonals of operators that are not formed."""

import functools

import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float

from ._operators import RowSparseOperator, SymmetricBlockOperator, TransposedRowSparseOperator, assembled


def known_diagonal_blocks(operator: lx.AbstractLinearOperator) -> Float[Array, "n b b"]:
    """The diagonal blocks; of 1 × 1 where the operator has no blocks.

    Raises:
        ValueError: the diagonal is not to be had without forming the matrix.
    """
    blocks = _diagonal_blocks(assembled(operator))
    if blocks is None:
        raise ValueError(
            f"Jacobi preconditioners need the diagonal of A, which {type(operator).__name__} does not tell: "
            "use `SymmetricBlockOperator`, or `lineax.materialise` it"
        )
    return blocks


def cheap_diagonal(operator: lx.AbstractLinearOperator) -> Float[Array, " n"] | None:
    """The diagonal, where it is to be had without forming the matrix."""
    blocks = _diagonal_blocks(operator)
    return None if blocks is None else blocks.diagonal(axis1=1, axis2=2).ravel()


@functools.singledispatch
def _diagonal_blocks(operator: lx.AbstractLinearOperator) -> Float[Array, "n b b"] | None:
    return None


@_diagonal_blocks.register
def _(operator: SymmetricBlockOperator) -> Float[Array, "n b b"]:
    return operator.diagonal


@_diagonal_blocks.register(lx.DiagonalLinearOperator)
@_diagonal_blocks.register(lx.MatrixLinearOperator)
@_diagonal_blocks.register(lx.IdentityLinearOperator)
def _(operator: lx.AbstractLinearOperator) -> Float[Array, "n 1 1"]:
    return lx.diagonal(operator)[:, None, None]


@_diagonal_blocks.register
def _(operator: lx.TaggedLinearOperator) -> Float[Array, "n b b"] | None:
    return _diagonal_blocks(operator.operator)


@_diagonal_blocks.register
def _(operator: lx.MulLinearOperator) -> Float[Array, "n b b"] | None:
    blocks = _diagonal_blocks(operator.operator)
    return None if blocks is None else blocks * operator.scalar


@_diagonal_blocks.register
def _(operator: lx.AddLinearOperator) -> Float[Array, "n b b"] | None:
    blocks, others = (_diagonal_blocks(term) for term in (operator.operator1, operator.operator2))
    if blocks is None or others is None:
        return None
    if blocks.shape != others.shape:
        blocks, others = (part.diagonal(axis1=1, axis2=2).reshape(-1, 1, 1) for part in (blocks, others))
    return blocks + others


@_diagonal_blocks.register
def _(operator: lx.NegLinearOperator) -> Float[Array, "n b b"] | None:
    blocks = _diagonal_blocks(operator.operator)
    return None if blocks is None else -blocks


@_diagonal_blocks.register
def _(operator: lx.ComposedLinearOperator) -> Float[Array, "n 1 1"] | None:
    """Of L D Mᵀ or Lᵀ D M, with `RowSparseOperator`s L and M, between diagonal operators."""
    scale, middle, sparse = jnp.ones((), operator.in_structure().dtype), 1.0, []
    for factor in _factors(operator):
        if isinstance(factor, RowSparseOperator | TransposedRowSparseOperator):
            sparse.append(factor)
        elif isinstance(factor, lx.DiagonalLinearOperator):
            if len(sparse) == 1:
                middle = middle * factor.diagonal
            else:
                scale = scale * factor.diagonal
        else:
            return None
    match sparse:
        case []:
            diagonal = scale
        case [RowSparseOperator() as L, TransposedRowSparseOperator(of=M)]:
            weight = jnp.broadcast_to(middle, L.n_columns)[L.columns]
            diagonal = scale * (_matches(L, M) * weight).sum(axis=1)
        case [TransposedRowSparseOperator(of=L), RowSparseOperator() as M]:
            terms = _matches(L, M) * jnp.broadcast_to(middle, len(L.columns))[:, None]
            diagonal = scale * jnp.zeros(L.n_columns, terms.dtype).at[L.columns].add(terms)
        case _:
            return None
    return diagonal[:, None, None]


def _matches(L: RowSparseOperator, M: RowSparseOperator) -> Float[Array, "m width"]:
    """Each entry of L times what M has in the same place."""
    same = L.columns[:, :, None] == M.columns[:, None, :]
    return L.values * jnp.where(same, M.values[:, None, :], 0).sum(axis=2)


def _factors(operator: lx.AbstractLinearOperator) -> list[lx.AbstractLinearOperator]:
    match operator:
        case lx.ComposedLinearOperator():
            return _factors(operator.operator1) + _factors(operator.operator2)
        case lx.TaggedLinearOperator():
            return _factors(operator.operator)
        case _:
            return [operator]
