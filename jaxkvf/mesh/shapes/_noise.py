"""Noise on a mesh's vertices."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ...arguments import Integer, Real, checked_not_negative
from .._triangle_mesh import TriangleMesh
from .._validation import check_areas_positive


def add_normal_noise(mesh: TriangleMesh, sigma: Real, seed: Integer = 0) -> TriangleMesh:
    """Moves each vertex along its area-weighted normal by sigma × mean edge length × a standard normal number.

    Args:
        mesh: left as it is.
        sigma: standard deviation of the displacement, as a fraction of the mean edge length, ≥ 0.
        seed: of `numpy.random.default_rng`; the same seed gives the same mesh.

    Raises:
        ValueError: `sigma` negative or not finite.
        MeshError: the noise made a triangle degenerate.
    """
    sigma = checked_not_negative("sigma", sigma)
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    tails, heads = np.asarray(mesh.topology.edges).T
    mean_edge = np.linalg.norm(vertices[heads] - vertices[tails], axis=1).mean()
    numbers = np.random.default_rng(seed).standard_normal((len(vertices), 1))
    moved = vertices + sigma * mean_edge * numbers * _vertex_normals(vertices, faces)
    check_areas_positive(moved, faces)
    return mesh.with_vertices(jnp.asarray(moved, mesh.vertices.dtype))


def _vertex_normals(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> Float[np.ndarray, "V 3"]:
    """Unit normals, the mean of the adjacent faces' normals weighted by area."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    face_normals = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    np.add.at(normals, faces, face_normals[:, None])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
