"""Two solvers in a row: a fast one, and one for where it fails."""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jax.custom_batching import sequential_vmap
from jaxtyping import Array, Bool, Float, PyTree

from ._problem import GeneralizedEigenproblem
from ._solution import RESULTS, EigenSolution
from ._solver import AbstractEigensolver

_Tree = TypeVar("_Tree")


class _State(eqx.Module):
    """Of the solver that solved alone, where that is known; of both inside `jit`."""

    first: PyTree
    second: PyTree
    fell_back: bool | Bool[Array, ""]


class WithFallback(AbstractEigensolver):
    """Solves by `first`; where that does not converge, and only there, by `second`. Runs under `jit` and `vmap`.

    Under `vmap` the samples that fail are solved again one after another. `stats` are those of `first`, with `fell_back`
    telling whether `second` had to step in.
    """

    first: AbstractEigensolver
    second: AbstractEigensolver

    def __check_init__(self) -> None:
        if (self.first.constraints is None) != (self.second.constraints is None):
            raise ValueError("the two solvers of WithFallback must have the same constraints")

    @property
    def constraints(self) -> Float[Array, "n c"] | None:
        """Those of both."""
        return self.first.constraints

    def compute(
        self, problem: GeneralizedEigenproblem, k: int, guess: Float[Array, "n g"] | None
    ) -> tuple[EigenSolution, _State]:
        solution, state = self.first.compute(problem, k, guess)
        result = solution.result
        # No other solver mends what is wrong with the problem itself.
        hopeless = (RESULTS.nonfinite_input, RESULTS.indefinite_mass, RESULTS.negative_energy)
        fell_back = result != RESULTS.successful
        for failure in hopeless:
            fell_back &= result != failure

        def again(of: PyTree) -> tuple[PyTree, PyTree]:
            second, state = self.second.compute(*of[0])
            return _pairs(second), state

        def keep(of: PyTree) -> tuple[PyTree, PyTree]:
            shapes = eqx.filter_eval_shape(again, of)
            return of[1], jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes[1])

        known = ((problem, k, guess), _pairs(solution))
        if not isinstance(fell_back, Tracer):
            pairs, second = again(known) if fell_back else (known[1], None)
            found = _State(None if fell_back else state, second, bool(fell_back))
        else:
            pairs, second = _one_of(fell_back, again, keep, known)
            found = _State(state, second, fell_back)
        return EigenSolution(*pairs, stats=solution.stats | {"fell_back": jnp.asarray(fell_back)}), found

    def deflated_solve(
        self,
        state: _State,
        problem: GeneralizedEigenproblem,
        X: Float[Array, "n m"],
        values: Float[Array, " k"],
        right: Float[Array, "n k"],
    ) -> Float[Array, "n k"]:
        def by_first(of: PyTree) -> Float[Array, "n k"]:
            return self.first.deflated_solve(of[0].first, *of[1:])

        def by_second(of: PyTree) -> Float[Array, "n k"]:
            return self.second.deflated_solve(of[0].second, *of[1:])

        known = (state, problem, X, values, right)
        if isinstance(state.fell_back, bool):
            return (by_second if state.fell_back else by_first)(known)
        return _one_of(state.fell_back, by_second, by_first, known)


def _pairs(solution: EigenSolution) -> PyTree:
    return solution.eigenvalues, solution.eigenvectors, solution.residuals, solution.result


def _one_of(
    test: Bool[Array, ""], yes: Callable[[PyTree], _Tree], no: Callable[[PyTree], _Tree], of: PyTree
) -> _Tree:
    """`yes(of)` or `no(of)`, and never both: under `vmap` one sample after another.

    All arrays are handed over, none closed over: a branch that works on the host would otherwise do so while it is traced.
    """
    arrays, structure = eqx.partition(of, eqx.is_array)

    @sequential_vmap
    def chosen(test: Array, arrays: PyTree) -> PyTree:
        return jax.lax.cond(
            test,
            lambda arrays: yes(eqx.combine(arrays, structure)),
            lambda arrays: no(eqx.combine(arrays, structure)),
            arrays,
        )

    return chosen(test, arrays)
