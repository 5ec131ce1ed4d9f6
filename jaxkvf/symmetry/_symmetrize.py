"""Moving the vertices of a nearly symmetric mesh until its intrinsic symmetry is exact."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ..eigen import AbstractEigensolver
from ..geometry import corner_angles, edge_lengths
from ..killing import Regge
from ..mesh import TriangleMesh
from ..solvers import multigrid_solver
from ._objective import AbstractTerm, Evaluation, PositionFidelity, ShapeBarrier, SymmetryObjective


class OUTCOMES(eqx.Enumeration):
    """How a symmetrization ended; `OUTCOMES[symmetrization.result]` is the message, empty for success."""

    successful = ""
    no_symmetry_nearby = (
        "The minimiser came to rest at a mesh that is not symmetric to the tolerance: no symmetric mesh is nearby. "
        "Lower the weights of the terms, ask for fewer fields (`count`), or accept the mesh as it is."
    )
    max_steps_reached = (
        "The maximum number of evaluations was reached before λ·area fell to the tolerance. "
        "Raise `max_steps` or `rtol`."
    )
    eigensolver_failed = (
        "The eigensolver failed on the input mesh, so nothing could be minimised. "
        "`killing_fields` on the same mesh and solver says why."
    )


class Step(eqx.Module):
    """The mesh after one accepted step."""

    evaluations: int
    """Evaluations of the objective so far, one eigensolve each."""
    dimensionless: Float[np.ndarray, " k"]
    """λ · area of the first `count + 2` fields."""
    terms: Float[np.ndarray, " t"]
    """Price of each term of the objective."""
    rms_displacement: float
    """Root mean square displacement of the vertices from the input, in its mean edge lengths."""
    smallest_angle: float
    """Smallest corner angle. Degrees."""


class Symmetrization(eqx.Module):
    """A symmetrized mesh and the way to it."""

    mesh: TriangleMesh
    history: tuple[Step, ...]
    """The input mesh first, then one entry an accepted step."""
    result: OUTCOMES
    stats: dict[str, Any]


def symmetrize(
    mesh: TriangleMesh,
    *,
    count: int = 1,
    terms: Sequence[AbstractTerm] = (PositionFidelity(), ShapeBarrier()),
    minimiser: optx.AbstractMinimiser | None = None,
    solver: AbstractEigensolver | None = None,
    rtol: float = 5e-6,
    atol: float = 1e-9,
    max_steps: int = 500,
    callback: Callable[[Step], object] | None = None,
) -> Symmetrization:
    """The mesh near `mesh` that has `count` exact Killing vector fields.

    Minimises Σ_{i<count} λ_i · area + Σ terms over the vertices with an optimistix minimiser and the exact gradient of
    the eigenvalues (discretization `regge`: the other is not positive semi-definite and cannot be minimised).

    Args:
        mesh: the input, kept as it is.
        count: number of symmetries to make exact: 1 for a surface of revolution, 2 for a cylinder, 3 for a sphere.
        terms: prices of moving, see `PositionFidelity` and `ShapeBarrier`; dropping the latter allows slivers.
        minimiser: any optimistix minimiser over displacements `[V, 3]` in mean edge lengths; by default L-BFGS.
        solver: eigensolver; by default `multigrid_solver` on meshes that are worth it, shift-invert on small ones.
        rtol, atol: done when Σ_{i<count} λ_i · area ≤ rtol × its value at the input + atol.
        max_steps: most evaluations of the objective.
        callback: called with every accepted `Step`, the input's first.

    Returns:
        the best mesh found, even where the tolerance was not reached: look at `.result`. λ·area never rises along
        `.history` by more than the terms' prices fall.

    Raises:
        ValueError: count or max_steps not a positive integer, negative tolerances.
    """
    for name, value in (("count", count), ("max_steps", max_steps)):
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise ValueError(f"{name} must be a positive integer, got {value!r}")
    if count > 3:
        raise ValueError(f"count must be at most 3 (no surface has more independent symmetries), got {count}")
    if not (rtol >= 0 and atol >= 0):
        raise ValueError(f"rtol and atol must not be negative, got {rtol} and {atol}")
    if minimiser is None:
        minimiser = optx.LBFGS(rtol=1e-8, atol=1e-8, history_length=20)

    if solver is None:
        worth_a_hierarchy = mesh.topology.n_vertices >= _MULTIGRID_FROM
        solver = multigrid_solver(mesh, rtol=_RESIDUAL) if worth_a_hierarchy else None
    objective = SymmetryObjective(mesh, tuple(terms), count, Regge(), solver)
    displacement = jnp.zeros_like(mesh.vertices)
    evaluation = _evaluate(objective, displacement)
    if not bool(evaluation.solved):
        return Symmetrization(mesh, (), OUTCOMES.eigensolver_failed, {"evaluations": 1, "steps": 0})

    evaluations, history = 1, [_record(objective, displacement, evaluation, 1)]
    if callback is not None:
        callback(history[0])
    goal = rtol * float(history[0].dimensionless[:count].sum()) + atol
    state = _init(minimiser, objective, displacement, evaluation)
    first, outcome = True, OUTCOMES.max_steps_reached
    while float(history[-1].dimensionless[:count].sum()) > goal:
        if evaluations >= max_steps:
            break
        if bool(
            minimiser.terminate(objective, displacement, evaluation.eigenvectors, {}, state, frozenset())[0]
        ):
            outcome = OUTCOMES.no_symmetry_nearby
            break
        proposed, state = _step(minimiser, objective, displacement, state, evaluation)
        # Optimistix evaluates the starting point in its first step, which is done already.
        evaluations += 0 if first else 1
        first = False
        if bool((proposed != displacement).any()):
            displacement = proposed
            # What a step returns beside the state lags behind by one accepted point; the state's own does not.
            evaluation = state.aux if hasattr(state, "aux") else _evaluate(objective, displacement)
            history.append(_record(objective, displacement, evaluation, evaluations))
            if callback is not None:
                callback(history[-1])
    else:
        outcome = OUTCOMES.successful
    return Symmetrization(
        objective.moved(displacement),
        tuple(history),
        outcome,
        {"evaluations": evaluations, "steps": len(history) - 1},
    )


_MULTIGRID_FROM = 4_000  # vertices; smaller meshes are solved before multigrid is compiled
_RESIDUAL = 1e-10  # of the eigensolves: gradients inherit it to first order


@eqx.filter_jit
def _evaluate(objective: SymmetryObjective, displacement: Array) -> Evaluation:
    return objective(displacement, None)[1]


@eqx.filter_jit
def _init(
    minimiser: optx.AbstractMinimiser, objective: SymmetryObjective, displacement: Array, near: Evaluation
) -> Any:
    guess = near.eigenvectors
    value, aux = eqx.filter_eval_shape(objective, displacement, guess)
    return minimiser.init(objective, displacement, guess, {}, value, aux, frozenset())


@eqx.filter_jit
def _step(
    minimiser: optx.AbstractMinimiser,
    objective: SymmetryObjective,
    displacement: Array,
    state: Any,
    near: Evaluation,
) -> tuple[Array, Any]:
    guess = near.eigenvectors
    displacement, state, _ = minimiser.step(objective, displacement, guess, {}, state, frozenset())
    return displacement, state


@eqx.filter_jit
def _measure(objective: SymmetryObjective, displacement: Float[Array, "V 3"]) -> tuple[Array, Array]:
    lengths = edge_lengths(objective.moved(displacement).vertices, objective.original.topology)
    rms = jnp.sqrt((displacement**2).sum(axis=1).mean())
    return rms, corner_angles(lengths, objective.original.topology).min()


def _record(
    objective: SymmetryObjective, displacement: Float[Array, "V 3"], evaluation: Evaluation, evaluations: int
) -> Step:
    rms, angle = _measure(objective, displacement)
    return Step(
        evaluations=evaluations,
        dimensionless=np.asarray(evaluation.dimensionless),
        terms=np.asarray(evaluation.terms),
        rms_displacement=float(rms),
        smallest_angle=float(np.degrees(angle)),
    )
