"""The paper's discretization: the Killing operator on 1-forms, by discrete exterior calculus.

    ∫‖KU‖² = 2 ∫ (|dω|² + 2(δω)² − 2k|ω|²)  [+ 4 ∮ ⟨∇_T ω, ω^⊥⟩ on a boundary]      (8), (12)

Reference: Ben-Chen, Butscher, Solomon, Guibas, On Discrete Killing Vector Fields and Patterns on Surfaces (2010), §3.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
from jaxtyping import Array, Bool, DTypeLike, Float

from ..eigen import GeneralizedEigenproblem
from ..exterior import curl_curl, d1, flat_operator, sharp, sharp_operator
from ..geometry import (
    IntrinsicDelaunay,
    angle_defects,
    barycentric_vertex_areas,
    circumcentric_vertex_areas,
    corner_cotangents,
    cotan_weights,
    intrinsic_delaunay,
    rotations,
)
from ..mesh import Topology
from ..sparse import RowSparseOperator, TransposedRowSparseOperator
from ._discretization import AbstractDiscretization
from ._free_boundary import free_boundary, tangential_boundary_term


class Dec(AbstractDiscretization):
    """One-forms on the edges of the intrinsic Delaunay triangulation: second order, not positive semi-definite.

    A = 2R, R = d₁ᵀ⋆₂d₁ + 2⋆₁d₀⋆₀⁻¹d₀ᵀ⋆₁ − 2(curvature) [+ boundary], B = ⋆₁. (The paper's Rω = λBω has half these
    eigenvalues.) λ₀ may be slightly negative, so this discretization is never to be minimised.

    *Curvature.* ∫k|ω|² is Σ_i k_i |u_i|² with the angle defects k_i, a measure that converges, and the vector u_i = ω^♯ at
    the vertex, fitted with weights ⋆₁ (`"vertex"`, the default). The paper shares it out to the edges as ωᵀ⋆₁Gω,
    G_ij = ½(k_i/⋆₀_i + k_j/⋆₀_j) (`"edge"`): there defect over area stands for a pointwise curvature, to which it does not
    converge on irregular meshes, so that eigenvalues stall at about 1 %, and are far off across creases. A defect beyond
    π/2 in one vertex counts as π/2 (nothing balances more, and eigenvalues would run off to −∞), and as 0 at an inner
    vertex on a spike so sharp that flips stop there.

    *Boundary.* `"natural"` leaves it free, with the whole of eq. (12); `"tangential"` has fields run along it, ω(n) = 0,
    which leaves −k_g a² of eq. (12). Flat Killing fields are exact in the former, to rounding.

    *Where ⋆₁ is not positive.* B = ⋆₁ must be, so unknowns live on the intrinsic Delaunay triangulation (`triangulation`).
    Its inner edges have ⋆₁ ≥ 0; a boundary edge opposite an obtuse angle has ⋆₁ < 0 and cannot be flipped, nor can an edge
    at the tip of a spike, whose flip would leave a vertex with fewer than three edges. In its faces, and where obtuse faces
    follow behind, B gets s_f (dω)_f² with s_f = |cot α cot β cot γ|, twice what makes the face's part positive: of the order
    of h² beside ∫|ω|². On a triangulation that is not Delaunay negative ⋆₁ of inner edges stay, and the eigensolver then
    reports an indefinite B.

    *Where ⋆₁ is zero.* Two faces inscribed in one circle, of which regular grids are full, give their common edge no mass.
    Its row of A x = λ B x is then (d₁ᵀ⋆₂d₁ω)_e = 0: the curl is the same in both faces, which act as one
    polygon, and the eigenproblem on the other unknowns is well posed. To keep B definite, weights within
    `negligible_weight` of zero count as that weight in B (not in A). This lowers eigenvalues by a fraction of about that
    size, 5e-7 in float64, far less than their error; derivatives are those of ⋆₁ itself.
    """

    delaunay: bool = eqx.field(static=True, default=True)
    """False for the triangulation as it is, for meshes that are Delaunay or to see what it does."""
    flip_capacity: int = eqx.field(static=True, default=1)
    """Room for edge flips, see `intrinsic_delaunay`."""
    curvature: str = eqx.field(static=True, default="vertex")
    """`"vertex"` or `"edge"`, as in the paper."""
    boundary: str = eqx.field(static=True, default="natural")
    """`"natural"` or `"tangential"`."""

    def __check_init__(self) -> None:
        for name, known in (("curvature", ("vertex", "edge")), ("boundary", ("natural", "tangential"))):
            if getattr(self, name) not in known:
                raise ValueError(f"{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}")

    def triangulation(self, lengths: Float[Array, " E"], topology: Topology) -> IntrinsicDelaunay:
        """The triangulation whose edges carry the unknowns."""
        if self.delaunay:
            return intrinsic_delaunay(lengths, topology, capacity=self.flip_capacity, least_degree=3)
        unturned = jnp.zeros(topology.n_vertices, lengths.dtype)
        return IntrinsicDelaunay(lengths, topology, unturned, jnp.zeros((), jnp.int32))

    def eigenproblem(self, lengths: Float[Array, " E"], topology: Topology) -> GeneralizedEigenproblem:
        surface = self.triangulation(lengths, topology)
        lengths, topology = surface.lengths, surface.topology
        return GeneralizedEigenproblem(_stiffness(self, lengths, topology), _mass(lengths, topology))

    def to_vertex_vectors(
        self, coefficients: Float[Array, " n"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, "V 2"]:
        surface = self.triangulation(lengths, topology)
        vectors = sharp(coefficients, surface.lengths, surface.topology)
        return jnp.einsum("vij,vj->vi", rotations(surface.frame_rotations), vectors)

    def from_vertex_vectors(
        self, vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, " n"]:
        return self.vertex_vector_operator(lengths, topology).mv(vectors.ravel())

    def vertex_vector_operator(self, lengths: Float[Array, " E"], topology: Topology) -> RowSparseOperator:
        """`from_vertex_vectors` as an operator: component c of the vector at vertex v is unknown number 2 v + c."""
        surface = self.triangulation(lengths, topology)
        flat = flat_operator(surface.lengths, surface.topology)
        turn = rotations(surface.frame_rotations)[surface.topology.edges]
        turned = jnp.einsum("evji,evi->evj", turn, flat.values.reshape(-1, 2, 2))
        return RowSparseOperator(flat.columns, turned.reshape(-1, 4), flat.n_columns)

    def energy(
        self, coefficients: Float[Array, " n"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, ""]:
        surface = self.triangulation(lengths, topology)
        return coefficients @ _stiffness(self, surface.lengths, surface.topology).mv(coefficients)


@eqx.filter_jit
def _stiffness(dec: Dec, lengths: Float[Array, " E"], topology: Topology) -> lx.AbstractLinearOperator:
    dtype, edges = lengths.dtype, topology.edges
    weights = cotan_weights(lengths, topology)
    vectors = _vertex_vectors(lengths, topology)
    at_ends = vectors.of.values.reshape(-1, 2, 2)
    divergence = weights[:, None] * jnp.asarray([[-1.0, 1.0]], dtype)  # ⋆₁d₀
    at_vertices = jnp.zeros((topology.n_vertices, 2, 2), dtype)
    if dec.curvature == "vertex":
        defects = jnp.minimum(angle_defects(lengths, topology), _LARGEST_DEFECT)
        defects = jnp.where(_is_tip(lengths, topology), 0.0, defects)
        at_vertices = defects[:, None, None] * jnp.eye(2, dtype=dtype)[None]
    if dec.boundary == "natural":
        free = free_boundary(vectors, lengths, topology)
        divergence = divergence + jnp.einsum("evc,evc->ev", at_ends, free.half_lengths_inward[edges])
        at_vertices = at_vertices - free.turns
        rest = -2 * (free.rises + free.rises.T)
    else:
        rest = tangential_boundary_term(lengths, topology)
    if dec.curvature == "edge":
        rest = rest - 4 * _edge_curvature(lengths, topology)
    divergence = RowSparseOperator(edges, divergence, topology.n_vertices)
    per_area = lx.DiagonalLinearOperator(1 / _dual_areas(lengths, topology))
    turned = jnp.einsum("evc,evcd->evd", at_ends, at_vertices[edges]).reshape(-1, 4)
    local = RowSparseOperator(vectors.of.columns, turned, 2 * topology.n_vertices) @ vectors
    A = 2 * curl_curl(lengths, topology) + 4 * (divergence @ per_area @ divergence.T) - 4 * local + rest
    return lx.TaggedLinearOperator(A, lx.symmetric_tag)


def _is_stuck(lengths: Float[Array, " E"], topology: Topology) -> Bool[Array, " E"]:
    """Edges of negative weight that do not flip since an inner end has but three: at the tip of a spike."""
    few = (topology.vertex_degrees <= 3) & ~topology.is_boundary_vertex
    inner = ~topology.is_boundary_edge & few[topology.edges].any(axis=1)
    return inner & (cotan_weights(lengths, topology) < -negligible_weight(lengths.dtype))


def _is_tip(lengths: Float[Array, " E"], topology: Topology) -> Bool[Array, " V"]:
    """Vertices on which flips got stuck."""
    stuck = jnp.broadcast_to(_is_stuck(lengths, topology)[:, None], topology.edges.shape)
    return jnp.zeros(topology.n_vertices, bool).at[topology.edges].max(stuck) & (topology.vertex_degrees <= 3)


_LARGEST_DEFECT = np.pi / 2
_LEAST_SHARE = 0.1  # circumcentric over barycentric area: below it only beside obtuse angles on a boundary


def _dual_areas(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " V"]:
    """⋆₀, circumcentric; at least a tenth of the barycentric area, since it may be negative beside a boundary."""
    least = _LEAST_SHARE * barycentric_vertex_areas(lengths, topology)
    return jnp.maximum(circumcentric_vertex_areas(lengths, topology), least)


def _vertex_vectors(lengths: Float[Array, " E"], topology: Topology) -> TransposedRowSparseOperator:
    """ω ↦ ω^♯ at the vertices, with ⋆₁ for weights: edges of none count for nothing, so that a flip changes nothing."""
    weights = jnp.abs(_positive_mass(cotan_weights(lengths, topology)))
    return sharp_operator(lengths, topology, weights)


def _edge_curvature(lengths: Float[Array, " E"], topology: Topology) -> lx.AbstractLinearOperator:
    """⋆₁G, G_ij = ½ (k_i/⋆₀_i + k_j/⋆₀_j). Paper, §3.2."""
    pointwise = angle_defects(lengths, topology) / circumcentric_vertex_areas(lengths, topology)
    return lx.DiagonalLinearOperator(
        cotan_weights(lengths, topology) * pointwise[topology.edges].mean(axis=1)
    )


def negligible_weight(dtype: DTypeLike) -> float:
    """Cotangent weights closer to zero than this are zero up to rounding: ε^0.4, 5.5e-7 in float64. Dimensionless.

    A smaller mass would cost dense solvers digits (rounding grows with the largest eigenvalue, its inverse), a larger one
    is an error of its own: they balance at about the root of the rounding unit, and this is well above
    `delaunay_tolerance`.
    """
    return float(np.finfo(dtype).eps) ** 0.4


@eqx.filter_jit
def _mass(lengths: Float[Array, " E"], topology: Topology) -> lx.AbstractLinearOperator:
    """B: ⋆₁, made positive."""
    curl = d1(topology, lengths.dtype)
    weights = lx.DiagonalLinearOperator(_positive_mass(cotan_weights(lengths, topology)))
    stabilizer = lx.DiagonalLinearOperator(_boundary_stabilizer(lengths, topology))
    mass = weights + curl.T @ stabilizer @ curl
    return lx.TaggedLinearOperator(mass, (lx.symmetric_tag, lx.positive_semidefinite_tag))


def _positive_mass(weights: Float[Array, " E"]) -> Float[Array, " E"]:
    least = negligible_weight(weights.dtype)
    lift = jnp.where(jnp.abs(weights) < least, least - weights, 0.0)
    return weights + jax.lax.stop_gradient(lift)


def _boundary_stabilizer(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " F"]:
    """s_f: |cot α cot β cot γ| in obtuse faces from which longest sides lead, through obtuse faces only, to the boundary,
    or to an edge of negative weight that could not be flipped.

    ½ diag(cot) + s 11ᵀ, the face's part of B, is positive for s above half of this. Across any other side of these faces
    lies an angle that is not obtuse, so what remains of ⋆₁ there is not negative.
    """
    cotangents = corner_cotangents(lengths, topology)
    face = jnp.arange(topology.n_faces, dtype=topology.faces.dtype)
    longest = (jnp.argmin(cotangents, axis=1).astype(face.dtype) + 1) % 3
    edge = topology.face_edges[face, longest]
    halfedges = topology.edge_halfedges[edge]
    behind = jnp.where(halfedges[:, 0] == 3 * face + longest, halfedges[:, 1], halfedges[:, 0])
    obtuse = cotangents.min(axis=1) < 0
    outside = topology.n_faces
    leaves = (behind < 0) | _is_stuck(lengths, topology)[edge]
    following = jnp.where(obtuse, jnp.where(leaves, outside, behind // 3), face)
    following = jnp.append(following, jnp.asarray(outside, face.dtype))
    doublings = int(np.ceil(np.log2(topology.n_faces + 1)))
    reached = jax.lax.fori_loop(0, doublings, lambda _, f: f[f], following)[:-1]
    return jnp.where(reached == outside, jnp.abs(cotangents.prod(axis=1)), 0.0)
