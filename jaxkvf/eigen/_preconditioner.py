"""The interface between LOBPCG and what makes it fast."""

import abc

import equinox as eqx
from jaxtyping import Array, Float

from ._problem import GeneralizedEigenproblem


class AbstractApproximateInverse(eqx.Module):
    """A symmetric positive definite map close to (A + sB)⁻¹ for a small shift s ≥ 0, ready to be applied."""

    @abc.abstractmethod
    def apply(self, block: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """The map applied to each column."""

    @abc.abstractmethod
    def starting_vectors(self, count: int) -> Float[Array, "n count"] | None:
        """Approximations of the lowest eigenvectors, where the map has a cheap way to them, or None."""


class AbstractPreconditioner(eqx.Module):
    """A recipe for an approximate inverse: what depends on the structure is in it, what depends on numbers is computed."""

    @abc.abstractmethod
    def prepare(self, problem: GeneralizedEigenproblem) -> AbstractApproximateInverse:
        """The approximate inverse for this problem; pure JAX, so it runs inside `jit`."""


class KeptInverse(AbstractPreconditioner):
    """An approximate inverse made once, for problems that change little: saves the preparation."""

    inverse: AbstractApproximateInverse

    def prepare(self, problem: GeneralizedEigenproblem) -> AbstractApproximateInverse:
        del problem
        return self.inverse
