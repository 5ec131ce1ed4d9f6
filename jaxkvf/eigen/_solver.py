"""The interface every eigensolver implements."""

import abc

import equinox as eqx
from jaxtyping import Array, Float

from ._problem import GeneralizedEigenproblem
from ._solution import EigenSolution


class AbstractEigensolver(eqx.Module):
    """A method for the k smallest eigenpairs, with its settings. Solvers are values: pass them, compare them, reuse them."""

    @abc.abstractmethod
    def compute(
        self, problem: GeneralizedEigenproblem, k: int, guess: Float[Array, "n g"] | None
    ) -> EigenSolution:
        """Solves; never raises for failure at run time but reports it in `result`. Call through `eigsolve`.

        Args:
            problem: the eigenproblem, possibly traced.
            k: number of pairs, 1 ≤ k ≤ n, already checked.
            guess: approximate eigenvectors in its columns, any number of them, or None.
        """
