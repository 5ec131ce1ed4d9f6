"""Faces around some places bisected until their edges are short: the same surface, with vertices where a disk needs them."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..geometry import SurfacePoints
from ..mesh import TriangleMesh


class Refined(NamedTuple):
    """A mesh, and where its faces lie in those of a coarser one."""

    mesh: TriangleMesh
    owner: Int[np.ndarray, " G"]
    """The coarse face in which each face lies."""
    weights: Float[np.ndarray, "G 3 3"]
    """Barycentric coordinates in it, of each corner."""

    def in_coarse(self, points: SurfacePoints) -> SurfacePoints:
        """Points of the finer mesh as points of the coarser."""
        face, b = np.asarray(points.faces), np.asarray(points.barycentric, np.float64)
        weights = np.einsum("nc,ncd->nd", b, self.weights[face])
        return SurfacePoints(self.owner[face].astype(np.int32), weights.astype(self.mesh.vertices.dtype))


class _Pieces(NamedTuple):
    """Faces that lie in faces of another mesh."""

    vertices: Float[np.ndarray, "W 3"]
    faces: Int[np.ndarray, "G 3"]
    owner: Int[np.ndarray, " G"]
    """The face of the other mesh in which each lies."""
    weights: Float[np.ndarray, "G 3 3"]
    """Barycentric coordinates in it, of each corner."""


def refined(
    mesh: TriangleMesh, centers: Float[np.ndarray, "c 3"], radii: Float[np.ndarray, " c"], edge: float
) -> Refined:
    """The mesh with faces near some balls bisected until no side there is longer than `edge` of the ball's radius.

    By longest-edge bisection, neighbours included, which keeps angles away from 0. The old vertices come first.

    Reference: M.-C. Rivara, Algorithms for refining triangular grids suitable for adaptive and multigrid techniques (1984).
    """
    n = mesh.topology.n_faces
    whole = np.broadcast_to(np.eye(3), (n, 3, 3))
    pieces = _Pieces(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces), np.arange(n), whole)
    while (wanted := _too_long(pieces, centers, radii, edge)).any():
        pieces = _bisected(pieces, wanted)
    if len(pieces.faces) > n:
        mesh = TriangleMesh.from_arrays(pieces.vertices.astype(mesh.vertices.dtype), pieces.faces)
    return Refined(mesh, pieces.owner, pieces.weights)


def _sides(pieces: _Pieces) -> Float[np.ndarray, "G 3"]:
    """Lengths of the sides, each from a corner to the next."""
    corners = pieces.vertices[pieces.faces]
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)


def _too_long(
    pieces: _Pieces, centers: Float[np.ndarray, "c 3"], radii: Float[np.ndarray, " c"], edge: float
) -> Bool[np.ndarray, " G"]:
    """Faces that may meet a ball and have a side too long for it."""
    corners, longest = pieces.vertices[pieces.faces], _sides(pieces).max(axis=1)
    middle = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    wanted = np.zeros(len(longest), bool)
    for center, radius in zip(centers, radii, strict=True):
        near = np.linalg.norm(middle - center, axis=1) <= radius + reach
        wanted |= near & (longest > edge * radius)
    return wanted


def _bisected(pieces: _Pieces, wanted: Bool[np.ndarray, " G"]) -> _Pieces:
    """The longest sides of some faces cut in two, and of every face that has then a vertex on a side, its longest too."""
    faces, n = pieces.faces, len(pieces.vertices)
    first = _sides(pieces).argmax(axis=1)
    turn = (first[:, None] + np.arange(3)) % 3  # the longest side goes from corner 0 to corner 1
    faces = np.take_along_axis(faces, turn, axis=1)
    weights = np.take_along_axis(pieces.weights, turn[..., None], axis=1)
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, edge = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    edge = edge.reshape(-1, 3)
    cut = np.zeros(len(edges), bool)
    cut[edge[wanted, 0]] = True
    while True:
        also = edge[cut[edge].any(axis=1), 0]
        if cut[also].all():
            break
        cut[also] = True
    middle = np.full(len(edges), -1)
    middle[cut] = n + np.arange(cut.sum())
    vertices = np.vstack([pieces.vertices, pieces.vertices[edges[cut]].mean(axis=1)])

    # Corners 0…2, and the middles of sides 01, 12, 20 as 3…5.
    six = np.concatenate([faces, middle[edge]], axis=1)
    places = np.concatenate([weights, (weights + np.roll(weights, -1, axis=1)) / 2], axis=1)
    by_side = cut[edge]
    done: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for one, two, three, parts in (
        (False, False, False, ((0, 1, 2),)),
        (True, False, False, ((0, 3, 2), (3, 1, 2))),
        (True, True, False, ((0, 3, 2), (3, 1, 4), (3, 4, 2))),
        (True, False, True, ((3, 1, 2), (0, 3, 5), (3, 2, 5))),
        (True, True, True, ((0, 3, 5), (3, 2, 5), (3, 1, 4), (3, 4, 2))),
    ):
        which = np.flatnonzero((by_side == (one, two, three)).all(axis=1))
        for part in parts:
            chosen = list(part)
            done.append((six[which][:, chosen], pieces.owner[which], places[which][:, chosen]))
    return _Pieces(vertices, *(np.concatenate(part) for part in zip(*done, strict=True)))
