"""What a symmetrization returns: the surface, the way to it, how it ended, and a state to go on from."""

import io
import os
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..files import write_whole
from ..mesh import TriangleMesh
from ._objective import Evaluation


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
        "The maximum number of evaluations was reached before λ·area fell to the tolerance. "
        "Raise `max_steps` or the tolerance, or go on from `.state` with `resume`."
    )
    eigensolver_failed = (
        "The eigensolver failed on the input mesh, so nothing could be minimised. "
        "`killing_fields` on the same mesh and solver says why."
    )


class Step(eqx.Module):
    """The surface after one accepted step."""

    evaluations: int
    """Evaluations of the objective so far, one eigensolve each."""
    dimensionless: Float[np.ndarray, " k"]
    """λ · area of the target's fields, and of two more: after the first step upper bounds, from approximate eigenvectors."""
    terms: Float[np.ndarray, " t"]
    """Price of each term of the objective."""
    rms_displacement: float
    """Root mean square displacement of the vertices from the input, in its mean edge lengths; NaN without positions."""
    smallest_angle: float
    """Smallest corner angle. Degrees."""


class State(eqx.Module):
    """Where a symmetrization stands: go on by `symmetrize(mesh, …, resume=state)`, the other arguments unchanged."""

    unknowns: PyTree
    minimiser_state: PyTree
    evaluation: Evaluation
    history: tuple[Step, ...]
    prepared_at: PyTree
    """The unknowns where the solver's preconditioner was made."""

    @property
    def evaluations(self) -> int:
        return self.history[-1].evaluations

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes all arrays to an NPZ file.

        Raises:
            OSError: the file cannot be written.
        """
        content = io.BytesIO()
        leaves = jax.tree.leaves(eqx.filter(self, eqx.is_array_like))
        arrays: dict[str, Any] = {f"leaf{i}": np.asarray(leaf) for i, leaf in enumerate(leaves)}
        np.savez(content, steps=len(self.history), **arrays)
        write_whole(path, content.getvalue())

    def load(self, path: str | os.PathLike[str]) -> "State":
        """The state in an NPZ file, of the same structure as this one but for the length of its history.

        Raises:
            OSError: the file cannot be read.
            ValueError: the file holds the state of another problem.
        """
        with np.load(Path(path)) as content:
            steps = int(content["steps"])
            like = eqx.tree_at(lambda s: s.history, self, self.history[:1] * steps)
            leaves, structure = jax.tree.flatten(eqx.filter(like, eqx.is_array_like))
            found = [content[f"leaf{i}"] for i in range(len(content.files) - 1)]
        if [np.shape(x) for x in leaves] != [np.shape(x) for x in found]:
            raise ValueError(
                f"{path} holds the state of another problem: resume with the arguments it was made with"
            )
        typed = [_like(x, y) for x, y in zip(leaves, found, strict=True)]
        return eqx.combine(jax.tree.unflatten(structure, typed), like)


def _like(known: Any, found: np.ndarray) -> Any:
    if isinstance(known, jax.Array):
        return jnp.asarray(found, known.dtype)
    return found if isinstance(known, np.ndarray) else type(known)(found)


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
    """Counts of `evaluations` of the objective and of accepted `steps`."""
    state: State
    """To go on from: `symmetrize(mesh, …, resume=state)`; `state.save(path)`."""
