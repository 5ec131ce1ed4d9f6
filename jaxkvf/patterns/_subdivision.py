"""Faces cut into smaller ones that lie in them."""

import jax.numpy as jnp
import numpy as np

from ..geometry import SurfacePoints, surface_positions
from ..mesh import TriangleMesh


def subdivided(mesh: TriangleMesh, parts: int) -> tuple[TriangleMesh, SurfacePoints]:
    """The mesh with every edge cut in `parts`, every face in parts²: the same surface, its vertices as points of the old.

    The old vertices come first, then those inside edges, then those inside faces.
    """
    topology, n = mesh.topology, parts
    faces, face_edges = np.asarray(topology.faces), np.asarray(topology.face_edges)
    forward = np.asarray(topology.face_edge_signs) > 0
    i, j = (g.ravel() for g in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    i, j = i[i + j <= n], j[i + j <= n]
    weights = np.stack([n - i - j, i, j], axis=1)  # of the corners, in n-ths
    index = np.zeros((len(faces), len(weights)), np.int64)
    inner = (weights > 0).all(axis=1)
    first_inner = topology.n_vertices + topology.n_edges * (n - 1)
    index[:, inner] = first_inner + np.arange(len(faces))[:, None] * inner.sum() + np.arange(inner.sum())
    for side in range(3):
        start, end, other = side, (side + 1) % 3, (side + 2) % 3
        on_side = np.flatnonzero((weights[:, other] == 0) & (weights[:, start] > 0) & (weights[:, end] > 0))
        step = weights[on_side, end]
        along = np.where(forward[:, side, None], step - 1, n - 1 - step)
        index[:, on_side] = topology.n_vertices + face_edges[:, side, None] * (n - 1) + along
        index[:, np.flatnonzero(weights[:, start] == n)] = faces[:, start, None]
    count = first_inner + len(faces) * int(inner.sum())
    owner, b = np.zeros(count, np.int32), np.zeros((count, 3))
    owner[index] = np.arange(len(faces), dtype=np.int32)[:, None]
    where = np.zeros(count, np.int64)
    where[index] = np.arange(len(weights))[None]
    b = weights[where] / n

    number = {(int(p), int(q)): k for k, (p, q) in enumerate(zip(i, j, strict=True))}
    up = [(number[p, q], number[p + 1, q], number[p, q + 1]) for p, q in number if p + q < n]
    down = [(number[p + 1, q], number[p + 1, q + 1], number[p, q + 1]) for p, q in number if p + q < n - 1]
    small = index[:, np.array(up + down)].reshape(-1, 3)
    points = SurfacePoints(jnp.asarray(owner), jnp.asarray(b, mesh.vertices.dtype))
    return TriangleMesh.from_arrays(np.asarray(surface_positions(mesh, points)), small), points
