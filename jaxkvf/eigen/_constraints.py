"""Eigenproblems on the B-orthogonal complement of given columns, as eigenproblems without constraints."""

import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float

from ..sparse import declare_leaf, matmat
from ._problem import GeneralizedEigenproblem
from .subspace import orthonormalised


class _RestrictedOperator(lx.AbstractLinearOperator):
    """PᵀA P + μ BY M⁻¹ (BY)ᵀ with M = YᵀBY and P = 1 − Y M⁻¹ (BY)ᵀ.

    With B its eigenpairs are those of A on the complement of Y, and μ in the span of Y.
    """

    problem: GeneralizedEigenproblem
    Y: Float[Array, "n c"]
    level: Float[Array, ""]

    def mv(self, vector: Float[Array, " n"]) -> Float[Array, " n"]:
        return matmat(self, vector[:, None])[:, 0]

    def as_matrix(self) -> Float[Array, "n n"]:
        return matmat(self, jnp.eye(self.in_size(), dtype=self.Y.dtype))

    def transpose(self) -> "_RestrictedOperator":
        return self

    def in_structure(self) -> jax.ShapeDtypeStruct:
        return self.problem.A.in_structure()

    def out_structure(self) -> jax.ShapeDtypeStruct:
        return self.in_structure()


declare_leaf(_RestrictedOperator, positive_semidefinite=False)


@matmat.register
def _(operator: _RestrictedOperator, block: Float[Array, "n k"]) -> Float[Array, "n k"]:
    Y, BY = operator.Y, matmat(operator.problem.B, operator.Y)
    M = Y.T @ BY
    M = M + jnp.diag(jnp.where(M.diagonal() > 0, 0, 1).astype(M.dtype))  # columns of zeros do nothing
    along = jnp.linalg.solve(M, BY.T @ block)
    product = matmat(operator.problem.A, block - Y @ along)
    return product - BY @ jnp.linalg.solve(M, Y.T @ product) + operator.level * (BY @ along)


def basis_of_constraints(
    problem: GeneralizedEigenproblem, constraints: Float[Array, "n c"]
) -> Float[Array, "n c"]:
    """B-orthonormal columns with the same span, those of zeros where it has fewer dimensions."""
    return orthonormalised(lambda block: matmat(problem.B, block), constraints)[0]


def restricted(
    problem: GeneralizedEigenproblem, Y: Float[Array, "n c"], level: Float[Array, ""]
) -> GeneralizedEigenproblem:
    """The problem on the complement of Y; in the span of Y, where it had none, its eigenvalues are `level`."""
    operator = _RestrictedOperator(problem, Y, level)
    return GeneralizedEigenproblem(lx.TaggedLinearOperator(operator, lx.symmetric_tag), problem.B)
