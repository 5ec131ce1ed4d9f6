"""Stereolithography files, STL: three corners a face, without connectivity."""

import numpy as np
from jaxtyping import Float, Int

from .._attributes import NO_ATTRIBUTES, Attributes
from .._defects import flat_faces
from .._errors import MeshError
from .._polygons import Polygons
from .._raw import RawMesh
from ._text import positions, significant_lines

_HEADER_BYTES = 80
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_MOST_ROUNDING = 0.01  # of the usual edge
_FACET = (b"facet", b"outer", b"vertex", b"vertex", b"vertex", b"endloop", b"endfacet")


def decode_stl(data: bytes) -> RawMesh:
    """The faces of an ASCII or binary STL file.

    Corners with exactly equal coordinates become one vertex; no others do.

    Raises:
        MeshError: the file is damaged.
    """
    declared = int.from_bytes(data[_HEADER_BYTES : _HEADER_BYTES + 4], "little")
    expected = _HEADER_BYTES + 4 + declared * _RECORD.itemsize
    if len(data) >= _HEADER_BYTES + 4 and len(data) == expected:
        records = np.frombuffer(data, _RECORD, declared, _HEADER_BYTES + 4)
        return _merge_equal_corners(records["corners"].astype(np.float64).reshape(-1, 3), single=True)
    if data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        return _merge_equal_corners(_ascii_corners(data), single=False)
    if not data:
        raise MeshError("the file is empty")
    raise MeshError(
        "neither ASCII STL, which starts with 'solid', nor complete binary STL: its header promises "
        f"{declared} faces in {expected} bytes, the file has {len(data)}"
    )


def encode_stl(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], attributes: Attributes = NO_ATTRIBUTES
) -> bytes:
    """Binary STL, which rounds positions to float32.

    Raises:
        ValueError: a position beyond the range of float32.
        MeshError: rounding would merge vertices, flatten faces or turn them over, or move vertices by 1 % of an edge.
    """
    del attributes  # it has none
    corners = vertices[faces]
    if not np.abs(corners).max(initial=0.0) <= np.finfo(np.float32).max:
        raise ValueError("STL stores float32, and a position is beyond its range; write OBJ, PLY or OFF")
    _check_rounding(vertices, faces)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(faces), _RECORD)
    records["normal"] = normals / np.where(lengths > 0, lengths, 1.0)
    records["corners"] = corners
    return bytes(_HEADER_BYTES) + len(faces).to_bytes(4, "little") + records.tobytes()


def _check_rounding(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> None:
    harm = _harm_of_rounding(vertices, faces)
    if harm is None:
        return
    with np.errstate(over="ignore"):
        centred = vertices - (vertices.min(axis=0) / 2 + vertices.max(axis=0) / 2)
    remedy = "write OBJ, PLY or OFF"
    if _harm_of_rounding(centred, faces) is None:
        remedy += ", or move the mesh to the origin first: repair(…, to_origin=True)"
    raise MeshError(f"STL stores float32, which {harm}; {remedy}")


def _harm_of_rounding(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> str | None:
    """What rounding to float32 would do to vertices at different positions, and to faces that are not flat."""
    used = vertices[np.unique(faces)]
    rounded = vertices.astype(np.float32).astype(np.float64)
    n_before = len(np.unique(used, axis=0))
    merged = n_before - len(np.unique(used.astype(np.float32), axis=0))
    if merged:
        return f"would merge {merged} of the {n_before} vertices with others"
    flat = np.setdiff1d(flat_faces(rounded, faces), flat_faces(vertices, faces))
    before, after = (
        np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
        for x in (vertices / np.abs(vertices).max(), rounded / np.abs(vertices).max())
    )
    turned = np.union1d(flat, np.flatnonzero((before * after).sum(axis=1) < 0))
    if turned.size:
        return f"would flatten or turn over {len(turned)} of the {len(faces)} faces"
    moved = np.abs(rounded - vertices)[np.unique(faces)].max()
    edge = np.median(np.linalg.norm(vertices[faces[:, 1]] - vertices[faces[:, 0]], axis=1))
    if moved > _MOST_ROUNDING * edge:
        return f"would move vertices by up to {moved:.1g}, beside edges of {edge:.1g}"
    return None


def _ascii_corners(data: bytes) -> Float[np.ndarray, "corners 3"]:
    lines = significant_lines(data)
    keywords = [text.split(None, 1)[0].lower() for text in lines.texts]
    if keywords[-1] != b"endsolid":
        raise MeshError(
            f"the file ends at line {lines.numbers[-1]} without 'endsolid': it is truncated or damaged"
        )
    body = lines.where([word not in (b"solid", b"endsolid") for word in keywords])
    found = [word for word in keywords if word not in (b"solid", b"endsolid")]
    wanted = list(_FACET) * (-(-len(found) // len(_FACET)))
    for i, (word, right) in enumerate(zip(found, wanted, strict=False)):
        if word != right:
            hint = ": only triangles are read" if word == b"vertex" else ""
            raise MeshError(f"{body.quote(i)}, expected '{right.decode()}'{hint}")
    if len(found) != len(wanted):
        raise MeshError(f"the last face, up to line {body.numbers[-1]}, has no '{wanted[-1].decode()}'")
    return positions(body.where([word == b"vertex" for word in found]), (1, 2, 3))


def _merge_equal_corners(corners: Float[np.ndarray, "corners 3"], *, single: bool) -> RawMesh:
    """One vertex for each distinct position, in order of first appearance."""
    order = np.lexsort(corners.T)
    in_order = corners[order]
    starts = np.append(True, (in_order[1:] != in_order[:-1]).any(axis=1))[: len(corners)]
    first = order[starts]  # the sort is stable: the first appearance of each position
    by_appearance = np.argsort(first)
    rank = np.empty_like(by_appearance)
    rank[by_appearance] = np.arange(len(first))
    which = np.empty_like(order)
    which[order] = rank[np.cumsum(starts) - 1]
    notes = [f"STL: {len(corners)} corners, at equal positions merged into {len(first)} vertices"]
    largest = np.abs(corners[np.isfinite(corners)]).max(initial=0.0)
    if single and largest:
        notes.append(
            f"STL: positions in single precision, rounded by up to {np.spacing(np.float32(largest)) / 2:.1g}"
        )
    return RawMesh(corners[first[by_appearance]], Polygons.of_rows(which.reshape(-1, 3)), notes=tuple(notes))
