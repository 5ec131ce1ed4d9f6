"""What can be wrong with raw vertices and faces, each as the indices of the offenders. NumPy, on the host."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ._errors import check_fits


def not_finite(vertices: Float[np.ndarray, "V 3"]) -> Int[np.ndarray, " n"]:
    """Vertices with a NaN or infinite coordinate."""
    return np.flatnonzero(~np.isfinite(vertices).all(axis=1))


def out_of_range(faces: Int[np.ndarray, "F 3"], n_vertices: int) -> Int[np.ndarray, " n"]:
    """Faces with a corner that is no vertex."""
    return np.flatnonzero(((faces < 0) | (faces >= n_vertices)).any(axis=1))


def with_repeated_corner(faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, " n"]:
    """Faces in which a vertex appears twice."""
    a, b, c = faces.T
    return np.flatnonzero((a == b) | (b == c) | (c == a))


def unreferenced(faces: Int[np.ndarray, "F 3"], n_vertices: int) -> Int[np.ndarray, " n"]:
    """Vertices of no face."""
    return np.flatnonzero(np.bincount(faces.ravel(), minlength=n_vertices) == 0)


def flat_faces(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, " n"]:
    """Faces whose height is lost in the rounding of their positions, at the dtype of `vertices`; all if they coincide."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    with np.errstate(over="ignore", under="ignore"):
        scale = np.abs(np.stack([b - a, c - b, a - c])).max(initial=0.0)
        if not (np.isfinite(scale) and scale > 0):
            return np.arange(len(faces))
        u, v, w = (b - a) / scale, (c - b) / scale, (a - c) / scale
        longest = np.sqrt(np.maximum.reduce([(u * u).sum(1), (v * v).sum(1), (w * w).sum(1)]))
        twice_area = np.linalg.norm(np.cross(u, -w), axis=1)
        return np.flatnonzero(~(twice_area > 8 * np.finfo(vertices.dtype).eps * longest * longest))


def beyond_range(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, " n"]:
    """Faces with a side whose square, of which areas are made, overflows or underflows the dtype of `vertices`."""
    corner = vertices[faces].astype(np.float64)
    with np.errstate(over="ignore", under="ignore", divide="ignore"):
        side = np.abs(corner - np.roll(corner, 1, axis=1)).max(axis=2)
        magnitude = np.abs(np.log2(side))  # zero lengths are another matter
    limit = np.finfo(vertices.dtype).maxexp / 2 - 8
    return np.flatnonzero(((magnitude > limit) & (side > 0)).any(axis=1))


def repeated_faces(faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, " n"]:
    """Faces over the same three vertices as an earlier one, in whatever order."""
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    later = np.ones(len(faces), bool)
    later[first] = False
    return np.flatnonzero(later)


def coincident(vertices: Float[np.ndarray, "V 3"], tolerance: float = 0.0) -> Int[np.ndarray, " V"]:
    """For each vertex the first one at its position; with a tolerance, the first of its chain of neighbours within it.

    Raises:
        MeshTooLargeError: the tolerance is so large that the pairs within it do not fit into memory.
    """
    if tolerance > 0:
        unit = 2.0 ** np.clip(
            np.floor(np.log2(tolerance)), -1021, 1021
        )  # squares of distances leave the range
        with np.errstate(over="ignore"):
            tree = KDTree(vertices.astype(np.float64) / unit)
        within = tolerance / unit
        check_fits(24 * int(tree.count_neighbors(tree, within)), f"merging vertices within {tolerance:g}")
        return linked(tree.query_pairs(within, output_type="ndarray"), len(vertices))
    _, group = np.unique(vertices, axis=0, return_inverse=True)
    return _first_of(group.ravel())


def linked(pairs: Int[np.ndarray, "n 2"], count: int) -> Int[np.ndarray, " count"]:
    """For each of `count` things the first that pairs link it to, over any number of others."""
    return _first_of(_components(pairs, count)[1])


def _first_of(group: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    first = np.full(len(group), len(group))
    np.minimum.at(first, group, np.arange(len(group)))
    return first[group]


class Gluing(NamedTuple):
    """Which sides of the faces share an edge; halfedge 3 f + c is side c of face f, as in `Topology`."""

    edges: Int[np.ndarray, "E 2"]
    """Ends, the smaller first, in lexicographic order."""
    halfedge_edges: Int[np.ndarray, " H"]
    forward: Bool[np.ndarray, " H"]
    """Whether each halfedge runs from the smaller end to the larger."""
    uses: Int[np.ndarray, " E"]
    """Number of faces on each edge."""

    @classmethod
    def of(cls, faces: Int[np.ndarray, "F 3"], n_vertices: int) -> "Gluing":
        tails = faces.ravel()
        heads = np.roll(faces, -1, axis=1).ravel()
        key = np.minimum(tails, heads).astype(np.int64) * n_vertices + np.maximum(tails, heads)
        keys, halfedge_edges = np.unique(key, return_inverse=True)
        edges = np.stack([keys // n_vertices, keys % n_vertices], axis=1).astype(np.int32)
        halfedge_edges = halfedge_edges.astype(np.int32).ravel()
        return cls(edges, halfedge_edges, tails < heads, np.bincount(halfedge_edges, minlength=len(edges)))

    @property
    def crowded(self) -> Int[np.ndarray, " n"]:
        """Edges of more than two faces."""
        return np.flatnonzero(self.uses > 2)

    @property
    def clashing(self) -> Int[np.ndarray, " n"]:
        """Edges that both their faces traverse in the same direction."""
        along = np.bincount(self.halfedge_edges, weights=self.forward, minlength=len(self.edges))
        return np.flatnonzero((self.uses == 2) & (along != 1))

    def faces_on(self, edge: int | np.integer) -> Int[np.ndarray, " n"]:
        return np.flatnonzero(self.halfedge_edges == edge) // 3

    def face_components(self) -> tuple[int, Int[np.ndarray, " F"]]:
        """Number of pieces joined across edges of two faces, and the piece of each face."""
        pairs = self._inner_pairs()
        return _components(pairs // 3, len(self.halfedge_edges) // 3)

    def pieces(self) -> tuple[int, Int[np.ndarray, " F"]]:
        """Number of pieces joined across edges of any number of faces, and the piece of each face."""
        order = np.argsort(self.halfedge_edges, kind="stable")
        same = np.flatnonzero(np.diff(self.halfedge_edges[order]) == 0)
        pairs = np.stack([order[same], order[same + 1]], axis=1) // 3
        return _components(pairs, len(self.halfedge_edges) // 3)

    def fans(self) -> tuple[Int[np.ndarray, " H"], Int[np.ndarray, " n"]]:
        """Fan of faces that each corner (by its halfedge) belongs to around its vertex, and the vertex of each fan."""
        pairs = self._inner_pairs()
        halfedge = np.arange(len(self.halfedge_edges))
        head = halfedge + np.where(halfedge % 3 == 2, -2, 1)
        low, high = np.where(self.forward, halfedge, head), np.where(self.forward, head, halfedge)
        count, fan = _components(np.concatenate([low[pairs], high[pairs]]), len(halfedge))
        tails = self.edges[self.halfedge_edges, np.where(self.forward, 0, 1)]
        owner = np.empty(count, np.int64)
        owner[fan] = tails
        return fan, owner

    def flips(self) -> tuple[Bool[np.ndarray, " F"], Bool[np.ndarray, " F"]]:
        """Faces to turn over so that neighbours agree (the fewer of each piece), and those of one-sided pieces.

        Two copies of every face, one turned over, are joined where they agree: the orientation double cover.
        """
        n_faces = len(self.halfedge_edges) // 3
        left, right = self._inner_pairs().T
        agree = self.forward[left] != self.forward[right]
        left, right = left // 3, right // 3
        pairs = [
            np.stack([left, np.where(agree, right, right + n_faces)], axis=1),
            np.stack([left + n_faces, np.where(agree, right + n_faces, right)], axis=1),
        ]
        _, cover = _components(np.concatenate(pairs), 2 * n_faces)
        front, back = cover[:n_faces], cover[n_faces:]
        turned = front > back
        count, piece = self.face_components()
        majority = np.bincount(piece, weights=np.where(turned, 1, -1), minlength=count) > 0
        return turned ^ majority[piece], front == back

    def _inner_pairs(self) -> Int[np.ndarray, "n 2"]:
        """The two halfedges of each edge that has two."""
        order = np.argsort(self.halfedge_edges, kind="stable")
        return order[self.uses[self.halfedge_edges[order]] == 2].reshape(-1, 2)


def _components(pairs: Int[np.ndarray, "n 2"], count: int) -> tuple[int, Int[np.ndarray, " count"]]:
    graph = coo_array((np.ones(len(pairs), bool), tuple(pairs.T)), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    return int(number), label
