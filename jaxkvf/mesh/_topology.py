"""Connectivity of an oriented manifold triangle mesh, built once on the host."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ._defects import Gluing
from ._errors import MeshError
from ._validation import check_edges_manifold, checked_faces, name_first


class Topology(eqx.Module):
    """Edges, incidences and counter-clockwise one-rings of an oriented manifold triangle mesh.

    Halfedge `3 f + c` runs along face `f` from its corner `c` to corner `c + 1`; the *corner* of the same number is the
    one it starts at. A *spoke* is an edge seen from one of its ends: the spokes of a vertex are stored in counter-clockwise
    order, starting on the boundary where there is one.

    Built from the faces of a mesh, edges run from their smaller to their larger vertex. In an intrinsic triangulation, whose
    edges are geodesics, several may join the same two vertices, or a vertex to itself; nothing here tells edges apart by
    their ends, and neither should its users.

    All arrays are int32; the module is a pytree, so it crosses `jit` and `vmap` as data. Build it with `from_faces`.
    """

    faces: Int[Array, "F 3"]
    """Corners of each face, counter-clockwise."""
    edges: Int[Array, "E 2"]
    """Tail and head of each edge. Built from faces: tail < head, in lexicographic order."""
    face_edges: Int[Array, "F 3"]
    """Edge under each halfedge of a face."""
    face_edge_signs: Int[Array, "F 3"]
    """+1 where the halfedge runs along its edge, −1 where against it."""
    edge_halfedges: Int[Array, "E 2"]
    """Halfedge along and halfedge against each edge; −1 where there is none (a boundary edge has one)."""
    spoke_starts: Int[Array, " starts"]
    """Spokes of vertex v: `spoke_starts[v] : spoke_starts[v + 1]`."""
    spoke_edges: Int[Array, " S"]
    spoke_neighbours: Int[Array, " S"]
    """Vertex at the far end of each spoke."""
    spoke_corners: Int[Array, " S"]
    """Corner between this spoke and the next counter-clockwise; −1 behind the last spoke of a boundary vertex."""
    edge_spokes: Int[Array, "E 2"]
    """Spoke of each edge at its tail and at its head."""

    @classmethod
    def from_faces(cls, faces: object, n_vertices: int | None = None) -> "Topology":
        """Topology of `faces` `[F, 3]` (any integer array), vectorised, in O(F log F).

        Args:
            faces: corner indices of each face, counter-clockwise seen from outside, counted from 0.
            n_vertices: number of vertices; by default one more than the largest index.

        Raises:
            MeshError: wrong shape or dtype, empty, index out of range, repeated vertex in a face, unreferenced vertex,
                non-manifold edge or vertex, inconsistent or impossible orientation. The message names the first offenders.
        """
        array = np.asarray(faces)
        if n_vertices is None:
            n_vertices = int(array.max()) + 1 if array.size and np.issubdtype(array.dtype, np.integer) else 0
        return cls(*(jnp.asarray(part) for part in _build(checked_faces(array, n_vertices), n_vertices)))

    @classmethod
    def from_gluing(
        cls,
        faces: Int[np.ndarray, "F 3"],
        halfedge_edges: Int[np.ndarray, " H"],
        forward: Bool[np.ndarray, " H"],
        n_vertices: int,
    ) -> "Topology":
        """Topology of triangles glued along numbered edges, of which several may join the same two vertices.

        Args:
            faces: corners of each face, counter-clockwise.
            halfedge_edges: edge under each halfedge, numbered from 0 without gaps.
            forward: whether each halfedge runs along its edge; the two halfedges of an inner edge differ.
            n_vertices: number of vertices.

        Raises:
            MeshError: the faces around a vertex do not form one fan.
        """
        return cls(*(jnp.asarray(part) for part in assemble(faces, halfedge_edges, forward, n_vertices)))

    @property
    def n_vertices(self) -> int:
        return self.spoke_starts.shape[0] - 1

    @property
    def n_edges(self) -> int:
        return self.edges.shape[0]

    @property
    def n_faces(self) -> int:
        return self.faces.shape[0]

    @property
    def euler_characteristic(self) -> int:
        """V − E + F, summed over components."""
        return self.n_vertices - self.n_edges + self.n_faces

    @property
    def edge_faces(self) -> Int[Array, "E 2"]:
        """Face on the left and on the right of each edge; −1 where there is none."""
        return jnp.where(self.edge_halfedges < 0, -1, self.edge_halfedges // 3)

    @property
    def is_boundary_edge(self) -> Bool[Array, " E"]:
        return (self.edge_halfedges < 0).any(axis=1)

    @property
    def is_boundary_vertex(self) -> Bool[Array, " V"]:
        return self.spoke_corners[self.spoke_starts[1:] - 1] < 0

    @property
    def vertex_degrees(self) -> Int[Array, " V"]:
        """Number of edges at each vertex."""
        return jnp.diff(self.spoke_starts)

    @property
    def spoke_vertices(self) -> Int[Array, " S"]:
        """Vertex that owns each spoke."""
        vertices = jnp.arange(self.n_vertices, dtype=self.spoke_starts.dtype)
        return jnp.repeat(vertices, self.vertex_degrees, total_repeat_length=2 * self.n_edges)

    @property
    def is_tail_spoke(self) -> Bool[Array, " S"]:
        """Whether each spoke leaves the tail of its edge, rather than the head."""
        spoke = jnp.arange(2 * self.n_edges, dtype=self.edge_spokes.dtype)
        return self.edge_spokes[self.spoke_edges, 0] == spoke

    def vertex_rings(self) -> Int[np.ndarray, "V D"]:
        """Neighbours of each vertex counter-clockwise, padded with −1 to the largest degree D. On the host."""
        starts, neighbours = np.asarray(self.spoke_starts), np.asarray(self.spoke_neighbours)
        slot = np.arange(np.diff(starts).max())
        position = starts[:-1, None] + slot
        inside = position < starts[1:, None]
        return np.where(inside, neighbours[np.minimum(position, len(neighbours) - 1)], -1)

    def components(self) -> tuple[int, Int[np.ndarray, " V"]]:
        """Number of connected components, and the component of each vertex. On the host."""
        return _connected(np.asarray(self.edges), self.n_vertices)

    def boundary_loops(self) -> tuple[int, Int[np.ndarray, " V"]]:
        """Number of boundary loops, and the loop of each vertex, −1 inside. On the host."""
        edges = np.asarray(self.edges)[np.asarray(self.is_boundary_edge)]
        on_boundary = np.asarray(self.is_boundary_vertex)
        _, label = _connected(edges, self.n_vertices)
        loops, numbered = np.unique(label[on_boundary], return_inverse=True)
        loop = np.full(self.n_vertices, -1, np.int32)
        loop[on_boundary] = numbered
        return len(loops), loop

    def genus(self) -> Int[np.ndarray, " C"]:
        """Genus of each component, boundary loops filled with disks: (2 − χ − b)/2. On the host."""
        count, label = self.components()
        _, loop = self.boundary_loops()
        euler = np.bincount(label, minlength=count)
        euler = euler - np.bincount(label[np.asarray(self.edges)[:, 0]], minlength=count)
        euler = euler + np.bincount(label[np.asarray(self.faces)[:, 0]], minlength=count)
        _, one_vertex_a_loop = np.unique(np.where(loop < 0, -1, loop), return_index=True)
        one_vertex_a_loop = one_vertex_a_loop[loop[one_vertex_a_loop] >= 0]
        loops = np.bincount(label[one_vertex_a_loop], minlength=count)
        return (2 - euler - loops) // 2


class TopologyArrays(NamedTuple):
    """The fields of `Topology`, in their order, as NumPy arrays."""

    faces: np.ndarray
    edges: np.ndarray
    face_edges: np.ndarray
    face_edge_signs: np.ndarray
    edge_halfedges: np.ndarray
    spoke_starts: np.ndarray
    spoke_edges: np.ndarray
    spoke_neighbours: np.ndarray
    spoke_corners: np.ndarray
    edge_spokes: np.ndarray


def _build(faces: Int[np.ndarray, "F 3"], n_vertices: int) -> TopologyArrays:
    gluing = Gluing.of(faces, n_vertices)
    check_edges_manifold(gluing)
    return assemble(faces, gluing.halfedge_edges, gluing.forward, n_vertices)


def assemble(
    faces: Int[np.ndarray, "F 3"],
    halfedge_edges: Int[np.ndarray, " H"],
    forward: Bool[np.ndarray, " H"],
    n_vertices: int,
) -> TopologyArrays:
    """The arrays of `Topology.from_gluing`."""
    tails = faces.ravel()
    heads = np.roll(faces, -1, axis=1).ravel()
    n_edges = int(halfedge_edges.max()) + 1
    edge_halfedges = np.full((n_edges, 2), -1, np.int32)
    edge_halfedges[halfedge_edges, np.where(forward, 0, 1)] = np.arange(len(tails), dtype=np.int32)
    edges = np.empty((n_edges, 2), np.int32)
    edges[halfedge_edges, np.where(forward, 0, 1)] = tails
    edges[halfedge_edges, np.where(forward, 1, 0)] = heads

    spokes = _sort_spokes(tails, halfedge_edges, forward, edge_halfedges, n_vertices)
    starts, spoke_edges, spoke_ends, spoke_corners = spokes
    edge_spokes = np.empty((n_edges, 2), np.int32)
    edge_spokes[spoke_edges, spoke_ends] = np.arange(2 * n_edges, dtype=np.int32)
    return TopologyArrays(
        faces=faces,
        edges=edges,
        face_edges=halfedge_edges.reshape(-1, 3),
        face_edge_signs=np.where(forward, 1, -1).astype(np.int32).reshape(-1, 3),
        edge_halfedges=edge_halfedges,
        spoke_starts=starts,
        spoke_edges=spoke_edges,
        spoke_neighbours=edges[spoke_edges, 1 - spoke_ends],
        spoke_corners=spoke_corners,
        edge_spokes=edge_spokes,
    )


def _sort_spokes(
    tails: Int[np.ndarray, " H"],
    halfedge_edges: Int[np.ndarray, " H"],
    forward: Bool[np.ndarray, " H"],
    edge_halfedges: Int[np.ndarray, "E 2"],
    n_vertices: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Starts, edges, ends and corners of the spokes, counter-clockwise around each vertex.

    All rings are walked at once, one spoke a step: as many steps as the largest degree, each over the rings not yet
    finished, so the work is linear in the number of halfedges.
    """
    halfedge = np.arange(len(tails), dtype=np.int32)
    previous = halfedge + np.where(halfedge % 3 == 0, 2, -1).astype(np.int32)
    # The opposite of a halfedge lies in its edge's other column.
    twin = edge_halfedges[halfedge_edges, np.where(forward, 1, 0)]
    next_around = twin[previous]  # the spoke after this one, −1 where the boundary comes first

    first = np.full(n_vertices, len(tails), np.int32)
    np.minimum.at(first, tails, halfedge)
    on_boundary = twin < 0  # an outgoing halfedge with nothing on its right starts a boundary vertex's fan
    first[tails[on_boundary]] = halfedge[on_boundary]

    open_fans = np.bincount(tails[on_boundary], minlength=n_vertices)
    if (open_fans > 1).any():
        _raise_non_manifold_vertices(np.flatnonzero(open_fans > 1))
    corners = np.bincount(tails, minlength=n_vertices)
    starts = np.concatenate([[0], np.cumsum(corners + open_fans)]).astype(np.int32)

    n_spokes = 2 * len(edge_halfedges)
    spoke_edges = np.full(n_spokes, -1, np.int32)
    spoke_ends = np.zeros(n_spokes, np.int32)
    spoke_corners = np.full(n_spokes, -1, np.int32)
    ring = np.arange(n_vertices)  # the vertices whose ring is still being walked
    here, step = first, 0
    visited = np.zeros(n_vertices, np.int64)
    while ring.size:
        slot = starts[ring] + step
        spoke_edges[slot] = halfedge_edges[here]
        spoke_ends[slot] = np.where(forward[here], 0, 1)
        spoke_corners[slot] = here
        visited[ring] += 1
        following = next_around[here]
        ended = following < 0
        last = previous[here[ended]]  # the incoming halfedge that closes a boundary fan
        end_slot = slot[ended] + 1
        spoke_edges[end_slot] = halfedge_edges[last]
        spoke_ends[end_slot] = np.where(forward[last], 1, 0)
        going = ~ended & (following != first[ring])
        ring, here, step = ring[going], following[going], step + 1
    split = np.flatnonzero(visited != corners)
    if split.size:
        _raise_non_manifold_vertices(split)
    return starts, spoke_edges, spoke_ends, spoke_corners


def _raise_non_manifold_vertices(vertices: Int[np.ndarray, " n"]) -> None:
    raise MeshError(
        f"non-manifold {name_first('vertex', vertices)}: its faces do not form one fan (two sheets touch in a point); "
        "split such vertices into one copy a fan"
    )


def _connected(edges: Int[np.ndarray, "E 2"], n_vertices: int) -> tuple[int, Int[np.ndarray, " V"]]:
    graph = coo_array((np.ones(len(edges), np.int8), tuple(edges.T)), shape=(n_vertices, n_vertices))
    count, label = connected_components(graph, directed=False)
    return int(count), label.astype(np.int32)
