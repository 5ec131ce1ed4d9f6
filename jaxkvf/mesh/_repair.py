"""Repair of raw meshes: only what is asked for, and an account of what was done."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arguments import Integer, Real, checked_integer, checked_not_negative
from . import _defects
from ._attributes import Attributes
from ._check import MeshReport, MeshSource, as_jax_sees, check, invalid_faces, piece_areas, raw_mesh
from ._errors import MeshError
from ._flat import Flattened, short_sides, without_flat_faces
from ._outward import inside_out
from ._polygons import triangulated
from ._raw import RawMesh
from ._triangle_mesh import TriangleMesh


@dataclass(frozen=True)
class Repair:
    """A repaired mesh as arrays, where its parts came from, and what was done."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    vertex_origins: Int[np.ndarray, " V"]
    """Vertex of the given mesh that each vertex was."""
    face_origins: Int[np.ndarray, " F"]
    """Face of the given mesh that each face was, or a part of."""
    corner_origins: Int[np.ndarray, "F 3"]
    """Corner of the given mesh, counted through all faces, that each corner was."""
    actions: tuple[str, ...]
    """What was done, in order, with counts; empty where nothing needed doing."""
    raw: RawMesh = field(repr=False)

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

    @property
    def attributes(self) -> Attributes:
        """Colours, scalars and texture coordinates of the given file, at the parts that are left."""
        return self.raw.attributes().gather(self.vertex_origins, self.face_origins, self.corner_origins)


def repair(
    mesh: MeshSource,
    *,
    triangulate: bool = False,
    drop_invalid: bool = False,
    merge_duplicates: bool | Real = False,
    drop_duplicate_faces: bool = False,
    drop_degenerate: bool = False,
    split_nonmanifold: bool = False,
    orient: bool = False,
    keep_largest: Integer = 0,
    drop_unreferenced: bool = False,
    to_origin: bool = False,
) -> Repair:
    """Mends what it is told to mend and nothing else, in the order of the arguments.

    What stays keeps its order and, but for `to_origin`, its position. `check` says which of these a mesh needs. Where a step
    leaves more pieces or more boundary than there was, the account says so.

    Args:
        mesh: a `TriangleMesh`, the path of a file, or a pair of arrays `(vertices, faces)`.
        triangulate: cut faces of more than three corners along diagonals: around one corner where that gives triangles that
            are not thin (as it does for convex faces), else ear by ear.
        drop_invalid: drop vertices whose position is not finite, their faces, and faces with a corner that is no vertex.
        merge_duplicates: True merges vertices at exactly equal positions into the first of them; a distance merges
            chains of vertices closer than it (closes gaps, and collapses smaller triangles).
        drop_duplicate_faces: of faces over the same three vertices keep the first.
        drop_degenerate: drop faces of fewer than three corners or with a repeated one. Of faces of zero area: merge the ends
            of a side without length; else hand the longest side to the neighbour, which is divided at the third corner, so
            that the surface stays closed and as it was; where that side is a boundary edge, drop the face.
        split_nonmanifold: cut along edges of more than two faces, and give each fan of faces around a vertex a copy of it.
        orient: turn faces over until neighbours agree, as most of each piece (by number of faces) look already, and closed
            pieces until they look outwards; in a piece around them, cavities inwards. One-sided pieces stay as they are.
        keep_largest: keep this many connected pieces, those of the largest area; 0 keeps all.
        drop_unreferenced: drop vertices of no face.
        to_origin: move the middle of the mesh's bounding box to the origin; the account says by how much.

    Raises:
        MeshError: a file that is damaged, arrays that are no triangles at all, or no face left.
        ValueError: a merging distance that is not finite or negative, or `keep_largest` no number of pieces.
        OSError: the file cannot be read.
    """
    exact = isinstance(merge_duplicates, bool | np.bool_)
    distance = 0.0 if exact else checked_not_negative("merge_duplicates", merge_duplicates)
    kept = checked_integer("keep_largest", keep_largest, at_least=0)
    work = _Work(raw_mesh(mesh), triangulate=triangulate)
    if drop_invalid:
        work.drop_invalid()
    if merge_duplicates or not exact:
        work.merge(distance)
    if drop_duplicate_faces:
        work.drop_faces("duplicate faces", _defects.repeated_faces(work.faces))
    if drop_degenerate:
        work.drop_degenerate()
    if split_nonmanifold:
        work.split()
    if orient:
        work.orient()
    if kept:
        work.keep_largest(kept)
    if drop_unreferenced:
        work.drop_unreferenced()
    if to_origin:
        work.move_to_origin()
    work.compare()
    return work.result()


class _Work:
    """The mesh under repair."""

    def __init__(self, raw: RawMesh, *, triangulate: bool) -> None:
        self.raw = raw
        self.vertices = raw.vertices
        large = np.flatnonzero(raw.polygons.sizes > 3)
        if large.size and not triangulate:
            _ = raw.triangles  # raises
        self.faces, self.corner_origins, self.face_origins = triangulated(raw.vertices, raw.polygons)
        self.vertex_origins = np.arange(len(raw.vertices))
        self.actions: list[str] = []
        self.before = self.loose()
        self.did("triangulated faces", len(large))

    def result(self) -> Repair:
        return Repair(
            self.vertices,
            self.faces,
            self.vertex_origins,
            self.face_origins,
            self.corner_origins,
            tuple(self.actions),
            self.raw,
        )

    def did(self, action: str, count: int | np.integer) -> None:
        if count:
            self.actions.append(f"{action}: {count}")

    def loose(self) -> tuple[int, int]:
        """Number of pieces, and of boundary edges, of those faces that are triangles of different vertices."""
        usable = np.delete(self.faces, invalid_faces(self.vertices, self.faces), axis=0)
        usable = np.delete(usable, _defects.with_repeated_corner(usable), axis=0)
        if not len(usable):
            return 0, 0
        gluing = _defects.Gluing.of(usable, len(self.vertices))
        return gluing.pieces()[0], int((gluing.uses == 1).sum())

    def compare(self) -> None:
        """Says where the surface fell apart or came open."""
        if not self.actions:
            return
        (pieces, boundary), (had_pieces, had_boundary) = self.loose(), self.before
        if pieces > had_pieces:
            self.actions.append(f"pieces now: {pieces}, before: {had_pieces}")
        if boundary > had_boundary:
            self.actions.append(f"boundary edges now: {boundary}, before: {had_boundary}")

    def drop_faces(self, kind: str, which: Int[np.ndarray, " n"]) -> None:
        keep = np.ones(len(self.faces), bool)
        keep[which] = False
        self.take(self.faces[keep], self.corner_origins[keep], self.face_origins[keep])
        self.did(f"dropped {kind}", len(which))
        if not len(self.faces):
            raise MeshError(f"no face is left after dropping {len(which)} {kind}")

    def take(
        self,
        faces: Int[np.ndarray, "F 3"],
        corner_origins: Int[np.ndarray, "F 3"],
        face_origins: Int[np.ndarray, " F"],
    ) -> None:
        self.faces, self.corner_origins, self.face_origins = faces, corner_origins, face_origins

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
        self.did("merged vertices", self.merge_into(kept))

    def merge_into(self, kept: Int[np.ndarray, " V"]) -> int:
        """Merges each vertex into the one named; returns how many went."""
        merged = np.flatnonzero(kept != np.arange(len(kept)))
        inside = (self.faces >= 0) & (self.faces < len(kept))
        self.faces = np.where(inside, kept[np.where(inside, self.faces, 0)], self.faces)
        self.drop_vertices(merged)
        return len(merged)

    def drop_degenerate(self) -> None:
        self.drop_repeated("faces with a repeated corner or fewer than three")
        collapsed = divided = dropped = stuck = 0
        while len(flat := self.flat()):
            pairs = short_sides(self.seen, self.faces[flat])
            if len(pairs):
                collapsed += self.merge_into(_defects.linked(pairs, len(self.vertices)))
                self.drop_repeated("", say=False)
                continue
            sound = np.setdiff1d(np.arange(len(self.faces)), invalid_faces(self.vertices, self.faces))
            done = without_flat_faces(self.seen, self.faces[sound])
            self.replace(sound, done)
            divided, dropped, stuck = divided + done.divided, dropped + done.dropped, stuck + done.stuck
        self.did("merged ends of sides without length", collapsed)
        self.did("flat faces, longest side handed to the neighbour", divided)
        self.did("dropped flat faces at the boundary", dropped - stuck)
        self.did("dropped flat faces that could not be divided", stuck)
        if not len(self.faces):
            raise MeshError(f"no face is left after dropping {len(self.raw.polygons.sizes)} degenerate faces")

    def drop_repeated(self, kind: str, *, say: bool = True) -> None:
        inside = np.setdiff1d(
            np.arange(len(self.faces)), _defects.out_of_range(self.faces, len(self.vertices))
        )
        repeated = inside[_defects.with_repeated_corner(self.faces[inside])]
        keep = np.delete(np.arange(len(self.faces)), repeated)
        self.take(self.faces[keep], self.corner_origins[keep], self.face_origins[keep])
        if say:
            self.did(f"dropped {kind}", len(repeated))

    @property
    def seen(self) -> np.ndarray:
        """Positions as `check` judges them."""
        return as_jax_sees(self.vertices)

    def flat(self) -> Int[np.ndarray, " n"]:
        """Faces of zero area, of three different vertices."""
        valid = np.setdiff1d(np.arange(len(self.faces)), invalid_faces(self.vertices, self.faces))
        return valid[_defects.flat_faces(self.seen, self.faces[valid])]

    def replace(self, which: Int[np.ndarray, " n"], by: Flattened) -> None:
        """These faces by others, which come from them; at the place of the first of them."""
        rest = np.setdiff1d(np.arange(len(self.faces)), which)
        came_from = np.concatenate([rest, which[by.face_origins]])
        order = np.argsort(came_from, kind="stable")
        corners = self.corner_origins[which].ravel()[by.corner_origins]
        self.take(
            np.concatenate([self.faces[rest], by.faces])[order],
            np.concatenate([self.corner_origins[rest], corners])[order],
            self.face_origins[came_from[order]],
        )

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
        self.turn(turned)
        self.did("turned faces over", turned.sum())
        if len(_defects.not_finite(self.vertices)):
            return
        inwards = inside_out(self.vertices, self.faces, _defects.Gluing.of(self.faces, len(self.vertices)))
        inwards &= ~one_sided
        self.turn(inwards)
        self.did("turned faces of inside-out pieces", inwards.sum())

    def turn(self, which: Bool[np.ndarray, " F"]) -> None:
        for name in ("faces", "corner_origins"):
            rows = getattr(self, name)
            setattr(self, name, np.where(which[:, None], rows[:, ::-1], rows))

    def keep_largest(self, count: int) -> None:
        """Pieces joined across edges; vertices that only the others used go with them."""
        self.need_corners("keep_largest")
        n_pieces, piece = _defects.Gluing.of(self.faces, len(self.vertices)).pieces()
        if n_pieces <= count:
            return
        areas = piece_areas(self.vertices, self.faces, piece, n_pieces)
        small = np.argsort(-areas, kind="stable")[count:]
        unused = _defects.unreferenced(self.faces, len(self.vertices))
        self.drop_faces("faces of smaller pieces", np.flatnonzero(np.isin(piece, small)))
        lost = _defects.unreferenced(self.faces, len(self.vertices))
        self.drop_vertices(np.setdiff1d(lost, unused))
        self.did("dropped pieces", len(small))

    def drop_unreferenced(self) -> None:
        self.need_corners("drop_unreferenced")
        unused = _defects.unreferenced(self.faces, len(self.vertices))
        self.drop_vertices(unused)
        self.did("dropped unreferenced vertices", len(unused))

    def move_to_origin(self) -> None:
        finite = self.vertices[np.isfinite(self.vertices).all(axis=1)]
        if not len(finite):
            return
        middle = finite.min(axis=0) / 2 + finite.max(axis=0) / 2
        if middle.any():
            self.vertices = self.vertices - middle
            self.actions.append(f"moved by {(-middle).tolist()}")

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
                raise MeshError(
                    f"{step} needs faces of three different vertices; add it: repair(…, {remedy}=True)"
                )
