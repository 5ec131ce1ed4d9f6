"""The generalized symmetric eigenproblem: what a discretization makes and a solver eats."""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import DTypeLike


class GeneralizedEigenproblem(eqx.Module):
    """A x = λ B x with A symmetric and B symmetric positive definite, real.

    Any lineax operators on vectors `[n]` will do, tagged as what they are: `lx.MatrixLinearOperator(A,
    lx.symmetric_tag)`, the sparse ones of `jaxkvf.sparse`, or your own. Derivatives of eigenvalues flow into the
    operators' arrays.
    """

    A: lx.AbstractLinearOperator
    """Symmetric."""
    B: lx.AbstractLinearOperator
    """Symmetric, tagged positive semi-definite (positive definite in fact, or the problem has infinite eigenvalues)."""

    def __check_init__(self) -> None:
        for name, operator in (("A", self.A), ("B", self.B)):
            if not lx.is_symmetric(operator):
                raise ValueError(f"{name} must be symmetric: tag it with `lineax.symmetric_tag`")
            if len(getattr(operator.in_structure(), "shape", ())) != 1:
                raise ValueError(f"{name} must act on vectors of shape [n], got {operator.in_structure()}")
        if not lx.is_positive_semidefinite(self.B):
            raise ValueError("B must be positive definite: tag it with `lineax.positive_semidefinite_tag`")
        if self.A.in_structure() != self.B.in_structure():
            raise ValueError(f"A acts on {self.A.in_structure()} but B on {self.B.in_structure()}")
        if self.dtype not in (jnp.float32, jnp.float64):
            raise ValueError(f"A and B must be of float32 or float64, got {self.dtype}")

    @property
    def size(self) -> int:
        """Number of unknowns n."""
        return self.A.in_size()

    @property
    def dtype(self) -> DTypeLike:
        structure = self.A.in_structure()
        assert isinstance(structure, jax.ShapeDtypeStruct)  # vectors: checked at construction
        return structure.dtype
