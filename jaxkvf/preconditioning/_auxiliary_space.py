"""Preconditioning one discretization by another: what is smooth is solved in the other, smoothing does the rest.

Reference: J. Xu, The auxiliary space method and optimal multigrid preconditioning techniques (1996).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float

from ..eigen import AbstractApproximateInverse, AbstractPreconditioner, GeneralizedEigenproblem
from ..sparse import BlockProduct, block_product, known_diagonal_blocks
from ._smoothing import Smoother


class AuxiliarySpace(AbstractPreconditioner):
    """A preconditioner for A x = λ B x by way of a related problem that has a good one, as A alike on smooth functions.

    One cycle smooths by Chebyshev polynomials over Jacobi, corrects by the related problem's approximate inverse, carried
    over by F and Fᵀ, and smooths again.
    """

    related: GeneralizedEigenproblem
    """With the same energies and masses for functions that both resolve."""
    transfer: lx.AbstractLinearOperator
    """F, from its unknowns to those of the problem to be solved."""
    preconditioner: AbstractPreconditioner
    """Of the related problem."""
    degree: int = eqx.field(default=3, static=True)
    """Of the smoother: products with A before and after the correction."""

    def prepare(self, problem: GeneralizedEigenproblem) -> AbstractApproximateInverse:
        """The approximate inverse.

        Raises:
            ValueError: the transfer does not lead to this problem's unknowns; the diagonal of A is not to be had without
                forming all of A.
        """
        if self.transfer.out_size() != problem.size:
            raise ValueError(
                f"the transfer leads to {self.transfer.out_size()} unknowns, the problem has {problem.size}"
            )
        diagonal = jnp.abs(known_diagonal_blocks(problem.A).diagonal(axis1=1, axis2=2).ravel())
        scale = jax.lax.rsqrt(jnp.where(diagonal > 0, diagonal, diagonal.max()))
        K = eqx.Partial(_scaled_product, block_product(problem.A), scale)
        return _SmoothedCorrection(
            scale,
            Smoother.prepare(K, problem.size, problem.dtype, self.degree),
            block_product(self.transfer),
            block_product(self.transfer.T),
            self.preconditioner.prepare(self.related),
        )


def _scaled_product(
    A: BlockProduct, scale: Float[Array, " n"], block: Float[Array, "n k"]
) -> Float[Array, "n k"]:
    return scale[:, None] * A(scale[:, None] * block)


class _SmoothedCorrection(AbstractApproximateInverse):
    scale: Float[Array, " n"]
    smoother: Smoother
    """Of A with its diagonal scaled to 1."""
    prolong: BlockProduct
    restrict: BlockProduct
    inverse: AbstractApproximateInverse

    def apply(self, block: Float[Array, "n k"]) -> Float[Array, "n k"]:
        scale = self.scale[:, None]

        def correction(residual: Float[Array, "n k"]) -> Float[Array, "n k"]:
            return self.prolong(self.inverse.apply(self.restrict(residual / scale))) / scale

        return scale * self.smoother.around(scale * block, correction)

    def starting_vectors(self, count: int) -> Float[Array, "n _"] | None:
        start = self.inverse.starting_vectors(count)
        return None if start is None else self.prolong(start.astype(self.scale.dtype))
