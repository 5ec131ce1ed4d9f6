"""Discrete exterior calculus: d, ⋆, δ and the Hodge Laplacian as linear operators.

Forms are integrated: a 0-form has a number a vertex, a 1-form its line integral along each edge, a 2-form its integral
over each face. Apply an operator with `.mv(form)`, or turn it into a SciPy matrix with `jaxkvf.sparse.to_scipy`.

Reference: A. Hirani, Discrete Exterior Calculus (2003); M. Fisher et al., Design of Tangent Vector Fields (2007).
"""

import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, DTypeLike, Float

from ..geometry import circumcentric_vertex_areas, cotan_weights, face_areas
from ..mesh import Topology
from ..sparse import RowSparseOperator


def d0(topology: Topology, dtype: DTypeLike = float) -> RowSparseOperator:
    """Gradient, vertices → edges: f(head) − f(tail)."""
    signs = jnp.broadcast_to(jnp.asarray([-1, 1], dtype), (topology.n_edges, 2))
    return RowSparseOperator(topology.edges, signs, topology.n_vertices)


def d1(topology: Topology, dtype: DTypeLike = float) -> RowSparseOperator:
    """Curl, edges → faces: the sum around each face, counter-clockwise. d₁ d₀ = 0."""
    return RowSparseOperator(topology.face_edges, topology.face_edge_signs.astype(dtype), topology.n_edges)


def hodge0(lengths: Float[Array, " E"], topology: Topology) -> lx.DiagonalLinearOperator:
    """⋆₀: circumcentric dual area of each vertex. Unit: length². With barycentric areas the spectrum does not converge."""
    return lx.DiagonalLinearOperator(circumcentric_vertex_areas(lengths, topology))


def hodge1(lengths: Float[Array, " E"], topology: Topology) -> lx.DiagonalLinearOperator:
    """⋆₁: cotangent weight of each edge. Dimensionless; positive exactly where the edge is Delaunay."""
    return lx.DiagonalLinearOperator(cotan_weights(lengths, topology))


def hodge2(lengths: Float[Array, " E"], topology: Topology) -> lx.DiagonalLinearOperator:
    """⋆₂: 1 / area of each face. Unit: length⁻²."""
    return lx.DiagonalLinearOperator(1 / face_areas(lengths, topology))


def _inverse(diagonal: lx.DiagonalLinearOperator) -> lx.DiagonalLinearOperator:
    return lx.DiagonalLinearOperator(1 / diagonal.diagonal)


def codifferential1(lengths: Float[Array, " E"], topology: Topology) -> lx.AbstractLinearOperator:
    """δ₁ = ⋆₀⁻¹ d₀ᵀ ⋆₁, edges → vertices: minus the divergence, pointwise. Unit: 1-form / length²."""
    gradient = d0(topology, lengths.dtype)
    return _inverse(hodge0(lengths, topology)) @ gradient.T @ hodge1(lengths, topology)


def codifferential2(lengths: Float[Array, " E"], topology: Topology) -> lx.AbstractLinearOperator:
    """δ₂ = ⋆₁⁻¹ d₁ᵀ ⋆₂, faces → edges. Unit: 2-form / length²."""
    curl = d1(topology, lengths.dtype)
    return _inverse(hodge1(lengths, topology)) @ curl.T @ hodge2(lengths, topology)


def hodge_laplacian0(lengths: Float[Array, " E"], topology: Topology) -> lx.AbstractLinearOperator:
    """d₀ᵀ ⋆₁ d₀: the cotangent Laplacian, integrated (weak), symmetric."""
    gradient = d0(topology, lengths.dtype)
    return _symmetric(gradient.T @ hodge1(lengths, topology) @ gradient)


def curl_curl(lengths: Float[Array, " E"], topology: Topology) -> lx.AbstractLinearOperator:
    """d₁ᵀ ⋆₂ d₁ on 1-forms: ∫ |dω|², integrated (weak), symmetric, positive semi-definite."""
    curl = d1(topology, lengths.dtype)
    return _symmetric(curl.T @ hodge2(lengths, topology) @ curl)


def grad_div(lengths: Float[Array, " E"], topology: Topology) -> lx.AbstractLinearOperator:
    """⋆₁ d₀ ⋆₀⁻¹ d₀ᵀ ⋆₁ on 1-forms: ∫ (δω)², integrated (weak), symmetric."""
    star0, star1, gradient = hodge0(lengths, topology), hodge1(lengths, topology), d0(topology, lengths.dtype)
    return _symmetric(star1 @ gradient @ _inverse(star0) @ gradient.T @ star1)


def hodge_laplacian1(lengths: Float[Array, " E"], topology: Topology) -> lx.AbstractLinearOperator:
    """⋆₁ (δd + dδ) on 1-forms: integrated (weak), symmetric. Its kernel are the harmonic 1-forms."""
    return _symmetric(curl_curl(lengths, topology) + grad_div(lengths, topology))


def _symmetric(operator: lx.AbstractLinearOperator) -> lx.TaggedLinearOperator:
    return lx.TaggedLinearOperator(operator, lx.symmetric_tag)
