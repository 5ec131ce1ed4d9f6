"""Checks of raw face and vertex arrays, on the host, before anything is built from them."""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ._errors import MeshError

_MOST_NAMED = 5


def name_first(what: str, indices: Int[np.ndarray, " n"]) -> str:
    """'face 3' or 'faces 3, 8, 9, … (12 in all)': the first offenders, for a message."""
    listed = ", ".join(str(int(i)) for i in indices[:_MOST_NAMED])
    if len(indices) == 1:
        return f"{what} {listed}"
    plural = "vertices" if what == "vertex" else f"{what}s"
    rest = f", … ({len(indices)} in all)" if len(indices) > _MOST_NAMED else ""
    return f"{plural} {listed}{rest}"


def checked_faces(faces: object, n_vertices: int) -> Int[np.ndarray, "F 3"]:
    """`faces` as an int32 array of corner indices into `n_vertices` vertices, every one referenced.

    Raises:
        MeshError: not an integer `[F, 3]` array, empty, index out of range, a vertex twice in one face, or an
            unreferenced vertex.
    """
    array = np.asarray(faces)
    if array.size == 0:
        raise MeshError("the mesh has no faces; at least one triangle is needed")
    if array.ndim != 2 or array.shape[1] != 3:
        remedy = (
            "; the faces are quads: triangulate them first" if array.ndim == 2 and array.shape[1] == 4 else ""
        )
        raise MeshError(
            f"faces must be an integer array of shape [F, 3], got shape {list(array.shape)}{remedy}"
        )
    if not np.issubdtype(array.dtype, np.integer):
        raise MeshError(f"faces must have an integer dtype, got {array.dtype}")
    if n_vertices >= np.iinfo(np.int32).max // 8:
        raise MeshError(
            f"the mesh has {n_vertices} vertices; 32-bit indices allow {np.iinfo(np.int32).max // 8}"
        )

    outside = np.flatnonzero(((array < 0) | (array >= n_vertices)).any(axis=1))
    if outside.size:
        corner = array[outside[0]].tolist()
        raise MeshError(
            f"{name_first('face', outside)}: vertex index out of range 0…{n_vertices - 1} "
            f"(face {outside[0]} is {corner}); indices count from 0"
        )
    a, b, c = array.T
    repeated = np.flatnonzero((a == b) | (b == c) | (c == a))
    if repeated.size:
        raise MeshError(
            f"degenerate {name_first('face', repeated)}: a vertex appears twice "
            f"(face {repeated[0]} is {array[repeated[0]].tolist()}); remove such faces"
        )
    unused = np.flatnonzero(np.bincount(array.ravel(), minlength=n_vertices) == 0)
    if unused.size:
        raise MeshError(f"unreferenced {name_first('vertex', unused)}: no face uses it; remove such vertices")
    return array.astype(np.int32)


def check_edges_manifold(
    faces: Int[np.ndarray, "F 3"], halfedge_edges: Int[np.ndarray, " H"], edges: Int[np.ndarray, "E 2"]
) -> None:
    """Every edge has one face, or two that traverse it in opposite directions.

    Raises:
        MeshError: an edge with more than two faces; faces that cannot be oriented consistently (Möbius, Klein) or are not.
    """
    uses = np.bincount(halfedge_edges, minlength=len(edges))
    crowded = np.flatnonzero(uses > 2)
    if crowded.size:
        i, j = edges[crowded[0]]
        around = np.flatnonzero(halfedge_edges == crowded[0]) // 3
        raise MeshError(
            f"non-manifold edge: {len(around)} faces ({', '.join(map(str, around[:_MOST_NAMED]))}) share the edge "
            f"between vertices {i} and {j}; {crowded.size} such edge(s) in all; every edge may have at most two faces"
        )
    tails = faces.ravel()
    forward = tails == edges[halfedge_edges, 0]
    clashing = np.flatnonzero(
        (uses == 2) & (np.bincount(halfedge_edges, weights=forward, minlength=len(edges)) != 1)
    )
    if not clashing.size:
        return
    i, j = edges[clashing[0]]
    pair = np.flatnonzero(halfedge_edges == clashing[0]) // 3
    where = (
        f"faces {pair[0]} and {pair[1]} traverse the edge between vertices {i} and {j} in the same direction"
    )
    if _is_orientable(len(faces), halfedge_edges, forward, uses == 2):
        raise MeshError(
            f"inconsistently oriented faces: {where} ({clashing.size} such edge(s)); flip faces until neighbours agree"
        )
    raise MeshError(
        f"non-orientable surface: {where}, and no flipping of faces mends it (a Möbius strip or Klein bottle)"
    )


def _is_orientable(
    n_faces: int, halfedge_edges: Int[np.ndarray, " H"], forward: np.ndarray, inner: np.ndarray
) -> bool:
    """Whether the two sides of every face stay apart in the orientation double cover."""
    order = np.argsort(halfedge_edges, kind="stable")
    order = order[inner[halfedge_edges[order]]].reshape(-1, 2)
    left, right = order.T // 3
    same = forward[order[:, 0]] != forward[order[:, 1]]
    sides = [
        (left, np.where(same, right, right + n_faces)),
        (left + n_faces, np.where(same, right + n_faces, right)),
    ]
    rows, columns = (np.concatenate(part) for part in zip(*sides, strict=True))
    cover = coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * n_faces, 2 * n_faces))
    _, label = connected_components(cover, directed=False)
    return bool((label[:n_faces] != label[n_faces:]).all())


def checked_vertices(vertices: object) -> np.ndarray:
    """`vertices` as a floating `[V, 3]` array of finite positions.

    Raises:
        MeshError: another shape or dtype, no vertices, or a NaN or infinite coordinate.
    """
    array = np.asarray(vertices)
    if array.ndim != 2 or array.shape[1] != 3:
        raise MeshError(f"vertices must be a floating array of shape [V, 3], got shape {list(array.shape)}")
    if array.shape[0] == 0:
        raise MeshError("the mesh has no vertices")
    if np.issubdtype(array.dtype, np.integer):
        array = array.astype(np.float64)
    if not np.issubdtype(array.dtype, np.floating):
        raise MeshError(f"vertices must have a floating dtype, got {array.dtype}")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if bad.size:
        raise MeshError(
            f"{name_first('vertex', bad)}: position is not finite (vertex {bad[0]} is {array[bad[0]].tolist()})"
        )
    return array


def check_areas_positive(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> None:
    """Every triangle is thicker than the rounding of its own coordinates allows to tell from a segment.

    Raises:
        MeshError: a triangle whose height is lost in the rounding of its positions (at the dtype of `vertices`).
    """
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    with np.errstate(over="ignore", under="ignore"):
        scale = np.abs(np.stack([b - a, c - b, a - c])).max()
        if not (np.isfinite(scale) and scale > 0):
            raise MeshError("all vertices coincide, or lie too far apart for their dtype")
        u, v, w = (b - a) / scale, (c - b) / scale, (a - c) / scale
        longest = np.sqrt(np.maximum.reduce([(u * u).sum(1), (v * v).sum(1), (w * w).sum(1)]))
        twice_area = np.linalg.norm(np.cross(u, -w), axis=1)
    flat = np.flatnonzero(~(twice_area > 8 * np.finfo(vertices.dtype).eps * longest * longest))
    if flat.size:
        raise MeshError(
            f"degenerate {name_first('face', flat)}: zero area (face {flat[0]} has corners "
            f"{faces[flat[0]].tolist()}); remove or merge such faces"
        )
