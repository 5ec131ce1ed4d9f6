"""Where a symmetrization stands, in memory and in a file, and whether it belongs to the problem at hand."""

import hashlib
import io
import json
import os
import re
import zipfile
import zlib
from collections.abc import Sequence
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

_FORMAT = "jaxkvf symmetrization 1"
_GROUPS = ("unknowns", "minimiser_arrays", "accepted", "evaluation", "prepared_at", "steps", "rejections")
_UNREADABLE = (zipfile.BadZipFile, zlib.error, EOFError, KeyError, TypeError, ValueError)
_SHOWN = 200  # characters of an argument in an error


class Step(eqx.Module):
    """The surface after one accepted step."""

    steps: int
    """Steps of the minimiser so far, accepted or not; L-BFGS solves one eigenproblem in each."""
    dimensionless: Float[np.ndarray, " k"]
    """λ · area of the target's fields, and of two more: after the first step upper bounds, from approximate eigenvectors."""
    terms: Float[np.ndarray, " t"]
    """Price of each term of the objective."""
    rms_displacement: float
    """Root mean square displacement of the vertices from the input, in its mean edge lengths; NaN without positions."""
    smallest_angle: float
    """Smallest corner angle. Degrees."""


class State(eqx.Module):
    """Where a symmetrization stands: go on by `symmetrize(mesh, …, resume=state)`, or with the file it was saved to.

    Arrays, numbers and text only, so that it can be pickled, copied and sent to other processes.
    """

    unknowns: PyTree
    """Where the minimiser is."""
    minimiser_arrays: tuple[Array, ...]
    """What the minimiser remembers."""
    accepted: PyTree
    """The unknowns at the last accepted step: those of the result."""
    evaluation: Evaluation
    """The objective there."""
    prepared_at: PyTree
    """The unknowns where the solver's preconditioner was made."""
    history: tuple[Step, ...]
    steps: int
    rejections: int
    """Steps since the last accepted one."""
    problem: tuple[tuple[str, str], ...] = eqx.field(static=True)
    """What it is a state of: name and description, or fingerprint, of each argument that matters."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes an NPZ file, for `symmetrize(mesh, …, resume=path)`.

        Raises:
            OSError: the file cannot be written.
        """
        content = io.BytesIO()
        arrays = {
            f"{group}.{i}": np.asarray(leaf)
            for group in _GROUPS
            for i, leaf in enumerate(jax.tree.leaves(getattr(self, group)))
        }
        for column in Step.__dataclass_fields__:
            arrays[f"history.{column}"] = np.stack([getattr(step, column) for step in self.history])
        arrays |= {"format": np.asarray(_FORMAT), "problem": np.asarray(json.dumps(self.problem))}
        np.savez(content, **arrays)  # pyright: ignore[reportArgumentType]
        write_whole(path, content.getvalue())


def resumed(source: object, problem: tuple[tuple[str, str], ...], unknowns: PyTree, theta: PyTree) -> State:
    """The state to go on from, given itself or by its file.

    Args:
        source: a `State` or a path.
        problem: the one at hand, of `problem_of`.
        unknowns: of the structure of `State.unknowns`.
        theta: the start.

    Raises:
        OSError: the file cannot be read.
        TypeError: `source` is neither.
        ValueError: the file is not a whole state, or the state is of another problem; the message says what differs.
    """
    if isinstance(source, State):
        _check_same(source.problem, problem, "the state")
        return source
    if not isinstance(source, str | os.PathLike):
        raise TypeError(
            f"resume must be the `.state` of a symmetrization or the file it was saved to, got a {type(source).__name__}"
        )
    path = Path(source)
    try:
        content = _arrays_in(path)
        theirs = [(str(name), str(value)) for name, value in json.loads(str(content["problem"]))]
    except _UNREADABLE as error:
        raise ValueError(_damaged(path)) from error
    _check_same(theirs, problem, str(path))
    try:
        return _restored(content, problem, unknowns, theta)
    except _UNREADABLE as error:
        raise ValueError(_damaged(path)) from error


def _restored(
    content: dict[str, np.ndarray], problem: tuple[tuple[str, str], ...], unknowns: PyTree, theta: PyTree
) -> State:
    def leaves(group: str) -> list[Array]:
        count = sum(name.startswith(f"{group}.") for name in content)
        return [jnp.asarray(content[f"{group}.{i}"]) for i in range(count)]

    def like_start(group: str) -> PyTree:
        found = jax.tree.unflatten(jax.tree.structure(theta), leaves(group))
        if jax.tree.map(jnp.shape, found) != jax.tree.map(jnp.shape, theta):
            raise ValueError("other shapes")
        return found

    columns = [content[f"history.{column}"] for column in Step.__dataclass_fields__]
    return State(
        unknowns=jax.tree.unflatten(jax.tree.structure(unknowns), leaves("unknowns")),
        minimiser_arrays=tuple(leaves("minimiser_arrays")),
        accepted=like_start("accepted"),
        evaluation=Evaluation(*leaves("evaluation")),
        prepared_at=like_start("prepared_at"),
        history=tuple(
            Step(int(steps), dimensionless, terms, float(rms), float(angle))
            for steps, dimensionless, terms, rms, angle in zip(*columns, strict=True)
        ),
        steps=int(content["steps.0"]),
        rejections=int(content["rejections.0"]),
        problem=problem,
    )


def problem_of(mesh: TriangleMesh, **arguments: object) -> tuple[tuple[str, str], ...]:
    """For `State.problem`."""
    return (
        ("precision", str(mesh.vertices.dtype)),
        ("faces", _fingerprint([mesh.faces])),
        ("positions", _fingerprint([mesh.vertices])),
        *((name, _described(argument)) for name, argument in arguments.items()),
    )


def _check_same(theirs: Sequence[tuple[str, str]], ours: Sequence[tuple[str, str]], what: str) -> None:
    then, now = dict(theirs), dict(ours)
    different = [name for name in now if then.get(name) != now[name]]
    if different:
        told = [
            f"{name} ({then[name]} then, {now[name]} now)"
            if name in then and " " not in name and _can_be_shown(then[name], now[name])
            else name
            for name in different
        ]
        raise ValueError(
            f"{what} belongs to another problem, which differs in {', '.join(told)}: resume with the mesh and the arguments "
            "it was made with, or start anew without `resume`"
        )


def _can_be_shown(*descriptions: str) -> bool:
    return all(
        len(description) <= _SHOWN and not re.fullmatch("[0-9a-f]{64}", description)
        for description in descriptions
    )


def _arrays_in(path: Path) -> dict[str, np.ndarray]:
    # From memory: NumPy leaves a file open that is not an archive.
    with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as content:
        if not isinstance(content, np.lib.npyio.NpzFile) or str(content["format"]) != _FORMAT:
            raise ValueError("another format")
        return {name: content[name] for name in content.files}


def _damaged(path: Path) -> str:
    return (
        f"{path} is not the whole state of a symmetrization: it is another kind of file, or damaged, or was written by "
        "another version; start anew without `resume`"
    )


def _described(argument: object) -> str:
    """The same in every process."""
    shown = eqx.tree_pformat(argument, width=10**6, short_arrays=True)
    shown = re.sub(r" at 0x[0-9a-f]+", "", shown)
    arrays = jax.tree.leaves(eqx.filter(argument, eqx.is_array))
    return f"{shown} {_fingerprint(arrays)[:16]}" if arrays else shown


def _fingerprint(arrays: Sequence[Any]) -> str:
    digest = hashlib.sha256()
    for array in map(np.asarray, arrays):
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
