"""Frames in R³ for tangent vectors: the embedded side of what is intrinsic below."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mesh import Topology
from ._metric import edge_lengths
from ._tangent import spoke_angles, unit_vectors


@jax.jit
def face_normals(vertices: Float[Array, "V 3"], topology: Topology) -> Float[Array, "F 3"]:
    """Unit normal of each face, outward for counter-clockwise faces."""
    return _unit(_face_area_vectors(vertices, topology))


@jax.jit
def vertex_normals(vertices: Float[Array, "V 3"], topology: Topology) -> Float[Array, "V 3"]:
    """Unit normal at each vertex: the faces' normals averaged with their areas."""
    normal = _face_area_vectors(vertices, topology)
    at_corners = jnp.broadcast_to(normal[:, None, :], (topology.n_faces, 3, 3)).reshape(-1, 3)
    total = jax.ops.segment_sum(at_corners, topology.faces.ravel(), num_segments=topology.n_vertices)
    return _unit(total)


@jax.jit
def normal_displacements(
    before: Float[Array, "V 3"], after: Float[Array, "V 3"], topology: Topology
) -> Float[Array, " V"]:
    """How far each vertex moved along its outward normal before. Unit: length, negative inward."""
    return ((after - before) * vertex_normals(before, topology)).sum(axis=1)


def _unit(vectors: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Scaled to unit length; squares are taken of components of about 1, since those of areas may leave the range."""
    vectors = vectors / jax.lax.stop_gradient(jnp.abs(vectors).max(axis=1, keepdims=True))
    return vectors / jnp.linalg.norm(vectors, axis=1, keepdims=True)


def _face_area_vectors(vertices: Float[Array, "V 3"], topology: Topology) -> Float[Array, "F 3"]:
    a, b, c = (vertices[topology.faces[:, corner]] for corner in range(3))
    return 0.5 * jnp.cross(b - a, c - a)


@jax.jit
def vertex_frames(vertices: Float[Array, "V 3"], topology: Topology) -> Float[Array, "V 2 3"]:
    """Orthonormal axes in R³ of the intrinsic polar frame at each vertex, tangent to the surface.

    The plane is normal to `vertex_normals`; within it the axes are turned so that the spokes' intrinsic directions fit
    their projections best (least squares), so no single edge is preferred.
    """
    normal = vertex_normals(vertices, topology)
    spoke_vertex, neighbour = topology.spoke_vertices, topology.spoke_neighbours
    any_axis = jnp.eye(3, dtype=vertices.dtype)[jnp.argmin(jnp.abs(normal), axis=1)]
    first = jnp.cross(normal, any_axis)
    first = first / jnp.linalg.norm(first, axis=1, keepdims=True)
    second = jnp.cross(normal, first)

    offset = vertices[neighbour] - vertices[spoke_vertex]
    x = (offset * first[spoke_vertex]).sum(1)
    y = (offset * second[spoke_vertex]).sum(1)
    cos, sin = unit_vectors(spoke_angles(edge_lengths(vertices, topology), topology)).T
    # The rotation R that maximises Σ ⟨(x, y), R d⟩ over the spokes has the phase of Σ (x + iy) conj(d).
    fit = jax.ops.segment_sum(
        jnp.stack([x * cos + y * sin, y * cos - x * sin], axis=1),
        spoke_vertex,
        num_segments=topology.n_vertices,
    )
    fit = fit / jnp.linalg.norm(fit, axis=1, keepdims=True)
    c, s = fit[:, :1], fit[:, 1:]
    return jnp.stack([c * first + s * second, c * second - s * first], axis=1)


@jax.jit
def embed(coefficients: Float[Array, "*k V 2"], frames: Float[Array, "V 2 3"]) -> Float[Array, "*k V 3"]:
    """Intrinsic vectors at vertices as vectors in R³."""
    return jnp.einsum("...vc,vcd->...vd", coefficients, frames)


@jax.jit
def project(vectors: Float[Array, "*k V 3"], frames: Float[Array, "V 2 3"]) -> Float[Array, "*k V 2"]:
    """Components of vectors in R³ in the intrinsic frames; the normal part is dropped. Inverse of `embed`."""
    return jnp.einsum("...vd,vcd->...vc", vectors, frames)


@jax.jit
def face_frames(vertices: Float[Array, "V 3"], topology: Topology) -> Float[Array, "F 2 3"]:
    """Orthonormal axes of each face in R³: along its first side, and a quarter turn counter-clockwise from it."""
    a, b = vertices[topology.faces[:, 0]], vertices[topology.faces[:, 1]]
    first = (b - a) / jnp.linalg.norm(b - a, axis=1, keepdims=True)
    return jnp.stack([first, jnp.cross(face_normals(vertices, topology), first)], axis=1)
