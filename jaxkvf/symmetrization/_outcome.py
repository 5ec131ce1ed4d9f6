"""What a symmetrization returns: the surface, the way to it, how it ended, and a state to go on from."""

import equinox as eqx
from jaxtyping import Array, Float, PyTree

from ..mesh import TriangleMesh
from ._state import State, Step


class OUTCOMES(eqx.Enumeration):
    """How a symmetrization ended; `OUTCOMES[symmetrization.result]` is the message, empty for success."""

    successful = ""
    no_symmetry_nearby = (
        "The minimiser came to rest at a mesh that is not symmetric to the tolerance: no symmetric mesh is nearby. "
        "Lower the weights of the terms, ask for fewer fields, or accept the mesh as it is."
    )
    out_of_reach = (
        "The vertices moved as far as `reach` allows without becoming symmetric to the tolerance: no symmetric mesh is "
        "nearby. Raise `reach` to let the shape change further, ask for fewer fields, or accept the mesh as it is."
    )
    max_steps_reached = (
        "The maximum number of steps was reached before λ·area fell to the tolerance. "
        "Raise `max_steps` or the tolerance, or go on from `.state` with `resume`."
    )
    eigensolver_failed = (
        "The eigensolver failed on the input mesh, so nothing could be minimised. "
        "`killing_fields` on the same mesh and solver says why."
    )
    below_zero = (
        "λ·area came out below zero, which no surface has: it is lost in the rounding of nearly flat triangles. "
        "`jaxkvf check` names them; repair the mesh, or use float64."
    )
    not_confirmed = (
        "The minimiser arrived at a mesh that it takes for symmetric, but an eigensolve from scratch on that mesh finds "
        "λ·area above the tolerance, or fails. Pass another `minimiser` or `solver`."
    )


class Symmetrization(eqx.Module):
    """A symmetrized surface and the way to it."""

    mesh: TriangleMesh | None
    """None where edge lengths were optimised: see `lengths`."""
    lengths: Float[Array, " E"]
    """Edge lengths of the result."""
    unknowns: PyTree
    """θ of the result."""
    history: tuple[Step, ...]
    """The input first, then one entry an accepted step. λ·area of the target never rises."""
    result: OUTCOMES
    stats: dict[str, int]
    """`steps` of the minimiser, and how many of them were `accepted`."""
    state: State
    """To go on from: `symmetrize(mesh, …, resume=state)`; `state.save(path)`."""
