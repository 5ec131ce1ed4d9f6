"""Repair of raw meshes: only what is asked for, and an account of what was done."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from . import _defects
from ._check import MeshReport, MeshSource, check, invalid_faces, raw_arrays
from ._errors import MeshError
from ._triangle_mesh import TriangleMesh


@dataclass(frozen=True)
class Repair:
    """A repaired mesh as arrays, where its parts came from, and what was done."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    vertex_origins: Int[np.ndarray, " V"]
    """Vertex of the given mesh that each vertex was."""
    face_origins: Int[np.ndarray, " F"]
    """Face of the given mesh that each face was."""
    actions: tuple[str, ...]
    """What was done, in order, with counts; empty where nothing needed doing."""

    @property
    def mesh(self) -> TriangleMesh:
        """The repaired mesh.

        Raises:
            MeshError: something is still wrong with it; `.report` lists what.
        """
        return TriangleMesh.from_arrays(self.vertices, self.faces)

    @property
    def report(self) -> MeshReport:
        """What is left, by `check`."""
        return check((self.vertices, self.faces))


def repair(
    mesh: MeshSource,
    *,
    drop_invalid: bool = False,
    merge_duplicates: bool | float = False,
    drop_degenerate: bool = False,
    drop_duplicate_faces: bool = False,
    split_nonmanifold: bool = False,
    orient: bool = False,
    drop_unreferenced: bool = False,
) -> Repair:
    """Mends what it is told to mend and nothing else, in the order of the arguments.

    What stays keeps its order and its position. `check` says which of these a mesh needs; dropping a sliver between two
    others, or merging across a gap, can call for splitting or orienting after it.

    Args:
        mesh: a `TriangleMesh`, the path of a file, or a pair of arrays `(vertices, faces)`.
        drop_invalid: drop vertices whose position is not finite, their faces, and faces with a corner that is no vertex.
        merge_duplicates: True merges vertices at exactly equal positions into the first of them; a distance merges
            chains of vertices closer than it (closes gaps, and collapses smaller triangles).
        drop_degenerate: drop faces with a repeated corner or of zero area. Leaves a slit where one lay between others.
        drop_duplicate_faces: of faces over the same three vertices keep the first.
        split_nonmanifold: cut along edges of more than two faces, and give each fan of faces around a vertex a copy of it.
        orient: turn faces over until neighbours agree, as most of each piece (by number of faces) look already.
            One-sided pieces stay as they are.
        drop_unreferenced: drop vertices of no face.

    Raises:
        MeshError: a file that is damaged, arrays that are no triangles at all, or no face left.
        ValueError: a merging distance that is not finite or negative.
        OSError: the file cannot be read.
    """
    distance = float(merge_duplicates) if not isinstance(merge_duplicates, bool) else 0.0
    if not 0 <= distance < np.inf:
        raise ValueError(
            f"merge_duplicates must be True, False or a finite distance, got {merge_duplicates!r}"
        )
    work = _Work(*raw_arrays(mesh))
    if drop_invalid:
        work.drop_invalid()
    if merge_duplicates is not False:
        work.merge(distance)
    if drop_degenerate:
        work.drop_degenerate()
    if drop_duplicate_faces:
        work.drop_faces("duplicate faces", _defects.repeated_faces(work.faces))
    if split_nonmanifold:
        work.split()
    if orient:
        work.orient()
    if drop_unreferenced:
        work.drop_unreferenced()
    return Repair(work.vertices, work.faces, work.vertex_origins, work.face_origins, tuple(work.actions))


class _Work:
    """The mesh under repair."""

    def __init__(self, vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> None:
        self.vertices, self.faces = vertices, faces
        self.vertex_origins, self.face_origins = np.arange(len(vertices)), np.arange(len(faces))
        self.actions: list[str] = []

    def did(self, action: str, count: int | np.integer) -> None:
        if count:
            self.actions.append(f"{action}: {count}")

    def drop_faces(self, kind: str, which: Int[np.ndarray, " n"]) -> None:
        self.faces = np.delete(self.faces, which, axis=0)
        self.face_origins = np.delete(self.face_origins, which)
        self.did(f"dropped {kind}", len(which))
        if not len(self.faces):
            raise MeshError(f"no face is left after dropping {len(which)} {kind}")

    def drop_invalid(self) -> None:
        self.drop_faces("invalid faces", invalid_faces(self.vertices, self.faces))
        lost = _defects.not_finite(self.vertices)
        self.drop_vertices(lost)
        self.did("dropped vertices without a position", len(lost))

    def merge(self, distance: float) -> None:
        """Each vertex into the first at its place; those merged go."""
        finite = np.isfinite(self.vertices).all(axis=1)
        kept = np.arange(len(self.vertices))
        kept[finite] = kept[finite][_defects.coincident(self.vertices[finite], distance)]
        merged = np.flatnonzero(kept != np.arange(len(kept)))
        inside = (self.faces >= 0) & (self.faces < len(kept))
        self.faces = np.where(inside, kept[np.where(inside, self.faces, 0)], self.faces)
        self.drop_vertices(merged)
        self.did("merged vertices", len(merged))

    def drop_degenerate(self) -> None:
        valid = np.setdiff1d(np.arange(len(self.faces)), invalid_faces(self.vertices, self.faces))
        repeated = valid[_defects.with_repeated_corner(self.faces[valid])]
        rest = np.setdiff1d(valid, repeated)
        flat = rest[_defects.flat_faces(self.vertices, self.faces[rest])]
        self.drop_faces("degenerate faces", np.concatenate([repeated, flat]))

    def split(self) -> None:
        """A vertex for each fan: the fan of the lowest corner keeps it, copies follow after all vertices."""
        self.need_corners("split_nonmanifold")
        fan, owner = _defects.Gluing.of(self.faces, len(self.vertices)).fans()
        _, first_fan = np.unique(owner, return_index=True)
        vertex_of_fan = owner.copy()
        copies = np.setdiff1d(np.arange(len(owner)), first_fan)
        vertex_of_fan[copies] = len(self.vertices) + np.arange(len(copies))
        self.vertices = np.concatenate([self.vertices, self.vertices[owner[copies]]])
        self.vertex_origins = np.concatenate([self.vertex_origins, self.vertex_origins[owner[copies]]])
        self.faces = vertex_of_fan[fan].reshape(-1, 3)
        self.did("added vertices to split fans", len(copies))

    def orient(self) -> None:
        self.need_corners("orient")
        turned, one_sided = _defects.Gluing.of(self.faces, len(self.vertices)).flips()
        turned &= ~one_sided
        self.faces = np.where(turned[:, None], self.faces[:, ::-1], self.faces)
        self.did("turned faces over", turned.sum())

    def drop_unreferenced(self) -> None:
        self.need_corners("drop_unreferenced")
        unused = _defects.unreferenced(self.faces, len(self.vertices))
        self.drop_vertices(unused)
        self.did("dropped unreferenced vertices", len(unused))

    def drop_vertices(self, which: Int[np.ndarray, " n"]) -> None:
        """Vertices of no face; corners that are no vertex stay none."""
        keep = np.ones(len(self.vertices), bool)
        keep[which] = False
        number = np.cumsum(keep) - 1
        inside = (self.faces >= 0) & (self.faces < len(keep))
        self.faces = np.where(inside, number[np.where(inside, self.faces, 0)], -1)
        self.vertices, self.vertex_origins = self.vertices[keep], self.vertex_origins[keep]

    def need_corners(self, step: str) -> None:
        """Faces of three different vertices that exist."""
        outside = _defects.out_of_range(self.faces, len(self.vertices))
        repeated = _defects.with_repeated_corner(self.faces)
        for which, remedy in ((outside, "drop_invalid"), (repeated, "drop_degenerate")):
            if which.size:
                raise MeshError(f"{step} needs faces of three different vertices; add {remedy}=True")
