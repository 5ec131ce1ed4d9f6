"""Moving the vertices of a nearly symmetric mesh until its intrinsic symmetry is exact."""

import functools
import os
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import PyTree

from ..eigen import (
    AbstractApproximateInverse,
    AbstractEigensolver,
    AbstractPreconditioner,
    GeneralizedEigenproblem,
    KeptInverse,
)
from ..geometry import corner_angles
from ..mesh import TriangleMesh
from ..solvers import multigrid_solver
from ._objective import Accepted, Evaluation, SquaredObjective, SymmetryObjective
from ._outcome import OUTCOMES, State, Step, Symmetrization
from ._surface import Surface
from ._targets import AbstractTarget, LowestFields, killing_problem
from ._terms import AbstractTerm, LengthFidelity, PositionFidelity, ShapeBarrier
from ._unknowns import AbstractUnknowns, Displacements, EdgeLengths

_MULTIGRID_FROM = 4_000  # vertices; smaller meshes are solved before multigrid is compiled
_RESIDUAL = 1e-10  # of the eigensolves: gradients inherit it to first order
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
        solver: eigensolver; by default `multigrid_solver` on meshes that are worth it, shift-invert on small ones.
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
    first_solver = solver  # a single solve would not repay the compilation of multigrid
    if solver is None and mesh.topology.n_vertices >= _MULTIGRID_FROM:
        solver = _warm_solver(mesh)
    if atol is None:
        atol = _ROUND_FLOOR / mesh.topology.n_faces**2
    objective = SymmetryObjective(Surface.of(mesh), unknowns, chosen, tuple(terms), solver)

    theta = unknowns.start(mesh)
    start = SymmetryObjective(objective.original, unknowns, chosen, objective.terms, first_solver)
    evaluation = _evaluate(start, theta, chosen.given(mesh))
    history = (_record(objective, theta, evaluation, 1),)
    squared = isinstance(minimiser, optx.AbstractLeastSquaresSolver)
    fn = SquaredObjective(objective) if squared else objective
    y = (theta, evaluation.fields[:, : chosen.count()]) if squared else theta
    state = State(y, _init(minimiser, fn, y, _accepted(evaluation, chosen)), evaluation, history)
    if not bool(evaluation.solved):
        return _result(objective, state, squared, OUTCOMES.eigensolver_failed)
    if resume is not None:
        state = resume if isinstance(resume, State) else state.load(resume)
    elif callback is not None:
        callback(history[0])
    goal = rtol * _asymmetry(state.history[0], chosen) + atol
    state, outcome = _minimised(
        minimiser, fn, objective, state, goal=goal, reach=reach, max_steps=max_steps, callback=callback
    )
    return _result(objective, state, squared, outcome)


def _warm_solver(mesh: TriangleMesh) -> AbstractEigensolver:
    """Multigrid, its numbers those of the input: near enough for all meshes on the way."""
    solver: Any = multigrid_solver(mesh, rtol=_RESIDUAL)
    inverse = _prepared(solver.first.preconditioner, killing_problem(Surface.of(mesh)))
    return eqx.tree_at(lambda s: s.first.preconditioner, solver, KeptInverse(inverse))


@eqx.filter_jit
def _prepared(
    preconditioner: AbstractPreconditioner, problem: GeneralizedEigenproblem
) -> AbstractApproximateInverse:
    return preconditioner.prepare(problem)


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
    fn: SymmetryObjective | SquaredObjective,
    objective: SymmetryObjective,
    state: State,
    *,
    goal: float,
    reach: float,
    max_steps: int,
    callback: Callable[[Step], object] | None,
) -> tuple[State, OUTCOMES]:
    """The loop over the minimiser's steps."""
    target, squared = objective.target, isinstance(fn, SquaredObjective)
    y, inner, evaluation, history = (
        state.unknowns,
        state.minimiser_state,
        state.evaluation,
        list(state.history),
    )
    # Optimistix evaluates the starting point in its first step, which is done already.
    evaluations = history[-1].evaluations - (1 if len(history) == 1 else 0)
    rejections, outcome = 0, OUTCOMES.max_steps_reached
    while True:
        if _asymmetry(history[-1], target) <= goal:
            outcome = OUTCOMES.successful
            break
        if history[-1].rms_displacement > reach:
            outcome = OUTCOMES.out_of_reach
            break
        accepted = _accepted(evaluation, target)
        if rejections >= _REJECTIONS or _at_rest(minimiser, fn, y, accepted, inner):
            outcome = OUTCOMES.no_symmetry_nearby
            break
        if evaluations >= max_steps:
            break
        proposed, inner = _step(minimiser, fn, y, inner, accepted)
        evaluations += 1
        if not _differ(proposed, y):
            rejections += 1
            continue
        rejections, y = 0, proposed
        if squared:
            evaluation = _evaluate(objective, y[0], evaluation.fields)
        else:
            # What a step returns beside the state lags behind by one accepted point; the state's own does not.
            evaluation = inner.aux if hasattr(inner, "aux") else _evaluate(objective, y, evaluation.fields)
        history.append(_record(objective, y[0] if squared else y, evaluation, evaluations))
        if callback is not None:
            callback(history[-1])
    return State(y, inner, evaluation, tuple(history)), outcome


def _asymmetry(step: Step, target: AbstractTarget) -> float:
    return float(step.dimensionless[: target.count()].sum())


def _accepted(evaluation: Evaluation, target: AbstractTarget) -> Accepted:
    asymmetry = evaluation.dimensionless[: target.count()].sum()
    # The start itself is evaluated once more, and rounding may raise it.
    return Accepted(evaluation.fields, asymmetry * (1 + 1e-9))


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
def _evaluate(objective: SymmetryObjective, theta: PyTree, fields: Any) -> Evaluation:
    return objective(theta, Accepted(fields, jnp.asarray(jnp.inf)))[1]


@eqx.filter_jit
def _init(minimiser: Any, fn: Any, y: PyTree, accepted: Accepted) -> Any:
    value, aux = eqx.filter_eval_shape(fn, y, accepted)
    return minimiser.init(fn, y, accepted, {}, value, aux, frozenset())


@eqx.filter_jit
def _step(minimiser: Any, fn: Any, y: PyTree, state: Any, accepted: Accepted) -> tuple[PyTree, Any]:
    y, state, _ = minimiser.step(fn, y, accepted, {}, state, frozenset())
    return y, state


def _at_rest(minimiser: Any, fn: Any, y: PyTree, accepted: Accepted, state: Any) -> bool:
    return bool(minimiser.terminate(fn, y, accepted, {}, state, frozenset())[0])


def _differ(one: PyTree, other: PyTree) -> bool:
    pairs = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    return any(bool((a != b).any()) for a, b in pairs)


@eqx.filter_jit
def _measure(objective: SymmetryObjective, theta: PyTree) -> tuple[jax.Array, jax.Array]:
    moved, original = objective.surface(theta), objective.original
    angle = corner_angles(moved.lengths, moved.topology).min()
    if moved.embedding is None:
        return jnp.asarray(jnp.nan), angle
    displacement = (moved.vertices - original.vertices) / original.unit
    return jnp.sqrt((displacement**2).sum(axis=1).mean()), angle


def _record(objective: SymmetryObjective, theta: PyTree, evaluation: Evaluation, evaluations: int) -> Step:
    rms, angle = _measure(objective, theta)
    return Step(
        evaluations=evaluations,
        dimensionless=np.asarray(evaluation.dimensionless),
        terms=np.asarray(evaluation.terms),
        rms_displacement=float(rms),
        smallest_angle=float(np.degrees(angle)),
    )
