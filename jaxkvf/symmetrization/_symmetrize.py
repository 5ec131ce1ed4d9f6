"""Moving the vertices of a nearly symmetric mesh until its intrinsic symmetry is exact."""

import dataclasses
import functools
import os
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import ArrayLike, PyTree

from ..eigen import (
    LOBPCG,
    AbstractApproximateInverse,
    AbstractEigensolver,
    AbstractPreconditioner,
    KeptInverse,
)
from ..geometry import corner_angles
from ..mesh import TriangleMesh
from ..solvers import preconditioner_for_many_solves
from ._objective import Accepted, Evaluation, SquaredObjective, SymmetryObjective
from ._outcome import OUTCOMES, State, Step, Symmetrization
from ._surface import Surface
from ._targets import AbstractTarget, LowestFields, killing_problem
from ._terms import AbstractTerm, LengthFidelity, PositionFidelity, ShapeBarrier
from ._unknowns import AbstractUnknowns, Displacements, EdgeLengths

_RESIDUAL = 3e-9  # of the eigensolves: gradients inherit it to first order
_PREPARED_AFTER = {2**i for i in range(2, 30)}  # accepted steps: they become smaller and smaller
_DOUBTFUL = 3  # rejected steps in a row
_REJECTIONS = 30  # in a row: the line search has come to rest
_ROUND_FLOOR = 20.0


def symmetrize(
    mesh: TriangleMesh,
    target: int | AbstractTarget = 1,
    *,
    terms: Sequence[AbstractTerm] | None = None,
    unknowns: AbstractUnknowns | None = None,
    minimiser: optx.AbstractMinimiser | optx.AbstractLeastSquaresSolver | None = None,
    solver: AbstractEigensolver | None = None,
    rtol: float = 5e-7,
    atol: float | None = None,
    reach: float = 1.0,
    max_steps: int = 500,
    callback: Callable[[Step], object] | None = None,
    resume: State | str | os.PathLike[str] | None = None,
) -> Symmetrization:
    """The mesh near `mesh` that has exact Killing vector fields.

    Minimises Σ λ · area over the target's fields + Σ terms, with discretization `regge`. λ · area of the target never rises
    from one accepted step to the next. Deterministic.

    *When to stop.* Triangles are flat, so that λ of a mesh is hardly ever 0: of irregular meshes of perfect surfaces of
    revolution with F triangles λ₀ · area is some 200 / F² (round) or more (`benchmarks/symmetrize.py` prints it). Below that
    there is nothing to gain but a better fit to the discretization's error; the default `atol` is a tenth of it, 20 / F².

    Args:
        mesh: the input, kept as it is.
        target: number of symmetries to make exact (1 for a surface of revolution, 2 for a cylinder, 3 for a sphere), or
            `ChosenField(vectors)`.
        terms: prices of changing the mesh; by default `PositionFidelity()` (for lengths `LengthFidelity()`) and
            `ShapeBarrier()`. Without a barrier slivers may appear.
        unknowns: what is varied: `Displacements()` (the default), `EdgeLengths()`, `Parameters(…)`.
        minimiser: any optimistix minimiser over the unknowns, by default L-BFGS; or a least-squares solver, which is given
            the Killing energy as a sum of squares in (unknowns, fields).
        solver: eigensolver; by default LOBPCG with multigrid from 4,000 vertices on (2,000 where JAX keeps compiled
            programs, `jax_compilation_cache_dir`), its preconditioner made anew after 4, 8, 16, … steps; shift-invert on
            smaller meshes.
        rtol: done when Σ λ · area ≤ rtol × its value at the input + atol.
        atol: see rtol; dimensionless.
        reach: largest root mean square displacement, in mean edges: a mesh that would have to go further has no symmetry
            nearby.
        max_steps: most evaluations of the objective.
        callback: called with every accepted `Step`, the input's first.
        resume: a `state` to go on from, or the file it was saved to; all other arguments but `max_steps`, tolerances,
            `reach` and `callback` as they were then.

    Returns:
        the best surface found, even where the tolerance was not reached: look at `.result`.

    Raises:
        ValueError: a target that is not one, max_steps not a positive integer, negative tolerances, shapes that do not fit,
            terms of positions where lengths are varied, the state of another problem.
    """
    _check(max_steps, rtol, atol, reach)
    chosen = target if isinstance(target, AbstractTarget) else LowestFields(target)
    unknowns = Displacements() if unknowns is None else unknowns
    if terms is None:
        fidelity = LengthFidelity() if isinstance(unknowns, EdgeLengths) else PositionFidelity()
        terms = (fidelity, ShapeBarrier())
    if minimiser is None:
        minimiser = _default_minimiser()
    if atol is None:
        atol = _ROUND_FLOOR / mesh.topology.n_faces**2
    objective = SymmetryObjective(Surface.of(mesh), unknowns, chosen, tuple(terms), solver)

    theta = unknowns.start(mesh)
    surface = _surface(objective, theta)
    # Outside of jit, where a solver on the host needs no callback and so no program of its own.
    fields, solved = chosen.find(surface, chosen.given(mesh), solver)
    evaluation = _evaluated(objective, surface, fields, solved)
    history = (_record(1, evaluation, _measures(surface, objective.original)),)
    squared = isinstance(minimiser, optx.AbstractLeastSquaresSolver)
    y = (theta, evaluation.fields[:, : chosen.count()]) if squared else theta
    inner = _init(minimiser, _minimisable(objective, squared), y, evaluation)
    state = State(y, inner, evaluation, history, theta)
    if not bool(evaluation.solved):
        return _result(objective, state, squared, OUTCOMES.eigensolver_failed)
    if resume is not None:
        state = resume if isinstance(resume, State) else state.load(resume)
    elif callback is not None:
        callback(history[0])
    goal = rtol * _asymmetry(state.history[0], chosen) + atol
    multigrid = preconditioner_for_many_solves(mesh) if solver is None else None
    state, outcome = _minimised(
        minimiser,
        objective,
        state,
        squared=squared,
        multigrid=multigrid,
        goal=goal,
        reach=reach,
        max_steps=max_steps,
        callback=callback,
    )
    return _result(objective, state, squared, outcome)


def _prepared(
    objective: SymmetryObjective, multigrid: AbstractPreconditioner | None, theta: PyTree
) -> SymmetryObjective:
    """The objective with a solver for surfaces near that of θ: a preconditioner costs half an eigensolve to make."""
    if multigrid is None:
        return objective
    kept = KeptInverse(_inverse(dataclasses.replace(objective, solver=None), multigrid, theta))
    # Guesses are near: one guard vector will do.
    solver = LOBPCG(rtol=_RESIDUAL, max_steps=200, guard_vectors=1, preconditioner=kept)
    return dataclasses.replace(objective, solver=solver)


@eqx.filter_jit
def _inverse(
    objective: SymmetryObjective, multigrid: AbstractPreconditioner, theta: PyTree
) -> AbstractApproximateInverse:
    return multigrid.prepare(killing_problem(objective.surface(theta)))


def _minimisable(objective: SymmetryObjective, squared: bool) -> SymmetryObjective | SquaredObjective:
    return SquaredObjective(objective) if squared else objective


@functools.cache
def _default_minimiser() -> optx.AbstractMinimiser:
    """One object for all calls: compiled steps are kept by it."""
    return optx.LBFGS(rtol=1e-8, atol=1e-8, history_length=20)


def _check(max_steps: int, rtol: float, atol: float | None, reach: float) -> None:
    if isinstance(max_steps, bool) or not isinstance(max_steps, int) or max_steps < 1:
        raise ValueError(f"max_steps must be a positive integer, got {max_steps!r}")
    if not (rtol >= 0 and (atol is None or atol >= 0)):
        raise ValueError(f"rtol and atol must not be negative, got {rtol} and {atol}")
    if not reach > 0:
        raise ValueError(f"reach must be positive, got {reach}")


def _minimised(
    minimiser: Any,
    objective: SymmetryObjective,
    state: State,
    *,
    squared: bool,
    multigrid: AbstractPreconditioner | None,
    goal: float,
    reach: float,
    max_steps: int,
    callback: Callable[[Step], object] | None,
) -> tuple[State, OUTCOMES]:
    """The loop over the minimiser's steps."""
    target, prepared_at = objective.target, state.prepared_at
    objective = _prepared(objective, multigrid, prepared_at)
    fn = _minimisable(objective, squared)
    y, inner, evaluation, history = (
        state.unknowns,
        state.minimiser_state,
        state.evaluation,
        list(state.history),
    )
    # Optimistix evaluates the starting point in its first step, which is done already.
    evaluations = history[-1].evaluations - (1 if len(history) == 1 else 0)
    rejections, outcome = 0, OUTCOMES.max_steps_reached
    at_rest = bool(_terminates(minimiser, fn, y, inner, evaluation))
    while True:
        if _asymmetry(history[-1], target) <= goal:
            outcome = OUTCOMES.successful
            break
        if history[-1].rms_displacement > reach:
            outcome = OUTCOMES.out_of_reach
            break
        if rejections >= _REJECTIONS or at_rest:
            outcome = OUTCOMES.no_symmetry_nearby
            break
        if evaluations >= max_steps:
            break
        y, inner, advance = _step(minimiser, fn, y, inner, evaluation)
        evaluations += 1
        moved, at_rest, measures = jax.device_get(advance)  # at once: each wait for a number costs
        if moved:
            rejections = 0
            if squared:
                evaluation = _evaluate(objective, y[0], evaluation.fields)
            else:
                # What a step returns beside the state lags behind by one accepted point; the state's own does not.
                evaluation = (
                    inner.aux if hasattr(inner, "aux") else _evaluate(objective, y, evaluation.fields)
                )
            history.append(_record(evaluations, evaluation, measures))
            if callback is not None:
                callback(history[-1])
        else:
            rejections += 1
        # After many rejections too: perhaps it is the eigensolver that fails.
        if len(history) - 1 in _PREPARED_AFTER if moved else rejections == _DOUBTFUL:
            prepared_at = y[0] if squared else y
            objective = _prepared(objective, multigrid, prepared_at)
            fn = _minimisable(objective, squared)
    return State(y, inner, evaluation, tuple(history), prepared_at), outcome


def _asymmetry(step: Step, target: AbstractTarget) -> float:
    return float(step.dimensionless[: target.count()].sum())


def _result(objective: SymmetryObjective, state: State, squared: bool, outcome: OUTCOMES) -> Symmetrization:
    theta = state.unknowns[0] if squared else state.unknowns
    surface = _surface(objective, theta)
    mesh = None if surface.embedding is None else TriangleMesh(surface.embedding, surface.topology)
    stats = {"evaluations": state.evaluations, "steps": len(state.history) - 1}
    return Symmetrization(mesh, surface.lengths, theta, state.history, outcome, stats, state)


@eqx.filter_jit
def _surface(objective: SymmetryObjective, theta: PyTree) -> Surface:
    return objective.surface(theta)


@eqx.filter_jit
def _evaluated(
    objective: SymmetryObjective, surface: Surface, fields: jax.Array, solved: jax.Array
) -> Evaluation:
    return objective.evaluated(surface, fields, solved)


@eqx.filter_jit
def _evaluate(objective: SymmetryObjective, theta: PyTree, fields: Any) -> Evaluation:
    return objective(theta, Accepted(fields, jnp.asarray(jnp.inf)))[1]


@eqx.filter_jit
def _init(minimiser: Any, fn: Any, y: PyTree, evaluation: Evaluation) -> Any:
    accepted = fn.accepted(evaluation)
    value, aux = eqx.filter_eval_shape(fn, y, accepted)
    return minimiser.init(fn, y, accepted, {}, value, aux, frozenset())


@eqx.filter_jit
def _step(
    minimiser: Any, fn: Any, y: PyTree, inner: Any, evaluation: Evaluation
) -> tuple[PyTree, Any, tuple[jax.Array, jax.Array, tuple[jax.Array, jax.Array]]]:
    """The next unknowns and state; whether they moved, whether the minimiser is at rest, and `_measures`."""
    proposed, inner, _ = minimiser.step(fn, y, fn.accepted(evaluation), {}, inner, frozenset())
    differences = jax.tree.map(lambda a, b: (a != b).any(), proposed, y)
    moved = jnp.stack(jax.tree.leaves(differences)).any()
    at_rest = _terminates(minimiser, fn, proposed, inner, evaluation)
    return proposed, inner, (moved, at_rest, _measures(*fn.surfaces(proposed)))


def _terminates(minimiser: Any, fn: Any, y: PyTree, inner: Any, evaluation: Evaluation) -> jax.Array:
    return minimiser.terminate(fn, y, fn.accepted(evaluation), {}, inner, frozenset())[0]


@eqx.filter_jit
def _measures(moved: Surface, original: Surface) -> tuple[jax.Array, jax.Array]:
    """Root mean square displacement in mean edges of the original, NaN without positions; smallest angle, radians."""
    angle = corner_angles(moved.lengths, moved.topology).min()
    if moved.embedding is None:
        return jnp.asarray(jnp.nan), angle
    displacement = (moved.vertices - original.vertices) / original.unit
    return jnp.sqrt((displacement**2).sum(axis=1).mean()), angle


def _record(evaluations: int, evaluation: Evaluation, measures: tuple[ArrayLike, ArrayLike]) -> Step:
    dimensionless, terms, (rms, angle) = jax.device_get(
        (evaluation.dimensionless, evaluation.terms, measures)
    )
    return Step(
        evaluations=evaluations,
        dimensionless=dimensionless,
        terms=terms,
        rms_displacement=float(rms),
        smallest_angle=float(np.degrees(angle)),
    )
