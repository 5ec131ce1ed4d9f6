"""How nearly a flow is an isometry: §3.3 of the paper."""

import math

import equinox as eqx
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from ..extras import extra
from ..geometry import edge_lengths, surface_positions, vertex_points
from ..host import check_on_host
from ..mesh import TriangleMesh
from ._flow import FlowStatus, flow


class Isometry(eqx.Module):
    """What the flow did to the lengths of the edges, each taken as the segment between its ends in space."""

    relative_rms: float
    """√(Σ (ℓ' − ℓ)² / Σ ℓ²). Dimensionless."""
    err: float
    """The paper's Err: `relative_rms` / number of edges."""
    largest: float
    """Largest |ℓ' − ℓ| / ℓ."""
    vertices: Float[Array, "V 3"]
    """The advected vertices. Unit: length."""
    finished: float
    """Share of the vertices that the flow took the whole way; the others met a boundary or stay in a singular point."""


def isometry_error(mesh: TriangleMesh, vectors: ArrayLike, time: float) -> Isometry:
    """Edge lengths of the mesh advected by φᵗ against those of the mesh (§3.3): 0 for a Killing field. On the host.

    Raises:
        ValueError: as for `flow`.
    """
    check_on_host("isometry_error", mesh, vectors, time)
    end = flow(mesh, vectors, time, vertex_points(mesh))
    moved = surface_positions(mesh, end.points)
    before, after = (np.asarray(edge_lengths(x, mesh.topology)) for x in (mesh.vertices, moved))
    change = after - before
    relative = math.sqrt(float((change**2).sum() / (before**2).sum()))
    arrived = np.isin(np.asarray(end.status), (FlowStatus.ARRIVED, FlowStatus.STATIONARY))
    return Isometry(
        relative, relative / len(before), float(np.abs(change / before).max()), moved, float(arrived.mean())
    )


class DistanceDistortion(eqx.Module):
    """Exact geodesic distances of pairs of points before and after a flow.

    Pairs closer than a quarter of the largest distance are left out: there the interpolation between vertices shows.
    """

    before: Float[np.ndarray, " pairs"]
    """Unit: length."""
    after: Float[np.ndarray, " pairs"]
    largest: float
    """Largest |d' − d| / d."""
    rms: float
    """√(Σ (d' − d)² / Σ d²)."""


def distance_distortion(
    mesh: TriangleMesh, vectors: ArrayLike, time: float, *, sources: int = 4, seed: int = 0
) -> DistanceDistortion:
    """Geodesic distances between φᵗ(p) and φᵗ(q) against those between p and q, for some vertices p and all vertices q.

    Distances on the polyhedron are exact (Mitchell, Mount and Papadimitriou, through libigl); φᵗ(p) is made a vertex by
    splitting its face, and at φᵗ(q) distances are interpolated linearly. On the host.

    Args:
        mesh: the surface.
        vectors: `[V, 3]`, tangent vectors at the vertices. Unit: length / time.
        time: how long to go.
        sources: number of vertices p, drawn with `seed`; each costs two exact solves.
        seed: of `numpy.random.default_rng`.

    Raises:
        ValueError: as for `flow`.
        ImportError: libigl is not installed.
    """
    check_on_host("distance_distortion", mesh, vectors, time)
    x, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    end = flow(mesh, vectors, time, vertex_points(mesh)).points
    corners, b = faces[np.asarray(end.faces)], np.asarray(end.barycentric)
    befores, afters = [], []
    for p in np.random.default_rng(seed).choice(len(x), min(sources, len(x)), replace=False):
        before = _exact_distances(x, faces, int(p))
        split_x, split_faces = _split(x, faces, int(end.faces[p]), b[p])
        after = (b * _exact_distances(split_x, split_faces, len(x))[corners]).sum(axis=1)
        far = before > before.max() / 4
        befores.append(before[far])
        afters.append(after[far])
    d, d_after = np.concatenate(befores), np.concatenate(afters)
    change = d_after - d
    rms = math.sqrt(float((change**2).sum() / (d**2).sum()))
    return DistanceDistortion(d, d_after, float(np.abs(change / d).max()), rms)


_FROM_THE_SIDES = 1e-6


def _split(
    x: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], face: int, b: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "W 3"], Int[np.ndarray, "G 3"]]:
    """The mesh with one more vertex, at a point of a face; moved off the face's sides by a millionth of its size."""
    b = np.maximum(b, _FROM_THE_SIDES)
    a = faces[face]
    new = np.array([[a[0], a[1], len(x)], [a[1], a[2], len(x)], [a[2], a[0], len(x)]])
    return np.vstack([x, b / b.sum() @ x[a]]), np.vstack([np.delete(faces, face, axis=0), new])


def _exact_distances(
    x: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], source: int
) -> Float[np.ndarray, " V"]:
    none = np.zeros(0, np.int64)
    return extra("igl").exact_geodesic(x, faces, np.array([source]), none, np.arange(len(x)), none)
