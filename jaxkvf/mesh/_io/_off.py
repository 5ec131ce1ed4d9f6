"""Object File Format, OFF."""

import re

import numpy as np
from jaxtyping import Float, Int

from .._errors import MeshError
from ._text import positions, quoted, significant_lines, triangles


def decode_off(data: bytes) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
    """The vertices and faces of an ASCII OFF file, also COFF, NOFF, STOFF; their attributes are not read.

    Raises:
        MeshError: no OFF header, fewer or more lines than it promises, a number that is none, or a face that
            is not a triangle. Messages name the line.
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
    vertices = positions(body.between(0, n_vertices), (0, 1, 2))
    return vertices, triangles(body.between(n_vertices, n_vertices + n_faces))


def encode_off(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> bytes:
    """OFF text whose numbers read back as the same doubles."""
    text = f"OFF\n{len(vertices)} {len(faces)} 0\n"
    text += "%r %r %r\n" * len(vertices) % tuple(vertices.ravel().tolist())
    text += "3 %d %d %d\n" * len(faces) % tuple(faces.ravel().tolist())
    return text.encode("ascii")


def _counts(text: bytes) -> tuple[int, int]:
    """Numbers of vertices and faces; the number of edges after them may be missing, and is never right."""
    match = re.fullmatch(rb"(\d{1,18})\s+(\d{1,18})(\s+-?\d+)?", text.strip())
    if match is None:
        raise MeshError(
            f"expected the numbers of vertices, faces and edges after OFF, found {quoted(text.strip())}"
        )
    return int(match[1]), int(match[2])
