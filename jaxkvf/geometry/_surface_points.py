"""Points on a surface: a face and barycentric coordinates in it."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.spatial import KDTree

from ..host import check_on_host
from ..mesh import Topology, TriangleMesh

_CANDIDATES = 16


class SurfacePoints(eqx.Module):
    """Points of a surface, each in a face: what `flow`, `integral_curves`, `orbit` and patterns take and return."""

    faces: Int[Array, "*shape"] = eqx.field(converter=jnp.asarray)
    """The face of each point."""
    barycentric: Float[Array, "*shape 3"] = eqx.field(converter=jnp.asarray)
    """The weights of its corners: at least 0, summing to 1. Dimensionless."""

    def __len__(self) -> int:
        return len(self.faces)

    def __getitem__(self, index: Any) -> "SurfacePoints":
        """Some of the points, chosen as from an array of them."""
        return SurfacePoints(self.faces[index], self.barycentric[index])


def vertex_points(mesh: TriangleMesh, vertices: object = None) -> SurfacePoints:
    """The given vertices (indices; by default all) as points in a face around each.

    Raises:
        ValueError: not a list of integers, or an index out of range.
    """
    n = mesh.topology.n_vertices
    chosen = np.arange(n) if vertices is None else np.atleast_1d(np.asarray(vertices))
    if chosen.ndim != 1 or not np.issubdtype(chosen.dtype, np.integer):
        raise ValueError(f"vertices must be a list of integers, got {vertices!r}")
    outside = chosen[(chosen < 0) | (chosen >= n)]
    if outside.size:
        raise ValueError(f"vertex {outside[0]} does not exist: the mesh has vertices 0…{n - 1}")
    corner = _first_corners(mesh.topology)[chosen]
    return SurfacePoints(corner // 3, jnp.eye(3, dtype=mesh.vertices.dtype)[corner % 3])


def _first_corners(topology: Topology) -> Int[Array, " V"]:
    """A corner at each vertex."""
    corners = jnp.arange(3 * topology.n_faces, dtype=topology.faces.dtype)
    return jax.ops.segment_min(corners, topology.faces.ravel(), num_segments=topology.n_vertices)


def surface_positions(mesh: TriangleMesh, points: SurfacePoints) -> Float[Array, "*shape 3"]:
    """Σ b_i x_i: where the points are in space. Unit: length."""
    weights = points.barycentric.astype(mesh.vertices.dtype)
    return jnp.einsum("...c,...cx->...x", weights, mesh.vertices[mesh.faces[points.faces]])


def closest_points(mesh: TriangleMesh, positions: object) -> SurfacePoints:
    """The points of the surface closest to `positions` `[N, 3]` in space. On the host.

    Raises:
        ValueError: another shape, or a coordinate that is not finite.
    """
    check_on_host("closest_points", mesh, positions)
    wanted = np.asarray(positions, np.float64)
    if wanted.ndim != 2 or wanted.shape[1] != 3 or not np.isfinite(wanted).all():
        raise ValueError(f"positions must be finite and of shape [N, 3], got shape {list(wanted.shape)}")
    corners = np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces)]
    middles = corners.mean(axis=1)
    reach = np.linalg.norm(
        corners - middles[:, None], axis=2
    ).max()  # no face extends further from its middle
    tree = KDTree(middles)
    faces = np.zeros(len(wanted), np.int64)
    barycentric = np.zeros((len(wanted), 3))
    open_, count = np.arange(len(wanted)), _CANDIDATES
    while open_.size:
        count = min(count, len(middles))
        distance, candidate = tree.query(wanted[open_], k=count)
        distance, candidate = distance.reshape(-1, count), candidate.reshape(-1, count)
        b = _closest_in_triangles(corners[candidate], wanted[open_, None])
        gap = np.linalg.norm(np.einsum("nkc,nkcx->nkx", b, corners[candidate]) - wanted[open_, None], axis=2)
        best = gap.argmin(axis=1)
        row = np.arange(len(open_))
        faces[open_], barycentric[open_] = candidate[row, best], b[row, best]
        unsure = (distance[:, -1] - reach < gap[row, best]) & (count < len(middles))
        open_, count = open_[unsure], 4 * count
    return SurfacePoints(faces.astype(np.int32), jnp.asarray(barycentric, mesh.vertices.dtype))


def _closest_in_triangles(
    corners: Float[np.ndarray, "n k 3 3"], points: Float[np.ndarray, "n 1 3"]
) -> Float[np.ndarray, "n k 3"]:
    """Barycentric coordinates of the closest point of each triangle: inside it, or on the closest of its sides."""
    a, b, c = (corners[:, :, i] for i in range(3))
    normal = np.cross(b - a, c - a)
    square = (normal**2).sum(axis=-1)
    inside = np.stack(
        [(np.cross(q - p, points - p) * normal).sum(axis=-1) / square for p, q in ((b, c), (c, a), (a, b))],
        -1,
    )
    best, gap = inside, np.where((inside >= 0).all(axis=-1), 0.0, np.inf)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        start, side = corners[:, :, i], corners[:, :, j] - corners[:, :, i]
        t = np.clip(((points - start) * side).sum(axis=-1) / (side**2).sum(axis=-1), 0, 1)
        distance = np.linalg.norm(start + t[..., None] * side - points, axis=-1)
        on_side = np.zeros_like(inside)
        on_side[..., i], on_side[..., j] = 1 - t, t
        closer = distance < gap
        best, gap = np.where(closer[..., None], on_side, best), np.where(closer, distance, gap)
    return best
