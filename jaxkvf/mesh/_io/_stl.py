"""Stereolithography files, STL: three corners a face, without connectivity."""

import numpy as np
from jaxtyping import Float, Int

from .._errors import MeshError
from ._text import positions, significant_lines

_HEADER_BYTES = 80
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_FACET = (b"facet", b"outer", b"vertex", b"vertex", b"vertex", b"endloop", b"endfacet")


def decode_stl(data: bytes) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
    """The faces of an ASCII or binary STL file.

    Corners with exactly equal coordinates become one vertex; no others do.

    Raises:
        MeshError: the file is damaged.
    """
    declared = int.from_bytes(data[_HEADER_BYTES : _HEADER_BYTES + 4], "little")
    expected = _HEADER_BYTES + 4 + declared * _RECORD.itemsize
    if len(data) >= _HEADER_BYTES + 4 and len(data) == expected:
        records = np.frombuffer(data, _RECORD, declared, _HEADER_BYTES + 4)
        return _merge_equal_corners(records["corners"].astype(np.float64).reshape(-1, 3))
    if data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        return _merge_equal_corners(_ascii_corners(data))
    if not data:
        raise MeshError("the file is empty")
    raise MeshError(
        "neither ASCII STL, which starts with 'solid', nor complete binary STL: its header promises "
        f"{declared} faces in {expected} bytes, the file has {len(data)}"
    )


def encode_stl(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> bytes:
    """Binary STL, which rounds positions to float32.

    Raises:
        ValueError: a position beyond the range of float32.
    """
    corners = vertices[faces]
    if not np.abs(corners).max(initial=0.0) <= np.finfo(np.float32).max:
        raise ValueError("STL stores float32, and a position is beyond its range; write OBJ, PLY or OFF")
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(faces), _RECORD)
    records["normal"] = normals / np.where(lengths > 0, lengths, 1.0)
    records["corners"] = corners
    return bytes(_HEADER_BYTES) + len(faces).to_bytes(4, "little") + records.tobytes()


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


def _merge_equal_corners(
    corners: Float[np.ndarray, "corners 3"],
) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
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
    return corners[first[by_appearance]], which.reshape(-1, 3)
