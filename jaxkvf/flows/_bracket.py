"""The Lie bracket of two tangent fields: the algebra that the flows generate."""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..geometry import barycentric_vertex_areas, edge_lengths, face_areas, vertex_normals
from ..mesh import TriangleMesh


@jax.jit
def lie_bracket(mesh: TriangleMesh, first: ArrayLike, second: ArrayLike) -> Float[Array, "V 3"]:
    """[U, W] = ∇_U W − ∇_W U at the vertices: tangent vectors. Unit: vector × vector / length.

    Derivatives of the fields' components in space, which are linear in each face, averaged with the areas of the faces about
    a vertex and projected to its tangent plane. The bracket of two Killing fields is a Killing field.
    """
    topology = mesh.topology
    first, second = (jnp.asarray(u, mesh.vertices.dtype) for u in (first, second))
    lengths = edge_lengths(mesh.vertices, topology)
    corners = mesh.vertices[topology.faces]
    area = face_areas(lengths, topology)
    sides = jnp.roll(corners, 1, axis=1) - jnp.roll(corners, -1, axis=1)  # opposite each corner
    normal = jnp.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / (2 * area[:, None])
    gradients = jnp.cross(jnp.broadcast_to(normal[:, None], sides.shape), sides) / (2 * area)[:, None, None]

    def along(u: Array, w: Array) -> Array:
        """(U·∇)W at each corner."""
        return jnp.einsum("fcx,fkx,fky->fcy", u[topology.faces], gradients, w[topology.faces])

    at_corners = (along(first, second) - along(second, first)) * area[:, None, None] / 3
    total = jax.ops.segment_sum(
        at_corners.reshape(-1, 3), topology.faces.ravel(), num_segments=topology.n_vertices
    )
    mean = total / barycentric_vertex_areas(lengths, topology)[:, None]
    normals = vertex_normals(mesh.vertices, topology)
    return mean - (mean * normals).sum(axis=1, keepdims=True) * normals
