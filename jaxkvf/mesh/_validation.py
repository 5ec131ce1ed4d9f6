"""Checks of raw face and vertex arrays, on the host, before anything is built from them."""

import numpy as np
from jaxtyping import Float, Int

from . import _defects
from ._errors import MeshError
from ._polygons import Polygons

_MOST_NAMED = 5


def name_first(what: str, indices: Int[np.ndarray, " n"]) -> str:
    """'face 3' or 'faces 3, 8, 9, … (12 in all)': the first offenders, for a message."""
    listed = ", ".join(str(int(i)) for i in indices[:_MOST_NAMED])
    if len(indices) == 1:
        return f"{what} {listed}"
    plural = "vertices" if what == "vertex" else f"{what}s"
    rest = f", … ({len(indices)} in all)" if len(indices) > _MOST_NAMED else ""
    return f"{plural} {listed}{rest}"


def face_array(faces: object) -> Int[np.ndarray, "F 3"]:
    """`faces` as an int64 array `[F, 3]` of at least one face.

    Raises:
        MeshError: another shape or dtype, or empty.
    """
    array = np.asarray(faces)
    if array.size == 0:
        raise MeshError("the mesh has no faces; at least one triangle is needed")
    if array.ndim != 2 or array.shape[1] != 3:
        remedy = (
            f"; the faces are {'quads' if array.shape[1] == 4 else 'polygons'}: triangulate them first, by "
            "repair(…, triangulate=True)"
            if array.ndim == 2 and array.shape[1] > 3
            else ""
        )
        raise MeshError(
            f"faces must be an integer array of shape [F, 3], got shape {list(array.shape)}{remedy}"
        )
    if not np.issubdtype(array.dtype, np.integer):
        raise MeshError(f"faces must have an integer dtype, got {array.dtype}")
    return array.astype(np.int64)


def polygon_arrays(faces: object) -> Polygons:
    """`faces` as polygons: an integer array `[F, n]`, or a list of lists of integers of any length.

    Raises:
        MeshError: anything else, or no faces.
    """
    try:
        array = np.asarray(faces)
    except ValueError:  # rows of different lengths
        return _ragged(faces)
    if array.ndim == 2 and array.shape[1] != 3 and array.size and np.issubdtype(array.dtype, np.integer):
        return Polygons.of_rows(array.astype(np.int64))
    return Polygons.of_rows(face_array(array))


def _ragged(faces: object) -> Polygons:
    try:
        rows = [np.asarray(row) for row in faces]  # type: ignore[attr-defined]
        sizes = np.array([len(row) for row in rows])
        corners = np.concatenate([row for row in rows if len(row)])
    except (TypeError, ValueError) as error:
        raise MeshError("faces must be rows of corner indices") from error
    if not np.issubdtype(corners.dtype, np.integer):
        raise MeshError(f"faces must have an integer dtype, got {corners.dtype}")
    return Polygons(corners.astype(np.int64), sizes)


def checked_faces(faces: object, n_vertices: int) -> Int[np.ndarray, "F 3"]:
    """`faces` as an int32 array of corner indices into `n_vertices` vertices, every one referenced.

    Raises:
        MeshError: not an integer `[F, 3]` array, empty, index out of range, a vertex twice in one face, or an
            unreferenced vertex.
    """
    array = face_array(faces)
    if n_vertices >= np.iinfo(np.int32).max // 8:
        raise MeshError(
            f"the mesh has {n_vertices} vertices; 32-bit indices allow {np.iinfo(np.int32).max // 8}"
        )

    outside = _defects.out_of_range(array, n_vertices)
    if outside.size:
        corner = array[outside[0]].tolist()
        raise MeshError(
            f"{name_first('face', outside)}: vertex index out of range 0…{n_vertices - 1} "
            f"(face {outside[0]} is {corner}); indices count from 0"
        )
    repeated = _defects.with_repeated_corner(array)
    if repeated.size:
        raise MeshError(
            f"degenerate {name_first('face', repeated)}: a vertex appears twice "
            f"(face {repeated[0]} is {array[repeated[0]].tolist()}); remove such faces"
        )
    unused = _defects.unreferenced(array, n_vertices)
    if unused.size:
        raise MeshError(f"unreferenced {name_first('vertex', unused)}: no face uses it; remove such vertices")
    return array.astype(np.int32)


def check_edges_manifold(gluing: _defects.Gluing) -> None:
    """Every edge has one face, or two that traverse it in opposite directions.

    Raises:
        MeshError: an edge with more than two faces; faces that cannot be oriented consistently (Möbius, Klein) or are not.
    """
    crowded, clashing = gluing.crowded, gluing.clashing
    if crowded.size:
        i, j = gluing.edges[crowded[0]]
        around = gluing.faces_on(crowded[0])
        raise MeshError(
            f"non-manifold edge: {len(around)} faces ({', '.join(map(str, around[:_MOST_NAMED]))}) share the edge "
            f"between vertices {i} and {j}; {crowded.size} such edge(s) in all; every edge may have at most two faces"
        )
    if not clashing.size:
        return
    i, j = gluing.edges[clashing[0]]
    pair = gluing.faces_on(clashing[0])
    where = (
        f"faces {pair[0]} and {pair[1]} traverse the edge between vertices {i} and {j} in the same direction"
    )
    _, one_sided = gluing.flips()
    if one_sided.any():
        raise MeshError(
            f"non-orientable surface: {where}, and no flipping of faces mends it (a Möbius strip or Klein bottle)"
        )
    raise MeshError(
        f"inconsistently oriented faces: {where} ({clashing.size} such edge(s)); flip faces until neighbours agree"
    )


def vertex_array(vertices: object) -> np.ndarray:
    """`vertices` as a floating array `[V, 3]` of at least one position, integers as float64.

    Raises:
        MeshError: another shape or dtype, or no vertices.
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
    return array


def checked_vertices(vertices: object) -> np.ndarray:
    """`vertices` as a floating `[V, 3]` array of finite positions.

    Raises:
        MeshError: another shape or dtype, no vertices, or a NaN or infinite coordinate.
    """
    array = vertex_array(vertices)
    bad = _defects.not_finite(array)
    if bad.size:
        raise MeshError(
            f"{name_first('vertex', bad)}: position is not finite (vertex {bad[0]} is {array[bad[0]].tolist()})"
        )
    return array


def check_areas_positive(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> None:
    """Every triangle is thicker than the rounding of its own coordinates allows to tell from a segment.

    Raises:
        MeshError: a triangle whose height is lost in the rounding of its positions, or whose sides leave its range (at the
            dtype of `vertices`).
    """
    flat = _defects.flat_faces(vertices, faces)
    with np.errstate(over="ignore"):
        extent = np.ptp(vertices[faces.ravel()], axis=0).max()
    if not 0 < extent < np.inf:
        raise MeshError("all vertices coincide, or lie too far apart for their dtype")
    beyond = _defects.beyond_range(vertices, faces)
    if beyond.size:
        raise MeshError(
            f"{name_first('face', beyond)}: sides so long or short that areas leave the range of {vertices.dtype}; "
            "rescale the mesh, or use float64"
        )
    if flat.size:
        raise MeshError(
            f"degenerate {name_first('face', flat)}: zero area (face {flat[0]} has corners "
            f"{faces[flat[0]].tolist()}); remove or merge such faces"
        )
