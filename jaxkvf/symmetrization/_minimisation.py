"""The loop over the steps of an optimistix minimiser: what is accepted, recorded, and when it ends."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, ArrayLike, Float, PyTree

from ..eigen import LOBPCG, AbstractApproximateInverse, AbstractPreconditioner, KeptInverse
from ..geometry import corner_angles
from ._configuration import Configuration
from ._objective import Accepted, Evaluation, SquaredObjective, SymmetryObjective
from ._outcome import OUTCOMES
from ._state import State, Step
from ._targets import killing_problem

_RESIDUAL = 3e-9  # of the eigensolves: gradients inherit it to first order
_PREPARED_AFTER = {2**i for i in range(2, 30)}  # accepted steps: they become smaller and smaller
_DOUBTFUL = 3  # rejected steps in a row
_REJECTIONS = 30  # in a row: the line search has come to rest

_KEEP_EVALUATION = (optx.AbstractQuasiNewton, optx.AbstractGradientDescent)
"""Minimisers whose state has, as `aux`, what was evaluated at the point they stand at."""


class Minimisation(eqx.Module):
    """A minimiser set to an objective."""

    minimiser: Any
    objective: SymmetryObjective
    """Its own solver is the caller's, or none."""
    multigrid: AbstractPreconditioner | None
    """For an eigensolver made anew on the way."""

    @property
    def is_squared(self) -> bool:
        """Whether the minimiser is given residuals in (unknowns, fields)."""
        return isinstance(self.minimiser, optx.AbstractLeastSquaresSolver)

    @property
    def steps_back(self) -> bool:
        """Whether it tries again, nearer, where it finds an infinite value. Others are led by values everywhere (simplices),
        or never look back (learning rates); of their points those are accepted that are better than the last.
        """
        search = getattr(self.minimiser, "search", None)
        return isinstance(search, optx.AbstractSearch) and not isinstance(search, optx.LearningRate)

    def variables(self, theta: PyTree, fields: Array) -> PyTree:
        """What the minimiser varies: θ, or θ and the target's fields, the first of those given."""
        return (
            (theta, fields[..., : self.objective.target.count()].astype(float)) if self.is_squared else theta
        )

    def start(self, theta: PyTree, evaluation: Evaluation) -> Any:
        """The minimiser's state at the start."""
        y = self.variables(theta, evaluation.fields)
        return _init(self.minimiser, self.minimisable(self.objective), y, evaluation)

    def theta(self, y: PyTree) -> PyTree:
        return y[0] if self.is_squared else y

    def prepared(self, theta: PyTree) -> SymmetryObjective:
        """The objective with a solver for surfaces near that of θ: a preconditioner is too dear to be made at each step."""
        if self.multigrid is None:
            return self.objective
        inverse = _inverse(dataclasses.replace(self.objective, solver=None), self.multigrid, theta)
        precision = float(jnp.finfo(self.objective.original.lengths.dtype).eps)
        # Guesses are near: one guard vector will do.
        solver = LOBPCG(
            rtol=max(_RESIDUAL, 8 * precision),
            max_steps=200,
            guard_vectors=1,
            preconditioner=KeptInverse(inverse),
        )
        return dataclasses.replace(self.objective, solver=solver)

    def minimisable(self, objective: SymmetryObjective) -> SymmetryObjective | SquaredObjective:
        return SquaredObjective(objective) if self.is_squared else objective


def minimised(
    setting: Minimisation,
    state: State,
    inner: Any,
    *,
    goal: float,
    reach: float,
    max_steps: int,
    callback: Callable[[Step], object] | None,
) -> tuple[State, OUTCOMES]:
    """Steps until the asymmetry is at its goal, or something else ends them.

    Args:
        inner: a state of the minimiser, for what of it is not arrays.
    """
    minimiser, target = setting.minimiser, setting.objective.target
    arrays, others = eqx.partition(inner, eqx.is_array)
    inner = eqx.combine(jax.tree.unflatten(jax.tree.structure(arrays), state.minimiser_arrays), others)
    y, accepted, evaluation, prepared_at = state.unknowns, state.accepted, state.evaluation, state.prepared_at
    history, steps, rejections = list(state.history), state.steps, state.rejections
    objective = setting.prepared(prepared_at)
    fn = setting.minimisable(objective)
    at_rest = bool(_terminates(minimiser, fn, y, inner, _bounded(evaluation, jnp.inf)))
    while True:
        asymmetry = asymmetry_of(history[-1], target.count())
        if asymmetry <= goal:
            outcome = OUTCOMES.successful
            break
        if history[-1].rms_displacement > reach:
            outcome = OUTCOMES.out_of_reach
            break
        if at_rest or (setting.steps_back and rejections >= _REJECTIONS):
            outcome = OUTCOMES.no_symmetry_nearby
            break
        if steps >= max_steps:
            outcome = OUTCOMES.max_steps_reached
            break
        # The first step of a line search evaluates the start once more, and rounding may raise it.
        bound = asymmetry if setting.steps_back and steps > 0 else jnp.inf
        y, inner, advance = _step(minimiser, fn, y, inner, _bounded(evaluation, bound))
        steps += 1
        moved, at_rest, measures = jax.device_get(advance)  # at once: each wait for a number costs
        if moved and setting.steps_back and isinstance(minimiser, _KEEP_EVALUATION):
            # What a step returns beside the state lags behind by one accepted point; the state's own does not.
            evaluation = inner.aux
        elif moved:
            value, found = _evaluate(
                objective, setting.theta(y), Accepted(evaluation.fields, jnp.asarray(asymmetry))
            )
            moved = bool(jnp.isfinite(value))
            evaluation = found if moved else evaluation
        if moved:
            rejections, accepted = 0, setting.theta(y)
            history.append(recorded(steps, evaluation, measures))
            if callback is not None:
                callback(history[-1])
        else:
            rejections += 1
        # After many rejections too: perhaps it is the eigensolver that fails.
        if len(history) - 1 in _PREPARED_AFTER if moved else rejections == _DOUBTFUL:
            prepared_at = setting.theta(y)
            objective = setting.prepared(prepared_at)
            fn = setting.minimisable(objective)
    return State(
        unknowns=y,
        minimiser_arrays=arrays_of(inner),
        accepted=accepted,
        evaluation=evaluation,
        prepared_at=prepared_at,
        history=tuple(history),
        steps=steps,
        rejections=rejections,
        problem=state.problem,
    ), outcome


def arrays_of(inner: Any) -> tuple[Array, ...]:
    """What of a minimiser's state changes from step to step; the rest cannot always be pickled."""
    return tuple(jax.tree.leaves(eqx.filter(inner, eqx.is_array)))


def asymmetry_of(step: Step, count: int) -> np.floating:
    """Σ λ · area of the target's fields."""
    return step.dimensionless[:count].sum()


def recorded(steps: int, evaluation: Evaluation, measures: tuple[ArrayLike, ArrayLike]) -> Step:
    dimensionless, terms, (rms, angle) = jax.device_get(
        (evaluation.dimensionless, evaluation.terms, measures)
    )
    return Step(
        steps=steps,
        dimensionless=dimensionless,
        terms=terms,
        rms_displacement=float(rms),
        smallest_angle=float(np.degrees(angle)),
    )


@eqx.filter_jit
def _inverse(
    objective: SymmetryObjective, multigrid: AbstractPreconditioner, theta: PyTree
) -> AbstractApproximateInverse:
    return multigrid.prepare(killing_problem(objective.surface(theta)))


@eqx.filter_jit
def _evaluate(objective: SymmetryObjective, theta: PyTree, accepted: Accepted) -> tuple[Array, Evaluation]:
    return objective(theta, accepted)


@eqx.filter_jit
def _init(minimiser: Any, fn: Any, y: PyTree, evaluation: Evaluation) -> Any:
    accepted = _bounded(evaluation, jnp.inf)
    value, aux = eqx.filter_eval_shape(fn, y, accepted)
    return minimiser.init(fn, y, accepted, {}, value, aux, frozenset())


@eqx.filter_jit
def _step(
    minimiser: Any, fn: Any, y: PyTree, inner: Any, accepted: Accepted
) -> tuple[PyTree, Any, tuple[jax.Array, jax.Array, tuple[jax.Array, jax.Array]]]:
    """The next unknowns and state; whether they moved, whether the minimiser is at rest, and `measures`."""
    proposed, inner, _ = minimiser.step(fn, y, accepted, {}, inner, frozenset())
    differences = jax.tree.map(lambda a, b: (a != b).any(), proposed, y)
    moved = jnp.stack(jax.tree.leaves(differences)).any()
    at_rest = _terminates(minimiser, fn, proposed, inner, accepted)
    return proposed, inner, (moved, at_rest, measures(*fn.surfaces(proposed)))


def _terminates(minimiser: Any, fn: Any, y: PyTree, inner: Any, accepted: Accepted) -> jax.Array:
    return minimiser.terminate(fn, y, accepted, {}, inner, frozenset())[0]


def _bounded(evaluation: Evaluation, bound: Float[ArrayLike, ""]) -> Accepted:
    return Accepted(evaluation.fields, jnp.asarray(bound, evaluation.dimensionless.dtype))


@eqx.filter_jit
def measures(moved: Configuration, original: Configuration) -> tuple[jax.Array, jax.Array]:
    """Root mean square displacement in mean edges of the original, NaN without positions; smallest angle, radians."""
    angle = corner_angles(moved.lengths, moved.topology).min()
    if moved.embedding is None:
        return jnp.asarray(jnp.nan), angle
    displacement = (moved.vertices - original.vertices) / original.unit
    return jnp.sqrt((displacement**2).sum(axis=1).mean()), angle
