"""Intrinsic Delaunay flips on the host: connectivity, lengths and polar angles, all edges of a round at once.

Reference: M. Fisher, B. Springborn, P. Schröder, A. Bobenko, An Algorithm for the Construction of Intrinsic Delaunay
Triangulations (2007); N. Sharp, Y. Soliman, K. Crane, Navigating Intrinsic Triangulations (2019) for the signposts.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ._topology import TopologyArrays, assemble


class DelaunayFlips(NamedTuple):
    """The flips that make a triangulation Delaunay, in an order in which they can be repeated."""

    topology: TopologyArrays
    """Connectivity after all flips. Edges and faces keep their number."""
    frame_rotations: Float[np.ndarray, " V"]
    """Angle of each vertex's first spoke after the flips, in its polar frame before them. Radians."""
    diamonds: Int[np.ndarray, "n 5"]
    """Each flip's edge e = ij and the edges ik, jk on its left and il, jl on its right, in order of `levels`."""
    levels: Int[np.ndarray, " n"]
    """Ascending from 0; flips of one level touch different faces, and depend on those of lower levels only."""
    complete: bool
    """False where the flips were stopped at `most`."""


def delaunay_flips(
    topology: TopologyArrays,
    lengths: Float[np.ndarray, " E"],
    tolerance: float,
    most: int,
    least_degree: int = 0,
) -> DelaunayFlips:
    """Flips edges until cot α + cot β ≥ −tolerance for the angles opposite each inner edge.

    Each round flips an independent set: the edges that violate this most in both their faces. Boundary edges, edges with
    one face on both sides, and edges whose flip rounding would not improve (or whose faces have NaN areas) stay. So does an
    edge that would leave an inner vertex with fewer than `least_degree` others, loops not counted.
    """
    surface = _Surface(topology, lengths, least_degree)
    waiting = np.flatnonzero((topology.edge_halfedges >= 0).all(axis=1))
    waiting, violations = surface.violating(waiting, tolerance)
    if waiting.size:
        surface.place_signposts(topology)
    level_of_face = np.zeros(len(topology.faces), np.int64)
    diamonds, levels, flipped = [], [], 0
    while waiting.size and flipped <= most:
        now = surface.independent(waiting, violations)
        if not now.any():
            break
        chosen = waiting[now]
        left, right = surface.halfedges[chosen].T // 3
        level = np.maximum(level_of_face[left], level_of_face[right])
        level_of_face[left] = level_of_face[right] = level + 1
        diamond = surface.flip(chosen)
        diamonds.append(diamond)
        levels.append(level)
        flipped += len(chosen)
        around = diamond[:, 1:].ravel()
        around = around[(surface.halfedges[around] >= 0).all(axis=1)]
        waiting, violations = surface.violating(np.union1d(waiting[~now], around), tolerance)
    if not levels:
        nothing = np.empty(0, np.int64)
        unturned = np.zeros(len(topology.spoke_starts) - 1)
        return DelaunayFlips(topology, unturned, np.empty((0, 5), np.int32), nothing, complete=True)
    levels = np.concatenate(levels)
    order = np.argsort(levels, kind="stable")
    after = surface.assembled(len(topology.spoke_starts) - 1)
    return DelaunayFlips(
        topology=after,
        frame_rotations=surface.first_spoke_angles(after),
        diamonds=np.concatenate(diamonds)[order],
        levels=levels[order],
        complete=flipped <= most,
    )


class _Surface:
    """A triangulation that is being flipped; halfedge 3 f + c is side c of face f, as in `Topology`."""

    def __init__(self, topology: TopologyArrays, lengths: Float[np.ndarray, " E"], least_degree: int) -> None:
        self.faces = topology.faces.copy()
        self.sides = topology.face_edges.copy()
        self.forward = topology.face_edge_signs > 0
        self.halfedges = topology.edge_halfedges.copy()
        self.lengths = np.array(lengths, np.float64)
        self.cone_scales, self.end_angles = np.empty(0), np.empty((0, 2))
        tails, heads = topology.edges.T
        self.least_degree = least_degree
        self.on_boundary = topology.spoke_corners[topology.spoke_starts[1:] - 1] < 0
        self.spokes = np.bincount(topology.edges[tails != heads].ravel(), minlength=len(self.on_boundary))

    def place_signposts(self, topology: TopologyArrays) -> None:
        """Before the first flip: the angle of each edge at its ends, kept up to date from then on."""
        self.cone_scales, self.end_angles = polar_angles(topology, self.lengths)

    def violating(
        self, edges: Int[np.ndarray, " m"], tolerance: float
    ) -> tuple[Int[np.ndarray, " v"], Float[np.ndarray, " v"]]:
        """Those of `edges` that are not Delaunay and can be flipped, and −(cot α + cot β) of each."""
        left, right = self._triangles(edges)
        (base, jk, ik), (_, il, jl) = left, right
        cot_left, cot_right = _cotangent(ik, jk, base), _cotangent(il, jl, base)
        with np.errstate(invalid="ignore"):
            violation = -(cot_left + cot_right)
            bad = violation > tolerance
        halfedges = self.halfedges[edges]
        bad &= halfedges[:, 0] // 3 != halfedges[:, 1] // 3
        edges, violation = edges[bad], violation[bad]
        base, ik, jk, il, jl = (side[bad] for side in (base, ik, jk, il, jl))
        diagonal = _flipped_lengths(base, ik, jk, il, jl)
        with np.errstate(invalid="ignore"):
            # The sum of all cotangents falls with each true flip (Musin's harmonic index): so rounding cannot cycle.
            before = _cotangent_sum(base, ik, jk) + _cotangent_sum(base, il, jl)
            after = _cotangent_sum(diagonal, ik, il) + _cotangent_sum(diagonal, jk, jl)
            better = after < before
        return edges[better], violation[better]

    def independent(
        self, edges: Int[np.ndarray, " v"], violations: Float[np.ndarray, " v"]
    ) -> Bool[np.ndarray, " v"]:
        """The edges that violate most in both their faces and at each end that can spare but one: no two share a face."""
        ends = self._ends(edges)
        unbound = self.on_boundary if self.least_degree else np.ones_like(self.on_boundary)
        spare = np.where(unbound, len(self.lengths), self.spokes - self.least_degree)
        may = ((spare[ends] > 0) | (ends[:, 0] == ends[:, 1])[:, None]).all(axis=1)
        rank = np.empty(len(edges), np.int64)
        rank[np.lexsort((edges, violations, may))] = np.arange(len(edges))
        left, right = self.halfedges[edges].T // 3
        best = np.full(len(self.faces), -1, np.int64)
        np.maximum.at(best, left[may], rank[may])
        np.maximum.at(best, right[may], rank[may])
        chosen = may & (best[left] == rank) & (best[right] == rank)
        losses = np.bincount(ends[chosen & (ends[:, 0] != ends[:, 1])].ravel(), minlength=len(spare))
        scarce = losses > spare
        at_vertex = np.full(len(spare), -1, np.int64)
        for end in ends[chosen].T:
            np.maximum.at(at_vertex, end, rank[chosen])
        return chosen & (~scarce[ends] | (at_vertex[ends] == rank[:, None])).all(axis=1)

    def _ends(self, edges: Int[np.ndarray, " n"]) -> Int[np.ndarray, "n 2"]:
        """Tail and head of inner edges."""
        along, against = self.halfedges[edges].T
        return np.stack([self.faces.ravel()[along], self.faces.ravel()[against]], axis=1)

    def flip(self, edges: Int[np.ndarray, " n"]) -> Int[np.ndarray, "n 5"]:
        """Flips `edges`, no two of which share a face; returns their diamonds.

        Edge ij with k on its left and l on its right: faces ijk, jil become kil, ljk, and the edge runs from k to l.
        """
        along, against = self.halfedges[edges].T
        f, g = along // 3, against // 3
        jk, ki = _next(along), _next(_next(along))
        il, lj = _next(against), _next(_next(against))
        i, j, k, l = (self.faces.ravel()[h] for h in (along, jk, ki, lj))  # noqa: E741
        outer = np.stack([ki, il, lj, jk])
        side, forward = self.sides.ravel()[outer], self.forward.ravel()[outer]
        end = np.where(forward, 0, 1)
        angle_ki, angle_lj = self.end_angles[side[0], end[0]], self.end_angles[side[2], end[2]]
        diamond = np.stack([edges, side[0], side[3], side[1], side[2]], axis=1).astype(np.int32)

        base, length_ik, length_jk, length_il, length_jl = self.lengths[diamond].T
        diagonal = _flipped_lengths(base, length_ik, length_jk, length_il, length_jl)
        self.lengths[edges] = diagonal
        for ends, change in (((i, j), -1), ((k, l), 1)):
            apart = ends[0] != ends[1]
            for vertex in ends:
                np.add.at(self.spokes, vertex[apart], change)
        self.faces[f] = np.stack([k, i, l], axis=1)
        self.faces[g] = np.stack([l, j, k], axis=1)
        self.sides[f] = np.stack([side[0], side[1], edges], axis=1)
        self.sides[g] = np.stack([side[2], side[3], edges], axis=1)
        never, always = np.zeros(len(edges), bool), np.ones(len(edges), bool)
        self.forward[f] = np.stack([forward[0], forward[1], never], axis=1)
        self.forward[g] = np.stack([forward[2], forward[3], always], axis=1)
        for number, halfedge in enumerate((3 * f, 3 * f + 1, 3 * g, 3 * g + 1)):
            self.halfedges[side[number], end[number]] = halfedge
        self.halfedges[edges] = np.stack([3 * g + 2, 3 * f + 2], axis=1)
        self.end_angles[edges, 0] = angle_ki + _angle(length_il, length_ik, diagonal)
        self.end_angles[edges, 1] = angle_lj + _angle(length_jk, length_jl, diagonal)
        return diamond

    def assembled(self, n_vertices: int) -> TopologyArrays:
        return assemble(self.faces, self.sides.ravel(), self.forward.ravel(), n_vertices)

    def first_spoke_angles(self, after: TopologyArrays) -> Float[np.ndarray, " V"]:
        """Polar angle of the first spokes of `after` in the frames of the surface as it was given."""
        first = after.spoke_starts[:-1]
        edge = after.spoke_edges[first]
        end = np.where(after.edge_spokes[edge, 0] == first, 0, 1)
        return self.cone_scales * self.end_angles[edge, end]

    def _triangles(self, edges: Int[np.ndarray, " m"]) -> tuple[np.ndarray, np.ndarray]:
        """Lengths of the three sides of the faces on the left and right of each edge, the edge itself first: [3, m]."""
        left, right = (
            np.stack([self.lengths[self.sides.ravel()[side]] for side in (h, _next(h), _next(_next(h)))])
            for h in self.halfedges[edges].T
        )
        return left, right


def _next(halfedge: np.ndarray) -> np.ndarray:
    """The halfedge after this one around its face."""
    return np.where(halfedge % 3 == 2, halfedge - 2, halfedge + 1)


def _areas(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Area of triangles as `geometry.triangle_areas` has it: Kahan's formula, NaN for broken triangle inequalities."""
    a, b = np.maximum(a, b), np.minimum(a, b)
    b, c = np.maximum(b, c), np.minimum(b, c)
    a, b = np.maximum(a, b), np.minimum(a, b)
    rounding = np.finfo(np.float64).eps * a
    excess = c - (a - b)
    excess = np.where((excess < 2 * rounding) & (excess > -4 * rounding), 2 * rounding, excess)
    with np.errstate(invalid="ignore"):
        return 0.25 * np.sqrt((a + (b + c)) * (a + (b - c))) * np.sqrt((c + (a - b)) * excess)


def _twice_dot(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """b² + c² − a²: twice the dot product of the sides b and c, which enclose the angle opposite a."""
    longer, shorter = np.maximum(b, c), np.minimum(b, c)
    return (longer - a) * (longer + a) + shorter * shorter


def _cotangent(b: np.ndarray, c: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Cotangent of the angle opposite a."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return _twice_dot(a, b, c) / (4 * _areas(a, b, c))


def _cotangent_sum(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Sum of the three cotangents: (a² + b² + c²) / (4 area)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return (a * a + b * b + c * c) / (4 * _areas(a, b, c))


def _angle(opposite: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    return np.arctan2(4 * _areas(opposite, b, c), _twice_dot(opposite, b, c))


def _flipped_lengths(
    e: np.ndarray, ik: np.ndarray, jk: np.ndarray, il: np.ndarray, jl: np.ndarray
) -> np.ndarray:
    """Length of kl in the quadrilateral i l j k with diagonal e = ij: both triangles laid out along ij."""
    with np.errstate(invalid="ignore", divide="ignore"):
        x = ((ik - jk) * (ik + jk) - (il - jl) * (il + jl)) / (2 * e)
        y = 2 * (_areas(e, ik, jk) + _areas(e, il, jl)) / e
        return np.hypot(x, y)


def polar_angles(
    topology: TopologyArrays, lengths: Float[np.ndarray, " E"]
) -> tuple[Float[np.ndarray, " V"], Float[np.ndarray, "E 2"]]:
    """2π / cone angle of each vertex (1 on the boundary), and the angle of each edge at its tail and head, not rescaled."""
    side = lengths[topology.face_edges]
    turn = _angle(np.roll(side, -1, axis=1), side, np.roll(side, 1, axis=1)).ravel()
    corner, starts = topology.spoke_corners, topology.spoke_starts
    turn = np.where(corner < 0, 0.0, turn[corner])
    degree = np.diff(starts)
    total = np.add.reduceat(turn, starts[:-1])
    mean = total / degree
    running = np.concatenate([[0.0], np.cumsum(turn - np.repeat(mean, degree))])[:-1]
    position = np.arange(len(turn)) - np.repeat(starts[:-1], degree)
    angle = running - np.repeat(running[starts[:-1]], degree) + position * np.repeat(mean, degree)
    on_boundary = corner[starts[1:] - 1] < 0
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(on_boundary, 1.0, 2 * np.pi / total)
    return scale, angle[topology.edge_spokes]
