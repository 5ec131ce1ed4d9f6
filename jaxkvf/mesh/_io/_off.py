"""Object File Format, OFF."""

import re

import numpy as np
from jaxtyping import Float, Int

from .._attributes import COLOR, NO_ATTRIBUTES, Attributes, color_from
from .._errors import MeshError
from .._polygons import Polygons
from .._raw import RawAttributes, RawMesh
from ._text import Lines, counted_polygons, numbers, positions, quoted, significant_lines


def decode_off(data: bytes) -> RawMesh:
    """The vertices and faces of an ASCII OFF file, also COFF, NOFF, STOFF; normals are not read.

    Raises:
        MeshError: no OFF header, fewer or more lines than it promises, or a number that is none. Messages name the line.
    """
    lines = significant_lines(data)
    if not lines.texts:
        raise MeshError("the file is empty")
    keyword, _, counts = lines.texts[0].partition(b"OFF")
    if not re.fullmatch(rb"(ST)?C?N?", keyword) or b"OFF" not in lines.texts[0]:
        raise MeshError(f"{lines.quote(0)}: an OFF file starts with the word OFF (also COFF, NOFF, STOFF)")
    if counts.strip().upper().startswith(b"BINARY"):
        raise MeshError("binary OFF is not read; save the mesh as ASCII OFF, OBJ or PLY")
    head = 1
    if not counts.strip() and len(lines.texts) > 1:
        head, counts = 2, lines.texts[1]
    n_vertices, n_faces = _counts(counts)
    body = lines.between(head, len(lines.texts))
    if len(body.texts) != n_vertices + n_faces:
        raise MeshError(
            f"the header promises {n_vertices} vertices and {n_faces} faces, a line each, but "
            f"{len(body.texts)} lines follow it: the file is truncated or damaged"
        )
    vertex_lines = body.between(0, n_vertices)
    face_lines = body.between(n_vertices, n_vertices + n_faces)
    polygons = counted_polygons(face_lines)
    return RawMesh(
        positions(vertex_lines, (0, 1, 2)),
        polygons,
        lambda i: f"{face_lines.quote(i)} is a face with",
        lambda: _attributes(keyword, vertex_lines, face_lines, polygons),
    )


def _attributes(keyword: bytes, vertex_lines: Lines, face_lines: Lines, polygons: Polygons) -> RawAttributes:
    """Colours of vertices and faces, and texture coordinates, where every line has them."""
    vertex, face, texture = {}, {}, None
    at = 6 if b"N" in keyword else 3
    columns = min((len(text.split()) for text in vertex_lines.texts), default=0)
    end = columns - 2 if b"ST" in keyword else columns
    if end - at in (3, 4) and (found := numbers(vertex_lines, range(at, end))) is not None:
        vertex = {COLOR: color_from(found)}
    if b"ST" in keyword and end >= at and (found := numbers(vertex_lines, range(end, columns))) is not None:
        inside = (polygons.corners >= 0) & (polygons.corners < len(found))
        texture = np.where(inside[:, None], found[np.where(inside, polygons.corners, 0)], 0.0)
    n = int(polygons.sizes[0]) if len(polygons.sizes) else 0
    left = min((len(text.split()) for text in face_lines.texts), default=0) - 1 - n
    if left in (3, 4) and (polygons.sizes == n).all():
        found = numbers(face_lines, range(1 + n, 1 + n + left))
        face = {} if found is None else {COLOR: color_from(found)}
    return RawAttributes(vertex, face, texture)


def encode_off(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], attributes: Attributes = NO_ATTRIBUTES
) -> bytes:
    """OFF text whose positions read back as the same doubles; COFF where vertices have colours."""
    color = attributes.vertex.get(COLOR)
    text = f"{'' if color is None else 'C'}OFF\n{len(vertices)} {len(faces)} 0\n"
    text += _lines("%r %r %r", vertices, color, opaque=True)
    text += _lines("3 %d %d %d", faces, attributes.face.get(COLOR), opaque=False)
    return text.encode("ascii")


def _lines(form: str, rows: np.ndarray, color: np.ndarray | None, *, opaque: bool) -> str:
    """A line a row, with its colour behind it; that of a vertex needs its opacity."""
    if color is None:
        return f"{form}\n" * len(rows) % tuple(rows.ravel().tolist())
    if opaque and color.shape[1] == 3:
        color = np.concatenate([color, np.full((len(color), 1), 255, np.uint8)], axis=1)
    line = form + " %d" * color.shape[1] + "\n"
    return line * len(rows) % tuple(np.concatenate([rows, color], axis=1).ravel().tolist())


def _counts(text: bytes) -> tuple[int, int]:
    """Numbers of vertices and faces; the number of edges after them may be missing, and is never right."""
    match = re.fullmatch(rb"(\d{1,18})\s+(\d{1,18})(\s+-?\d+)?", text.strip())
    if match is None:
        raise MeshError(
            f"expected the numbers of vertices, faces and edges after OFF, found {quoted(text.strip())}"
        )
    return int(match[1]), int(match[2])
