"""The paper's discretization: the Killing operator on 1-forms, by discrete exterior calculus.

    ∫‖KU‖² = 2 ∫ (|dω|² + 2(δω)² − 2k|ω|²)  [+ 4 ∮ ⟨∇_T ω, ω^⊥⟩ on a boundary]      (8), (12)

Reference: Ben-Chen, Butscher, Solomon, Guibas, On Discrete Killing Vector Fields and Patterns on Surfaces (2010), §3.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
from jaxtyping import Array, DTypeLike, Float

from ..eigen import GeneralizedEigenproblem
from ..exterior import curl_curl, flat_operator, grad_div, hodge1, sharp
from ..geometry import (
    IntrinsicDelaunay,
    angle_defects,
    circumcentric_vertex_areas,
    cotan_weights,
    geodesic_curvatures,
    intrinsic_delaunay,
    rotations,
)
from ..mesh import Topology
from ..sparse import RowSparseOperator
from ._discretization import AbstractDiscretization


class Dec(AbstractDiscretization):
    """One-forms on the edges of the intrinsic Delaunay triangulation: second order, not positive semi-definite.

    A = 2R, R = d₁ᵀ⋆₂d₁ + 2⋆₁d₀⋆₀⁻¹d₀ᵀ⋆₁ − 2⋆₁G, B = ⋆₁, with the pointwise curvature G = ½(k_i/⋆₀_i + k_j/⋆₀_j). (The
    paper's Rω = λBω has half these eigenvalues.) λ₀ may be slightly negative, so this discretization is never to be
    minimised; where curvature sits in single vertices (creases, scanned noise) eigenvalues may be far below zero.

    *Where ⋆₁ is positive.* B = ⋆₁ must be, so unknowns live on the intrinsic Delaunay triangulation (`triangulation`),
    which makes it non-negative on all inner edges. A boundary edge opposite an obtuse angle keeps ⋆₁ < 0: it is left so,
    and the eigensolver then reports an indefinite B. Use `regge` there, or remesh the boundary.

    *Where ⋆₁ is zero.* Two faces inscribed in one circle, of which regular grids are full, give their common edge no mass.
    Its row of A x = λ B x is then (d₁ᵀ⋆₂d₁ω)_e = 0: the curl is the same in both faces, which act as one polygon, and the
    eigenproblem on the other unknowns is well posed. To keep B definite, weights within `negligible_weight` of zero count
    as that weight in B (not in A). This lowers eigenvalues by a fraction of about that size, 5e-7 in float64, far less than
    their error; derivatives are those of ⋆₁ itself.
    """

    delaunay: bool = eqx.field(static=True, default=True)
    """False for the paper's operator on the triangulation as it is, for meshes that are Delaunay or to see what it does."""
    flip_capacity: int = eqx.field(static=True, default=1)
    """Room for edge flips, see `intrinsic_delaunay`."""

    def triangulation(self, lengths: Float[Array, " E"], topology: Topology) -> IntrinsicDelaunay:
        """The triangulation whose edges carry the unknowns."""
        if self.delaunay:
            return intrinsic_delaunay(lengths, topology, capacity=self.flip_capacity)
        unturned = jnp.zeros(topology.n_vertices, lengths.dtype)
        return IntrinsicDelaunay(lengths, topology, unturned, jnp.zeros((), jnp.int32))

    def eigenproblem(self, lengths: Float[Array, " E"], topology: Topology) -> GeneralizedEigenproblem:
        surface = self.triangulation(lengths, topology)
        lengths, topology = surface.lengths, surface.topology
        mass = lx.DiagonalLinearOperator(_positive_mass(cotan_weights(lengths, topology)))
        return GeneralizedEigenproblem(
            _stiffness(lengths, topology), lx.TaggedLinearOperator(mass, lx.positive_semidefinite_tag)
        )

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
        return coefficients @ _stiffness(surface.lengths, surface.topology).mv(coefficients)


def _stiffness(lengths: Float[Array, " E"], topology: Topology) -> lx.AbstractLinearOperator:
    star1 = hodge1(lengths, topology)
    curvature = lx.DiagonalLinearOperator(_edge_curvatures(lengths, topology))
    boundary = lx.DiagonalLinearOperator(_boundary_term(lengths, topology))
    R = curl_curl(lengths, topology) + 2 * grad_div(lengths, topology) - 2 * (star1 @ curvature)
    return lx.TaggedLinearOperator(2 * R + boundary, lx.symmetric_tag)


def negligible_weight(dtype: DTypeLike) -> float:
    """Cotangent weights closer to zero than this are zero up to rounding: ε^0.4, 5.5e-7 in float64. Dimensionless.

    A smaller mass would cost dense solvers digits (rounding grows with the largest eigenvalue, its inverse), a larger one
    is an error of its own: they balance at about the root of the rounding unit, and this is well above
    `delaunay_tolerance`.
    """
    return float(np.finfo(dtype).eps) ** 0.4


def _positive_mass(weights: Float[Array, " E"]) -> Float[Array, " E"]:
    least = negligible_weight(weights.dtype)
    lift = jnp.where(jnp.abs(weights) < least, least - weights, 0.0)
    return weights + jax.lax.stop_gradient(lift)


def _edge_curvatures(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " E"]:
    """G_ij = ½ (k_i/⋆₀_i + k_j/⋆₀_j): Gauss curvature at each edge, pointwise. Unit: length⁻². Paper, §3.2."""
    pointwise = angle_defects(lengths, topology) / circumcentric_vertex_areas(lengths, topology)
    return pointwise[topology.edges].mean(axis=1)


def _boundary_term(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " E"]:
    """Diagonal of 4∮(−k_g a²)ds for a form whose normal part vanishes, a = ω/ℓ along boundary edges. Eq. (12)."""
    on_boundary = topology.is_boundary_edge
    boundary_length = jnp.where(on_boundary, lengths, 0.0)
    at_vertices = jnp.zeros(topology.n_vertices, lengths.dtype)
    for end in range(2):
        at_vertices = at_vertices.at[topology.edges[:, end]].add(0.5 * boundary_length)
    pointwise = geodesic_curvatures(lengths, topology) / jnp.where(
        topology.is_boundary_vertex, at_vertices, 1.0
    )
    return jnp.where(on_boundary, -4 * pointwise[topology.edges].mean(axis=1) / lengths, 0.0)
