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
        solver: eigensolver; by default chosen by size.
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

    objective = SymmetryObjective(mesh, tuple(terms), count, Regge(), solver)
    displacement = jnp.zeros_like(mesh.vertices)
    state = _init(minimiser, objective, displacement)
    evaluations, history, goal = 0, [], -np.inf
    outcome = OUTCOMES.max_steps_reached
    while evaluations < max_steps:
        proposed, state = _step(minimiser, objective, displacement, state)
        # What a step returns beside the state lags behind by one accepted point; the state's own does not.
        evaluation = state.aux if hasattr(state, "aux") else _evaluate(objective, proposed)
        evaluations += 1
        first = evaluations == 1  # optimistix evaluates the starting point in its first step
        if first and not bool(evaluation.solved):
            outcome = OUTCOMES.eigensolver_failed
            break
        if first or bool((proposed != displacement).any()):
            displacement = proposed
            history.append(_record(objective, displacement, evaluation, evaluations))
            if callback is not None:
                callback(history[-1])
        asymmetry = float(history[-1].dimensionless[:count].sum())
        if first:
            goal = rtol * asymmetry + atol
        if asymmetry <= goal:
            outcome = OUTCOMES.successful
            break
        if bool(minimiser.terminate(objective, displacement, None, {}, state, frozenset())[0]):
            outcome = OUTCOMES.no_symmetry_nearby
            break
    return Symmetrization(
        objective.moved(displacement),
        tuple(history),
        outcome,
        {"evaluations": evaluations, "steps": len(history) - 1},
    )


@eqx.filter_jit
def _init(minimiser: optx.AbstractMinimiser, objective: SymmetryObjective, displacement: Array) -> Any:
    value, aux = eqx.filter_eval_shape(objective, displacement, None)
    return minimiser.init(objective, displacement, None, {}, value, aux, frozenset())


@eqx.filter_jit
def _step(
    minimiser: optx.AbstractMinimiser, objective: SymmetryObjective, displacement: Array, state: Any
) -> tuple[Array, Any]:
    displacement, state, _ = minimiser.step(objective, displacement, None, {}, state, frozenset())
    return displacement, state


@eqx.filter_jit
def _evaluate(objective: SymmetryObjective, displacement: Array) -> Evaluation:
    return objective(displacement)[1]


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
