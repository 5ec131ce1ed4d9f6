"""Flat faces leave a surface as it is: a side without length is collapsed, a longest side is handed to the neighbour."""

import heapq
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ._defects import flat_faces

_STEPS_A_FACE = 30  # chains of flat faces take a few; what turns in circles stops


class Flattened(NamedTuple):
    """Faces without the flat ones, and where their corners came from."""

    faces: Int[np.ndarray, "G 3"]
    corner_origins: Int[np.ndarray, "G 3"]
    """Corner of the given faces (3 f + c) that each corner was: in two faces where a side was divided."""
    face_origins: Int[np.ndarray, " G"]
    divided: int
    """Flat faces whose longest side was handed to its neighbours, divided at the third corner."""
    dropped: int
    """Flat faces whose longest side was a boundary edge, and those that nothing helped."""
    stuck: int
    """Of these, those that nothing helped: where they were, the surface is open."""


def short_sides(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, "n 2"]:
    """Ends of those sides of flat faces that are themselves lost in the rounding of the longest side, longest excepted."""
    corner = vertices[faces].astype(np.float64)
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        difference = np.roll(corner, -1, axis=1) - corner
        scale = np.abs(difference).max(initial=0.0)
        lengths = np.linalg.norm(difference / (scale if 0 < scale < np.inf else 1.0), axis=2)
    short = lengths <= 8 * np.finfo(vertices.dtype).eps * lengths.max(axis=1, initial=0.0, keepdims=True)
    return np.stack([faces[short], np.roll(faces, -1, axis=1)[short]], axis=1)


def without_flat_faces(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> Flattened:
    """Takes flat faces with sides of some length out of a surface, which keeps its vertices and its shape.

    A flat face is a longest side with the third corner on it. It goes, and the faces on the other side of that side are
    divided at this corner instead, as by flipping the side; where there are none, it lies at the boundary and just goes.
    Longest sides first: so chains of flat faces dissolve. Two faces that come to lie on one another, turned over, go both.
    Flat faces with a side without length stay, or come about where two such corners meet: see `short_sides`.
    """
    work = _Faces(vertices, faces)
    limit = _STEPS_A_FACE * len(work.waiting) + 100
    divided = dropped = 0
    while work.waiting and limit:
        limit -= 1
        face = work.pop()
        if face is not None:
            others = work.divide(face)
            divided += others > 0
            dropped += others == 0
    stuck = {face for _, face, row in work.waiting if work.rows.get(face) == row}
    for face in stuck:
        work.remove(face)
    rest = np.setdiff1d(np.arange(len(faces)), list(work.removed))
    new = [face for face in work.rows if face >= len(faces)]
    rows, corners = (
        np.array([of[face] for face in new], np.int64).reshape(-1, 3) for of in (work.rows, work.corners)
    )
    corner_origins = np.concatenate([3 * rest[:, None] + np.arange(3), corners])
    face_origins = np.concatenate([rest, np.array([work.origins[face] for face in new], np.int64)])
    order = np.argsort(face_origins, kind="stable")
    return Flattened(
        faces=np.concatenate([faces[rest], rows])[order],
        corner_origins=corner_origins[order],
        face_origins=face_origins[order],
        divided=divided,
        dropped=dropped + len(stuck),
        stuck=len(stuck),
    )


class _Faces:
    """The flat faces and all faces at their corners, by number; new faces get new numbers."""

    def __init__(self, vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> None:
        flat = flat_faces(vertices, faces)
        self.vertices = vertices
        at_flat = np.zeros(len(vertices), bool)
        at_flat[faces[flat]] = True
        self.next_number = len(faces)
        self.rows: dict[int, tuple[int, ...]] = {}
        self.corners: dict[int, tuple[int, ...]] = {}
        self.origins: dict[int, int] = {}
        self.on_edge: dict[frozenset[int], set[int]] = {}
        self.over: dict[frozenset[int], set[int]] = {}
        self.removed: set[int] = set()
        self.waiting: list[tuple[float, int, tuple[int, ...]]] = []
        for face in np.flatnonzero(at_flat[faces].any(axis=1)).tolist():
            self.add(face, tuple(faces[face].tolist()), (3 * face, 3 * face + 1, 3 * face + 2), face)
        for face in flat.tolist():
            self.wait(face)

    def add(self, face: int, row: tuple[int, ...], corners: tuple[int, ...], origin: int) -> None:
        self.rows[face], self.corners[face], self.origins[face] = row, corners, origin
        for i in range(3):
            self.on_edge.setdefault(frozenset((row[i], row[i - 1])), set()).add(face)
        self.over.setdefault(frozenset(row), set()).add(face)

    def remove(self, face: int) -> None:
        row = self.rows.pop(face)
        for i in range(3):
            self.on_edge[frozenset((row[i], row[i - 1]))].discard(face)
        self.over[frozenset(row)].discard(face)
        self.removed.add(face)

    def wait(self, face: int) -> None:
        """Queues a face if it is flat."""
        row = self.rows[face]
        as_array = np.array([row])
        if not flat_faces(self.vertices, as_array).size or len(short_sides(self.vertices, as_array)):
            return
        heapq.heappush(self.waiting, (-self.lengths(row)[self.longest(row)], face, row))

    def pop(self) -> int | None:
        """The flat face of the longest side, unless it is gone."""
        _, face, row = heapq.heappop(self.waiting)
        return face if self.rows.get(face) == row else None

    def lengths(self, row: tuple[int, ...]) -> list[float]:
        """Length of the side opposite each corner, in units of the first that is not 0."""
        x = self.vertices[list(row)].astype(np.float64)
        return [float(np.hypot(*(np.hypot(*d[:2]), d[2]))) for d in (x[1] - x[2], x[2] - x[0], x[0] - x[1])]

    def longest(self, row: tuple[int, ...]) -> int:
        lengths = self.lengths(row)
        return lengths.index(max(lengths))

    def divide(self, face: int) -> int:
        """Takes out a flat face and divides the others on its longest side; returns how many those were."""
        row, corners = self.rows[face], self.corners[face]
        apex = self.longest(row)
        middle, ends = row[apex], (row[apex - 1], row[apex - 2])
        others = [f for f in self.on_edge[frozenset(ends)] if f != face]
        self.remove(face)
        for other in others:
            other_row, other_corners, origin = self.rows[other], self.corners[other], self.origins[other]
            self.remove(other)
            if middle in other_row:  # both flat, one on the other
                continue
            for end in ends:
                at = other_row.index(end)
                new_row = (*other_row[:at], middle, *other_row[at + 1 :])
                new_corners = (*other_corners[:at], corners[apex], *other_corners[at + 1 :])
                self.put(new_row, new_corners, origin)
        return len(others)

    def put(self, row: tuple[int, ...], corners: tuple[int, ...], origin: int) -> None:
        """A new face, unless it lies on another that is turned over: then that goes too."""
        for other in self.over.get(frozenset(row), ()):
            turn = self.rows[other].index(row[0])
            if self.rows[other][turn - 1] == row[1]:
                self.remove(other)
                return
        number, self.next_number = self.next_number, self.next_number + 1
        self.add(number, row, corners, origin)
        self.wait(number)
