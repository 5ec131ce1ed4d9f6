"""Everything that is wrong with a mesh, listed: with counts, first offenders and remedies."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, Int

from . import _defects
from ._errors import MeshError
from ._io import read_raw
from ._triangle_mesh import TriangleMesh
from ._validation import face_array, name_first, vertex_array

MeshSource = TriangleMesh | str | os.PathLike[str] | tuple[Any, Any]

_THIN_ANGLE = 1.0  # degrees
_FAR = 1e6  # sizes from the origin: then half of float64's digits are left for the shape


@dataclass(frozen=True)
class Finding:
    """One kind of thing that was found."""

    kind: str
    """In the field's words: `"non-manifold edges"`."""
    count: int
    where: str
    """The first of them: `"faces 3, 8"`; empty where places make no sense."""
    first: tuple[int, ...]
    """The first indices, at most five, of faces, vertices or whatever `where` names."""
    remedy: str
    """What to do; the argument of `repair` where there is one."""

    def __str__(self) -> str:
        return f"{self.count} {self.kind}" + (f" ({self.where})" if self.where else "") + f": {self.remedy}"


@dataclass(frozen=True)
class MeshReport:
    """What `check` found."""

    n_vertices: int
    n_faces: int
    errors: tuple[Finding, ...]
    """What `TriangleMesh` refuses; empty if and only if `TriangleMesh.from_arrays` takes the mesh."""
    remarks: tuple[Finding, ...]
    """What it takes, but you may want to know; looked for once there are no errors."""

    @property
    def ok(self) -> bool:
        """Whether the mesh can be used as it is."""
        return not self.errors

    def __str__(self) -> str:
        verdict = "can be used as it is" if self.ok else "cannot be used as it is"
        lines = [f"{self.n_vertices} vertices, {self.n_faces} faces: {verdict}"]
        lines += [f"error: {finding}" for finding in self.errors]
        lines += [f"remark: {finding}" for finding in self.remarks]
        return "\n".join(lines)


def check(mesh: MeshSource) -> MeshReport:
    """Lists everything wrong with a mesh; changes nothing.

    Args:
        mesh: a `TriangleMesh`, the path of a file, or a pair of arrays `(vertices, faces)`.

    Raises:
        OSError: the file cannot be read. (Content that is no triangle mesh at all is an error in the report.)
    """
    try:
        vertices, faces = raw_arrays(mesh)
    except MeshError as error:
        unreadable = Finding("unreadable mesh", 1, "", (), str(error))
        return MeshReport(0, 0, (unreadable,), ())
    vertices = vertices.astype(jax.dtypes.canonicalize_dtype(vertices.dtype))  # as JAX will see them
    errors = _errors(vertices, faces)
    remarks = [] if errors else _remarks(vertices, faces)
    return MeshReport(len(vertices), len(faces), tuple(errors), tuple(remarks))


def raw_arrays(mesh: MeshSource) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
    """Vertices and faces of whatever a mesh may be given as, as they are.

    Raises:
        MeshError: not arrays of numbers of the right shape, or a file that is damaged.
        OSError: the file cannot be read.
    """
    if isinstance(mesh, TriangleMesh):
        vertices, faces = mesh.vertices, mesh.faces
    elif isinstance(mesh, tuple):
        vertices, faces = mesh
    else:
        vertices, faces = read_raw(mesh)
    return vertex_array(vertices), face_array(faces)


def _errors(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> list[Finding]:
    """What `TriangleMesh` refuses. What is no triangle at all is left out when its neighbours are looked at."""
    found: list[Finding] = []
    lost, outside = _defects.not_finite(vertices), _defects.out_of_range(faces, len(vertices))
    _add(found, "positions that are not finite", "vertex", lost, "repair(…, drop_invalid=True)")
    _add(found, "faces with a corner that is no vertex", "face", outside, "repair(…, drop_invalid=True)")
    invalid = np.union1d(outside, invalid_faces(vertices, faces))
    valid = np.setdiff1d(np.arange(len(faces)), invalid)
    repeated = valid[_defects.with_repeated_corner(faces[valid])]
    _add(found, "faces with a repeated corner", "face", repeated, "repair(…, drop_degenerate=True)")
    usable = np.setdiff1d(valid, repeated)
    flat = usable[_defects.flat_faces(vertices, faces[usable])]
    _add(found, "faces of zero area", "face", flat, "repair(…, drop_degenerate=True)")
    beyond = usable[_defects.beyond_range(vertices, faces[usable])]
    _add(found, "faces beyond the range of the dtype", "face", beyond, "rescale the mesh, or use float64")

    in_range = np.setdiff1d(np.arange(len(faces)), outside)
    unused = _defects.unreferenced(faces[in_range], len(vertices))
    _add(found, "unreferenced vertices", "vertex", unused, "repair(…, drop_unreferenced=True)")
    gluing = _defects.Gluing.of(faces[usable], len(vertices))
    _add(
        found,
        "edges of more than two faces",
        "vertex",
        gluing.crowded,
        "repair(…, split_nonmanifold=True)",
        lambda first: "between vertices " + ", ".join(f"{i}–{j}" for i, j in gluing.edges[first].tolist()),
    )
    _, owner = gluing.fans()
    pinched = np.flatnonzero(np.bincount(owner, minlength=len(vertices)) > 1)
    pinched = np.setdiff1d(pinched, gluing.edges[gluing.crowded])
    _add(found, "vertices where sheets touch", "vertex", pinched, "repair(…, split_nonmanifold=True)")
    turned, one_sided = gluing.flips()
    _add(
        found,
        "faces on one-sided pieces",
        "face",
        usable[one_sided],
        "no orientation exists; cut the surface open",
    )
    _add(
        found, "faces that look the other way", "face", usable[turned & ~one_sided], "repair(…, orient=True)"
    )
    return found


def invalid_faces(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, " n"]:
    """Faces with a corner that is no vertex, or one without a position."""
    outside = _defects.out_of_range(faces, len(vertices))
    bad = np.zeros(len(vertices), bool)
    bad[_defects.not_finite(vertices)] = True
    within = np.where((faces < 0) | (faces >= len(vertices)), 0, faces)
    return np.union1d(outside, np.flatnonzero(bad[within].any(axis=1)))


def _remarks(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> list[Finding]:
    found: list[Finding] = []
    gluing = _defects.Gluing.of(faces, len(vertices))
    first = _defects.coincident(vertices)
    _add(
        found,
        "vertices at the position of another",
        "vertex",
        np.flatnonzero(first != np.arange(len(vertices))),
        "repair(…, merge_duplicates=True) if seams should close",
    )
    again = _defects.repeated_faces(faces)
    _add(
        found,
        "faces over the same vertices as another",
        "face",
        again,
        "repair(…, drop_duplicate_faces=True)",
    )
    n_pieces, piece = gluing.face_components()
    if n_pieces > 1:
        sizes = np.sort(np.bincount(piece))[::-1]
        note = f"of {', '.join(map(str, sizes[:5]))}{' …' if n_pieces > 5 else ''} faces"
        found.append(
            Finding("components", n_pieces, note, (), "killing_fields(…, region=…) solves one alone")
        )
    boundary = np.flatnonzero(gluing.uses == 1)
    if boundary.size:
        ends = gluing.edges[boundary[:5]]
        where = "between vertices " + ", ".join(f"{i}–{j}" for i, j in ends.tolist())
        found.append(
            Finding(
                "boundary edges",
                len(boundary),
                where,
                tuple(ends[:, 0].tolist()),
                "left free, which is allowed",
            )
        )
    cotangents, angles = _corner_shapes(vertices, faces)
    thin = np.flatnonzero(angles.min(axis=1) < _THIN_ANGLE)
    smallest = float(angles.min())
    _add(
        found,
        f"faces with an angle below {_THIN_ANGLE:g}°",
        "face",
        thin,
        f"the smallest is {smallest:.2g}°; see intrinsic_delaunay, or remesh",
    )
    opposite = np.roll(cotangents, 1, axis=1).ravel()
    weight = np.bincount(gluing.halfedge_edges, opposite, minlength=len(gluing.edges))
    _add(
        found,
        "edges that are not Delaunay",
        "edge",
        np.flatnonzero(weight < -1e-8),
        '`dec` flips what can be flipped; `regge` does with discretization="regge-delaunay"',
        lambda first: "between vertices " + ", ".join(f"{i}–{j}" for i, j in gluing.edges[first].tolist()),
    )
    size, distance = np.ptp(vertices, axis=0).max(), np.abs(vertices).max()
    if distance > _FAR * size:
        remedy = f"at {distance:.2g} for a size of {size:.2g}; move it there before rounding"
        found.append(Finding("mesh far from the origin", 1, "", (), remedy))
    return found


def _corner_shapes(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> tuple[Float[np.ndarray, "F 3"], Float[np.ndarray, "F 3"]]:
    """Cotangent and angle (degrees) at each corner, from the embedding."""
    corner = vertices[faces].astype(np.float64)
    size = np.abs(corner - corner[:, :1]).max()
    after = (np.roll(corner, -1, axis=1) - corner) / size
    before = (np.roll(corner, 1, axis=1) - corner) / size
    cross = np.linalg.norm(np.cross(after, before), axis=2)
    dot = (after * before).sum(axis=2)
    return dot / cross, np.degrees(np.arctan2(cross, dot))


def _add(  # noqa: PLR0917
    found: list[Finding],
    kind: str,
    what: str,
    indices: Int[np.ndarray, " n"],
    remedy: str,
    where: Callable[[Int[np.ndarray, " n"]], str] | None = None,
) -> None:
    if not indices.size:
        return
    first = indices[:5]
    named = where(first) if where else name_first(what, indices)
    found.append(Finding(kind, len(indices), named, tuple(first.tolist()), remedy))
