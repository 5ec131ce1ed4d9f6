"""The symmetry of pieces: geodesic balls, parts, components.

A shape without a symmetry may have parts with one. A piece is a set of faces with free boundary: the energy of `regge` is a
sum over faces, so the matrices of a piece are the sums over its own, in the frames of the whole surface (cone angles at the
rim of a piece stay rescaled as they are inside it). All on the intrinsic Delaunay triangulation, assembled once.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np
import scipy.linalg
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import LinearOperator, eigsh

from .eigen._factorization import default_factorization
from .fields import KillingFields
from .geometry import barycentric_vertex_areas, edge_lengths, face_areas, intrinsic_delaunay, transport_angles
from .killing import Regge
from .mesh import TriangleMesh


class LocalSymmetry(NamedTuple):
    """How symmetric the surface is around each place."""

    values: Float[np.ndarray, " V"]
    """Lowest λ · area of the balls around, at each vertex: near 0 in parts with a continuous symmetry. Dimensionless."""
    samples: Int[np.ndarray, " n"]
    """Vertices at the centres of the balls."""
    sample_values: Float[np.ndarray, " n"]
    """Lowest λ · area of each ball; infinite where a ball has no face."""


class SymmetricParts(NamedTuple):
    """A surface cut into parts that are nearly symmetric each, and a rest."""

    vertex_parts: Int[np.ndarray, " V"]
    """Number of the part of each vertex, in the order found; −1 in the rest."""
    values: Float[np.ndarray, " n"]
    """Lowest λ · area of each part. Dimensionless."""
    areas: Float[np.ndarray, " n"]
    """Unit: length²."""


def local_symmetry(mesh: TriangleMesh, radius: float | int, *, samples: int = 64) -> LocalSymmetry:
    """Lowest λ · area of geodesic balls of this radius, as a map over the surface.

    A handle or neck shows as a valley. So do flat places, which have three symmetries: choose a radius at which what you
    look for is closed around (about half the circumference of a handle, or more).

    Args:
        mesh: the surface.
        radius: of the balls, along edges of the intrinsic Delaunay triangulation. Unit: length.
        samples: number of balls, around vertices as far from each other as can be. Between them values are averaged with
            weights (1 − distance / radius)².

    Raises:
        ValueError: a radius or number of samples that is not positive.
    """
    _check_positive("radius", radius)
    _check_positive("samples", samples)
    surface = _Surface(mesh)
    chosen, distances = surface.spread(min(int(samples), surface.n_vertices))
    found = np.array(
        [surface.lowest(surface.faces_within(d <= radius, s)) for s, d in zip(chosen, distances, strict=True)]
    )
    weights = np.clip(1 - distances / radius, 0, None) ** 2 * np.isfinite(found)[:, None]
    nearest = distances.argmin(axis=0)
    total = weights.sum(axis=0)
    averaged = weights.T @ np.where(np.isfinite(found), found, 0.0) / np.where(total > 0, total, 1.0)
    return LocalSymmetry(np.where(total > 0, averaged, found[nearest]), chosen, found)


def symmetric_parts(
    mesh: TriangleMesh, tolerance: float | int, *, most: int = 8, samples: int = 32
) -> SymmetricParts:
    """Cuts off the largest piece with a nearly exact symmetry, then the largest of what is left, and so on. Greedy.

    Pieces are geodesic balls in what is left, grown by a fifth in radius at a time while their lowest λ · area stays
    within `tolerance`; the one of largest area is taken. The remedy that the paper names for its biggest limitation (§4).

    Args:
        mesh: the surface.
        tolerance: largest λ · area of a part. Dimensionless.
        most: number of parts at which to stop.
        samples: number of centres tried for each part.

    Raises:
        ValueError: a tolerance, `most` or `samples` that is not positive.
    """
    for name, value in (("tolerance", tolerance), ("most", most), ("samples", samples)):
        _check_positive(name, value)
    surface = _Surface(mesh)
    parts = np.full(surface.n_vertices, -1)
    values, areas = [], []
    smallest = surface.area / (20 * most)
    for number in range(int(most)):
        free = parts < 0
        best: tuple[float, float, np.ndarray] | None = None
        centres, distances = surface.spread(min(int(samples), int(free.sum())), free)
        for centre, distance in zip(centres, distances, strict=True):
            grown = surface.grow(centre, distance, tolerance, smallest if best is None else best[0])
            best = grown or best
        if best is None:
            break
        area, value, inside = best
        parts[inside] = number
        values.append(value)
        areas.append(area)
        if not (parts < 0).any():
            break
    return SymmetricParts(parts, np.array(values), np.array(areas))


def component_shares(mesh: TriangleMesh, fields: KillingFields) -> Float[np.ndarray, "k C"]:
    """Share of ∫|U|² of each field on each component of the mesh (numbered as by `mesh.topology.components`).

    1 where a field lives on one component alone; fields of equal eigenvalues on several may come mixed.
    """
    count, component = mesh.topology.components()
    areas = barycentric_vertex_areas(edge_lengths(mesh.vertices, mesh.topology), mesh.topology)
    density = np.asarray(areas) * (np.asarray(fields.vectors) ** 2).sum(axis=2)
    shares = np.stack([density[:, component == c].sum(axis=1) for c in range(count)], axis=1)
    return shares / shares.sum(axis=1, keepdims=True)


def _check_positive(name: str, value: float | int) -> None:
    if not 0 < value < np.inf:
        raise ValueError(f"{name} must be positive, got {value!r}")


class _Surface:
    """Factors of the matrices of `regge`, face by face, and distances along edges. On the host."""

    def __init__(self, mesh: TriangleMesh) -> None:
        found = intrinsic_delaunay(mesh)
        lengths, topology = found.lengths, found.topology
        operator = eqx.filter_jit(Regge().eigenproblem)(lengths, topology).A
        self.faces, self.edges, self.sides = (
            np.asarray(a) for a in (topology.faces, topology.edges, topology.face_edges)
        )
        self.n_vertices = topology.n_vertices
        self.areas = np.asarray(face_areas(lengths, topology))
        self.area = float(self.areas.sum())
        self.products = np.asarray(operator.side_products)  # pyright: ignore[reportAttributeAccessIssue]
        self.rates = np.asarray(operator.rate_coefficients)  # pyright: ignore[reportAttributeAccessIssue]
        self.turns = np.asarray(transport_angles(lengths, topology))
        self.graph = _shortest_edges(self.edges, np.asarray(lengths), self.n_vertices)

    def spread(
        self, count: int, allowed: Bool[np.ndarray, " V"] | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Vertices among those allowed, each farthest from the ones before, and the distances from each: [n], [n, V]."""
        graph = self.graph
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
        faces = np.flatnonzero(inside[self.faces].all(axis=1))
        if not faces.size:
            return faces
        rows = np.repeat(np.arange(len(faces)), 3)
        incidence = sp.csr_array((np.ones(rows.size), (rows, self.sides[faces].ravel())))
        _, piece = connected_components(incidence @ incidence.T, directed=False)
        at_centre = (self.faces[faces] == centre).any(axis=1)
        return faces[piece == (piece[at_centre][0] if at_centre.any() else np.bincount(piece).argmax())]

    def grow(
        self, centre: int | np.integer, distance: Float[np.ndarray, " V"], tolerance: float, more_than: float
    ) -> tuple[float, float, Bool[np.ndarray, " V"]] | None:
        """Area, λ · area and vertices of the largest ball within tolerance, if its area is more than `more_than`."""
        radius, farthest = np.sqrt(more_than / np.pi), distance[np.isfinite(distance)].max()
        best = None
        while True:
            faces = self.faces_within(distance <= radius, centre)
            area = float(self.areas[faces].sum())
            if area > more_than:
                value = self.lowest(faces)
                if value > tolerance:
                    return best
                inside = np.zeros(self.n_vertices, bool)
                inside[self.faces[faces]] = True
                best = area, value, inside
            if radius > farthest:
                return best
            radius *= 1.2

    def lowest(self, faces: Int[np.ndarray, " n"]) -> float:
        """Smallest λ · area of the piece made of these faces."""
        if not faces.size:
            return np.inf
        A, B = self.matrices(faces)
        area, size = float(self.areas[faces].sum()), A.diagonal().size
        if size <= 300:
            values = scipy.linalg.eigh(A.toarray(), B.toarray(), eigvals_only=True, subset_by_index=[0, 0])
            return float(values[0]) * area
        solve = default_factorization().factorize(sp.csc_array(A + B / area))
        assert solve is not None  # A is positive semi-definite, B positive definite
        inverse = LinearOperator((size, size), matvec=solve, dtype=np.float64)  # pyright: ignore[reportCallIssue]
        start = np.random.default_rng(0).standard_normal(size)
        values = eigsh(A, 1, M=B, sigma=-1 / area, OPinv=inverse, v0=start, return_eigenvectors=False)
        return float(values[0]) * area

    def matrices(self, faces: Int[np.ndarray, " n"]) -> tuple[sp.csr_array, sp.csr_array]:
        """A and B of the piece on its own vertices: sums over its faces."""
        corners = self.faces[faces]
        used, local = np.unique(corners, return_inverse=True)
        number = np.zeros(self.n_vertices, np.int64)
        number[used] = np.arange(len(used))
        edge = self.sides[faces].ravel()
        ends = 2 * number[self.edges[edge]]
        columns = np.stack([ends[:, 0], ends[:, 0] + 1, ends[:, 1], ends[:, 1] + 1], axis=1)
        rows = np.repeat(np.arange(len(edge)), 4)
        size = 2 * len(used)
        rate = sp.csr_array((self.rates[edge].ravel(), (rows, columns.ravel())), shape=(len(edge), size))
        starts = np.arange(len(faces) + 1)
        products = sp.bsr_array((self.products[faces], starts[:-1], starts), shape=(len(edge), len(edge)))
        A = sp.csr_array(rate.T @ (products @ rate))

        area = self.areas[faces]
        diagonal = 0.25 * np.bincount(local.ravel(), np.repeat(area, 3), len(used))
        cos, sin = np.cos(self.turns[edge]), np.sin(self.turns[edge])
        blocks = (np.repeat(area, 3) / 24)[:, None] * np.stack([cos, sin, -sin, cos], axis=1)
        tails = np.stack([ends[:, 0], ends[:, 0], ends[:, 0] + 1, ends[:, 0] + 1], axis=1)
        heads = np.stack([ends[:, 1], ends[:, 1] + 1, ends[:, 1], ends[:, 1] + 1], axis=1)
        upper = sp.csr_array((blocks.ravel(), (tails.ravel(), heads.ravel())), shape=(size, size))
        return A, sp.csr_array(upper + upper.T + sp.diags_array(np.repeat(diagonal, 2)))


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
