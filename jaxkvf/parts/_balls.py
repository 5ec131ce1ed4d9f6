"""Geodesic balls around vertices, by distances along the edges. On the host."""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse.csgraph import connected_components, dijkstra

from ..mesh import Topology


class Balls:
    """The balls of a surface: where to centre them, and which faces are in them."""

    def __init__(self, lengths: Float[Array, " E"], topology: Topology) -> None:
        self.n_vertices = topology.n_vertices
        self._faces, self._sides = np.asarray(topology.faces), np.asarray(topology.face_edges)
        self._graph = _shortest_edges(np.asarray(topology.edges), np.asarray(lengths), self.n_vertices)

    def spread(
        self, count: int, allowed: Bool[np.ndarray, " V"] | None = None
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n V"]]:
        """Vertices among those allowed, each farthest from the ones before, and the distances from each."""
        graph = self._graph
        if allowed is not None:
            keep = sp.diags_array(allowed.astype(float))
            graph = sp.csr_array(keep @ graph @ keep)
            graph.eliminate_zeros()
        inside = np.ones(self.n_vertices, bool) if allowed is None else allowed
        chosen, distances = [int(np.argmax(inside))], []
        nearest = np.where(inside, np.inf, -1.0)
        while True:
            distances.append(dijkstra(graph, directed=False, indices=chosen[-1]))
            nearest = np.where(inside, np.minimum(nearest, distances[-1]), -1.0)
            if len(chosen) == count or nearest.max() <= 0:
                return np.array(chosen), np.array(distances)
            chosen.append(int(nearest.argmax()))

    def faces_within(self, inside: Bool[np.ndarray, " V"], centre: int | np.integer) -> Int[np.ndarray, " n"]:
        """Faces with all corners inside, of the piece (joined across edges) nearest the centre."""
        faces = np.flatnonzero(inside[self._faces].all(axis=1))
        if not faces.size:
            return faces
        rows = np.repeat(np.arange(len(faces)), 3)
        incidence = sp.csr_array((np.ones(rows.size), (rows, self._sides[faces].ravel())))
        _, piece = connected_components(incidence @ incidence.T, directed=False)
        at_centre = (self._faces[faces] == centre).any(axis=1)
        return faces[piece == (piece[at_centre][0] if at_centre.any() else np.bincount(piece).argmax())]

    def vertices_of(self, faces: Int[np.ndarray, " n"]) -> Bool[np.ndarray, " V"]:
        """Which vertices are corners of these faces."""
        inside = np.zeros(self.n_vertices, bool)
        inside[self._faces[faces]] = True
        return inside


def _shortest_edges(
    edges: Int[np.ndarray, "E 2"], lengths: Float[np.ndarray, " E"], n_vertices: int
) -> sp.csr_array:
    """Graph of the edges; of several between the same two vertices the shortest."""
    ends = np.sort(edges, axis=1)
    order = np.lexsort((lengths, ends[:, 1], ends[:, 0]))
    order = order[ends[order, 0] != ends[order, 1]]
    _, first = np.unique(ends[order], axis=0, return_index=True)
    kept = order[first]
    return sp.csr_array((lengths[kept], tuple(ends[kept].T)), shape=(n_vertices, n_vertices))
