"""The interface every eigensolver implements."""

import abc

import equinox as eqx
from jaxtyping import Array, Float, PyTree

from ._conjugate_gradients import conjugate_gradients
from ._problem import GeneralizedEigenproblem
from ._solution import EigenSolution


class AbstractEigensolver(eqx.Module):
    """A method for the k smallest eigenpairs, with its settings. Solvers are values: pass them, compare them, reuse them.

    To write one, inherit from `AbstractStatelessEigensolver`, whose derivatives need nothing more than `compute`; or from
    this class, where what `compute` prepares (a factorization, a preconditioner) shall serve the derivatives too.
    """

    @property
    @abc.abstractmethod
    def constraints(self) -> Float[Array, "n c"] | None:
        """Columns that all eigenvectors are B-orthogonal to; None for none. Constant to derivatives."""

    @abc.abstractmethod
    def compute(
        self, problem: GeneralizedEigenproblem, k: int, guess: Float[Array, "n g"] | None
    ) -> tuple[EigenSolution, PyTree]:
        """Solves; never raises for failure at run time but reports it in `result`. Call through `eigsolve`.

        Args:
            problem: the eigenproblem, possibly traced.
            k: number of pairs, 1 ≤ k ≤ n less the constraints, already checked.
            guess: approximate eigenvectors in its columns, any number of them, or None.

        Returns:
            The solution; and the state, arrays that `deflated_solve` wants: what was prepared for this problem.
        """

    @abc.abstractmethod
    def deflated_solve(
        self,
        state: PyTree,
        problem: GeneralizedEigenproblem,
        X: Float[Array, "n m"],
        values: Float[Array, " k"],
        right: Float[Array, "n k"],
    ) -> Float[Array, "n k"]:
        """Z with Pᵀ(A P zᵢ − λᵢB P zᵢ) + BX XᵀB zᵢ = fᵢ, P = 1 − X XᵀB: the linear solve in derivatives of eigenvectors.

        To a residual of 1e-6 or, in float32, 10 √ε; the caller checks. The constraints are among the columns of X.

        Args:
            state: what `compute` returned for this problem.
            problem: A and B.
            X: eigenvectors to stay away from, B-orthonormal; columns of zeros do nothing.
            values: λᵢ, none beyond the eigenvalues of X by more than a cluster's width.
            right: fᵢ.
        """


class AbstractStatelessEigensolver(AbstractEigensolver):
    """An eigensolver that keeps nothing for derivatives, which solve by conjugate gradients; write `compute` alone.

    `compute` returns its solution and None.
    """

    @property
    def constraints(self) -> None:
        """None: only the solvers that take them have constraints."""

    def deflated_solve(
        self,
        state: PyTree,
        problem: GeneralizedEigenproblem,
        X: Float[Array, "n m"],
        values: Float[Array, " k"],
        right: Float[Array, "n k"],
    ) -> Float[Array, "n k"]:
        del state
        return conjugate_gradients(problem, X, values, right)
