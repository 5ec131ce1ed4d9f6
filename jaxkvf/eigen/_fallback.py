"""Two solvers in a row: a fast one, and one for where it fails."""

import jax
from jaxtyping import Array, Float

from ._problem import GeneralizedEigenproblem
from ._solution import RESULTS, EigenSolution
from ._solver import AbstractEigensolver


class WithFallback(AbstractEigensolver):
    """Solves by `first`; where that does not converge, by `second`. Runs under `jit`.

    `stats` are those of `first`, with `fell_back` telling whether `second` had to step in.
    """

    first: AbstractEigensolver
    second: AbstractEigensolver

    def compute(
        self, problem: GeneralizedEigenproblem, k: int, guess: Float[Array, "n g"] | None
    ) -> EigenSolution:
        solution = self.first.compute(problem, k, guess)
        # No other solver mends what is wrong with the problem itself.
        hopeless = (solution.result == RESULTS.nonfinite_input) | (solution.result == RESULTS.indefinite_mass)
        done = (solution.result == RESULTS.successful) | hopeless

        def keep() -> tuple[Array, Array, Array, RESULTS]:
            return _pairs(solution)

        def again() -> tuple[Array, Array, Array, RESULTS]:
            return _pairs(self.second.compute(problem, k, guess))

        pairs = jax.lax.cond(done, keep, again)
        return EigenSolution(*pairs, stats=solution.stats | {"fell_back": ~done})


def _pairs(solution: EigenSolution) -> tuple[Array, Array, Array, RESULTS]:
    return solution.eigenvalues, solution.eigenvectors, solution.residuals, solution.result
