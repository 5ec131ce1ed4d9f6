"""Moving the vertices of a nearly symmetric mesh until its intrinsic symmetry is exact."""

import functools
import os
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import PyTree

from ..arguments import Integer, Real, checked_integer, checked_not_negative, checked_positive
from ..eigen import AbstractEigensolver
from ..mesh import TriangleMesh
from ..solvers import preconditioner_for_many_solves
from ._configuration import Configuration
from ._minimisation import Minimisation, arrays_of, asymmetry_of, measures, minimised, recorded
from ._objective import Evaluation, SymmetryObjective, least_meaning
from ._outcome import OUTCOMES, Symmetrization
from ._state import State, Step, problem_of, resumed
from ._targets import AbstractTarget, LowestFields
from ._terms import AbstractTerm, LengthFidelity, PositionFidelity, ShapeBarrier
from ._unknowns import AbstractUnknowns, Displacements, EdgeLengths

_ROUND_FLOOR = 20.0
_CONFIRMED = 1e-3  # of the goal: what two solves may differ by; 100 √ε in single precision


def symmetrize(
    mesh: TriangleMesh,
    target: Integer | AbstractTarget = 1,
    *,
    terms: Sequence[AbstractTerm] | None = None,
    unknowns: AbstractUnknowns | None = None,
    minimiser: optx.AbstractMinimiser | optx.AbstractLeastSquaresSolver | None = None,
    solver: AbstractEigensolver | None = None,
    rtol: Real = 5e-7,
    atol: Real | None = None,
    reach: Real = 1.0,
    max_steps: Integer = 500,
    callback: Callable[[Step], object] | None = None,
    resume: State | str | os.PathLike[str] | None = None,
) -> Symmetrization:
    """The mesh near `mesh` that has exact Killing vector fields.

    Minimises Σ λ · area over the target's fields + Σ terms, with discretization `regge`. λ · area of the target never rises
    from one accepted step to the next. Deterministic.

    *When to stop.* Triangles are flat, so that λ of a mesh is hardly ever 0: of irregular meshes of perfect surfaces of
    revolution with F triangles λ₀ · area is some 200 / F² (round) or more (`benchmarks/symmetrize.py` prints it). Below that
    there is nothing to gain but a better fit to the discretization's error; the default `atol` is a tenth of it, 20 / F². In
    single precision rounding of the positions alone makes some (ε F)², ε = 1.2e-7, which from 6,000 triangles on is more.

    Args:
        mesh: the input, kept as it is.
        target: number of symmetries to make exact (1 for a surface of revolution, 2 for a cylinder, 3 for a sphere), or
            `ChosenField(vectors)`.
        terms: prices of changing the mesh; by default `PositionFidelity()` (for lengths `LengthFidelity()`) and
            `ShapeBarrier()`. Without a barrier slivers may appear.
        unknowns: what is varied: `Displacements()` (the default), `EdgeLengths()`, `Parameters(…)`.
        minimiser: any optimistix minimiser over the unknowns, by default L-BFGS; or a least-squares solver, which is given
            the Killing energy as a sum of squares in (unknowns, fields). Of one that cannot step back (simplices, learning
            rates) those points are accepted that are better than all before.
        solver: eigensolver; by default LOBPCG with multigrid from 4,000 vertices on (2,000 where JAX keeps compiled
            programs, `jax_compilation_cache_dir`), its preconditioner made anew after 4, 8, 16, … steps; shift-invert on
            smaller meshes.
        rtol: done when Σ λ · area ≤ rtol × its value at the input + atol.
        atol: see rtol; dimensionless.
        reach: largest root mean square displacement, in mean edges: a mesh that would have to go further has no symmetry
            nearby.
        max_steps: most steps of the minimiser, accepted or not; L-BFGS solves one eigenproblem in each.
        callback: called with every accepted `Step`, the input's first.
        resume: a `state` to go on from, or the file it was saved to; mesh, target, terms, unknowns and minimiser as they
            were then.

    Returns:
        the best surface found, even where the tolerance was not reached: look at `.result`. Success is confirmed by an
        eigensolve from scratch on the surface that is returned.

    Raises:
        ValueError: a target that is not one, max_steps not a positive integer, negative tolerances, shapes that do not fit,
            terms of positions where lengths are varied, the state of another problem (the message says what differs) or a
            damaged file.
        TypeError: `resume` is neither a state nor a path.
        OSError: the file to resume from cannot be read.
    """
    max_steps = checked_integer("max_steps", max_steps)
    rtol, reach = checked_not_negative("rtol", rtol), checked_positive("reach", reach, finite=False)
    chosen = target if isinstance(target, AbstractTarget) else LowestFields(target)
    unknowns = Displacements() if unknowns is None else unknowns
    if terms is None:
        fidelity = LengthFidelity() if isinstance(unknowns, EdgeLengths) else PositionFidelity()
        terms = (fidelity, ShapeBarrier())
    if minimiser is None:
        minimiser = _default_minimiser()
    atol = _floor(mesh) if atol is None else checked_not_negative("atol", atol)
    objective = SymmetryObjective(Configuration.of(mesh), unknowns, chosen, tuple(terms), solver)
    setting = Minimisation(
        minimiser, objective, preconditioner_for_many_solves(mesh) if solver is None else None
    )

    theta = unknowns.start(mesh)
    problem = problem_of(mesh, target=chosen, terms=tuple(terms), unknowns=unknowns, minimiser=minimiser)
    if resume is None:
        surface = _surface(objective, theta)
        evaluation = _from_scratch(objective, surface, mesh)
        history = (recorded(0, evaluation, measures(surface, objective.original)),)
        inner = setting.start(theta, evaluation)
        y = setting.variables(theta, evaluation.fields)
        state = State(y, arrays_of(inner), theta, evaluation, theta, history, 0, 0, problem)
        if not bool(evaluation.solved):
            return _result(objective, state, OUTCOMES.eigensolver_failed)
        if callback is not None:
            callback(history[0])
    else:
        state = resumed(resume, problem, setting.variables(theta, objective.original.lengths), theta)
        inner = setting.start(state.accepted, state.evaluation)
    lowest, least = asymmetry_of(state.history[0], chosen.count()), -least_meaning(mesh.vertices.dtype)
    if lowest < least:
        return _result(objective, state, OUTCOMES.below_zero)
    goal = rtol * float(lowest) + atol
    state, outcome = minimised(
        setting, state, inner, goal=goal, reach=reach, max_steps=max_steps, callback=callback
    )
    if outcome == OUTCOMES.successful:
        found = _from_scratch(objective, _surface(objective, state.accepted), mesh)
        asymmetry = float(objective.asymmetry(found))
        if asymmetry < least:
            outcome = OUTCOMES.below_zero
        elif not (bool(found.solved) and asymmetry <= goal * (1 + max(_CONFIRMED, -100 * least))):
            outcome = OUTCOMES.not_confirmed
    return _result(objective, state, outcome)


@functools.cache
def _default_minimiser() -> optx.AbstractMinimiser:
    """One object for all calls: compiled steps are kept by it."""
    return optx.LBFGS(rtol=1e-8, atol=1e-8, history_length=20)


def _floor(mesh: TriangleMesh) -> float:
    """λ · area that is as good as 0 on a mesh of so many triangles, in its precision."""
    n_faces, precision = mesh.topology.n_faces, float(jnp.finfo(mesh.vertices.dtype).eps)
    return max(_ROUND_FLOOR / n_faces**2, (precision * n_faces) ** 2)


def _from_scratch(objective: SymmetryObjective, surface: Configuration, mesh: TriangleMesh) -> Evaluation:
    """The objective with fields found without a guess, or as they are given."""
    # Outside of jit, where a solver on the host needs no callback and so no program of its own.
    fields, solved = objective.target.find(surface, objective.target.given(mesh), objective.solver)
    return _evaluated(objective, surface, fields, solved)


def _result(objective: SymmetryObjective, state: State, outcome: OUTCOMES) -> Symmetrization:
    surface = _surface(objective, state.accepted)
    return Symmetrization(
        mesh=None if surface.embedding is None else TriangleMesh(surface.embedding, surface.topology),
        lengths=surface.lengths,
        unknowns=state.accepted,
        history=state.history,
        result=outcome,
        stats={"steps": state.steps, "accepted": len(state.history) - 1},
        state=state,
    )


@eqx.filter_jit
def _surface(objective: SymmetryObjective, theta: PyTree) -> Configuration:
    return objective.surface(theta)


@eqx.filter_jit
def _evaluated(
    objective: SymmetryObjective, surface: Configuration, fields: jax.Array, solved: jax.Array
) -> Evaluation:
    return objective.evaluated(surface, fields, solved)
