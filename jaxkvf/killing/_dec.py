"""The paper's discretization: the Killing operator on 1-forms, by discrete exterior calculus.

    ∫‖KU‖² = 2 ∫ (|dω|² + 2(δω)² − 2k|ω|²)  [+ 4 ∮ ⟨∇_T ω, ω^⊥⟩ on a boundary]      (8), (12)

Reference: Ben-Chen, Butscher, Solomon, Guibas, On Discrete Killing Vector Fields and Patterns on Surfaces (2010), §3.
"""

import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float

from ..eigen import GeneralizedEigenproblem
from ..exterior import curl_curl, flat, grad_div, hodge1, sharp
from ..geometry import angle_defects, circumcentric_vertex_areas, geodesic_curvatures
from ..mesh import Topology
from ._discretization import AbstractDiscretization


class Dec(AbstractDiscretization):
    """One-forms on edges, as in the paper: second order, not positive semi-definite.

    A = 2R, R = d₁ᵀ⋆₂d₁ + 2⋆₁d₀⋆₀⁻¹d₀ᵀ⋆₁ − 2⋆₁G, B = ⋆₁, with the pointwise curvature G = ½(k_i/⋆₀_i + k_j/⋆₀_j). (The
    paper's Rω = λBω has half these eigenvalues.) Needs positive cotangent weights: a Delaunay mesh. λ₀ may be slightly
    negative, so this discretization is never to be minimised.
    """

    def eigenproblem(self, lengths: Float[Array, " E"], topology: Topology) -> GeneralizedEigenproblem:
        star1 = hodge1(lengths, topology)
        curvature = lx.DiagonalLinearOperator(_edge_curvatures(lengths, topology))
        boundary = lx.DiagonalLinearOperator(_boundary_term(lengths, topology))
        R = curl_curl(lengths, topology) + 2 * grad_div(lengths, topology) - 2 * (star1 @ curvature)
        A = lx.TaggedLinearOperator(2 * R + boundary, lx.symmetric_tag)
        return GeneralizedEigenproblem(A, lx.TaggedLinearOperator(star1, lx.positive_semidefinite_tag))

    def to_vertex_vectors(
        self, coefficients: Float[Array, " n"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, "V 2"]:
        return sharp(coefficients, lengths, topology)

    def from_vertex_vectors(
        self, vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, " n"]:
        return flat(vectors, lengths, topology)

    def energy(
        self, coefficients: Float[Array, " n"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, ""]:
        return coefficients @ self.eigenproblem(lengths, topology).A.mv(coefficients)


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
    pointwise = geodesic_curvatures(lengths, topology) / jnp.where(topology.is_boundary_vertex, at_vertices, 1.0)
    return jnp.where(on_boundary, -4 * pointwise[topology.edges].mean(axis=1) / lengths, 0.0)
