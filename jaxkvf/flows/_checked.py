"""Arguments of flows, checked: values where there are any, shapes under transformations too."""

import math

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..arguments import Integer, checked_integer
from ..geometry import SurfacePoints
from ..mesh import Topology, TriangleMesh

_OFF_A_FACE = 1e-9
_ROUNDING = 100
"""Barycentric coordinates may be off by this many times the rounding of the dtype in which they come."""


def checked_field(mesh: TriangleMesh, vectors: ArrayLike) -> Float[Array, "V 3"]:
    """The field in the dtype of the mesh.

    Raises:
        ValueError: another shape than the vertices, not finite, or zero everywhere.
    """
    vectors = jnp.asarray(vectors, mesh.vertices.dtype)
    if vectors.shape != mesh.vertices.shape:
        raise ValueError(
            f"vectors must have shape {list(mesh.vertices.shape)}, one at each vertex, got {list(vectors.shape)}"
        )
    if isinstance(vectors, Tracer):
        return vectors
    bad = np.flatnonzero(~np.isfinite(np.asarray(vectors)).all(axis=1))
    if bad.size:
        raise ValueError(
            f"vectors must be finite; at vertex {bad[0]} they are not ({bad.size} such vertices)"
        )
    if not np.asarray(vectors).any():
        raise ValueError("the field is zero everywhere: it generates no flow")
    return vectors


def checked_points(mesh: TriangleMesh, points: SurfacePoints) -> SurfacePoints:
    """The points in the dtype of the mesh, clipped to their faces where rounding took them out.

    Raises:
        TypeError: something else than `SurfacePoints`.
        ValueError: wrong shapes or dtype, a face that does not exist, or coordinates that lie in no face.
    """
    if not isinstance(points, SurfacePoints):
        raise TypeError(
            f"points must be SurfacePoints(faces, barycentric), got {type(points).__name__}; vertex_points and "
            "closest_points make them"
        )
    face, b = points.faces, points.barycentric
    if face.ndim != 1 or not jnp.issubdtype(face.dtype, jnp.integer) or b.shape != (len(face), 3):
        raise ValueError(
            f"points need integer faces [N] and barycentric [N, 3], got {face.dtype} {list(face.shape)} and {list(b.shape)}"
        )
    n = mesh.topology.n_faces
    tolerance = _OFF_A_FACE
    if jnp.issubdtype(b.dtype, jnp.floating):
        tolerance = max(tolerance, _ROUNDING * float(jnp.finfo(b.dtype).eps))
    weights = jnp.asarray(b, mesh.vertices.dtype)
    missing = (face < 0) | (face >= n)
    off = ~((weights >= -tolerance).all(axis=1) & (abs(weights.sum(axis=1) - 1) <= tolerance))
    if not isinstance(missing, Tracer) and missing.any():
        outside = np.flatnonzero(missing)
        raise ValueError(f"point {outside[0]} is in face {face[outside[0]]}: the mesh has faces 0…{n - 1}")
    if not isinstance(off, Tracer) and off.any():
        which = np.flatnonzero(off)
        raise ValueError(
            f"point {which[0]} is off the mesh: barycentric coordinates must be at least 0 and sum to 1, "
            f"got {b[which[0]].tolist()} ({which.size} such points); closest_points puts positions on the mesh"
        )
    weights = jnp.maximum(weights, 0)
    weights = weights / weights.sum(axis=1, keepdims=True)
    weights = jnp.where((missing | off)[:, None], jnp.nan, weights)
    return SurfacePoints(jnp.clip(face, 0, n - 1).astype(jnp.int32), weights)


def checked_times(time: ArrayLike, points: SurfacePoints) -> Float[Array, " N"]:
    """One finite time for each point.

    Raises:
        ValueError: another shape, or a time that is not finite.
    """
    n, times = len(points), jnp.asarray(time, points.barycentric.dtype)
    if times.shape not in ((), (n,)):
        raise ValueError(
            f"time must be a number or have one for each of the {n} points, got shape {list(times.shape)}"
        )
    if not isinstance(times, Tracer) and not jnp.isfinite(times).all():
        raise ValueError(f"time must be finite, got {times[~jnp.isfinite(times)][0]}")
    return jnp.broadcast_to(times, (n,))


def checked_steps(max_steps: Integer | None, topology: Topology) -> int:
    """`max_steps`, or steps that are enough for dozens of times around a surface of these faces, however long they are.

    Once around crosses some 5 √F faces of even size, and all of them where they are as long as the surface. What goes
    round more often is on a speck.

    Raises:
        ValueError: not an integer, or less than 1.
    """
    if max_steps is None:
        n = topology.n_faces
        return int(min(4 * n, 400 * math.sqrt(n))) + 10_000
    return checked_integer("max_steps", max_steps)
