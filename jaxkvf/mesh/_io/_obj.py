"""Wavefront OBJ."""

import re

import numpy as np
from jaxtyping import Float, Int

from .._errors import MeshError
from ._text import Lines, check_triangles, integers, positions, quoted, significant_lines

# Statements of the format that do not bear on the triangles: attributes, groups, materials, curves.
_OTHER_STATEMENTS = frozenset(
    b"vt vn vp p l g s o mg mtllib usemtl maplib usemap bevel c_interp d_interp lod shadow_obj trace_obj "
    b"ctech stech cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con call csh".split()
)


def decode_obj(data: bytes) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
    """The `v` vertices of an OBJ file, in their order, and its `f` faces.

    Texture coordinates and normals have indices of their own, so their seams split no vertex. Colours or
    a weight behind the coordinates are not read, nor are points and lines.

    Raises:
        MeshError: a line that is no OBJ statement, a number that is none, a face that is not a triangle, or a
            vertex number out of range. Messages name the line.
    """
    lines = significant_lines(_join_continued_lines(data))
    statements = [text.split(None, 1)[0] for text in lines.texts]
    unknown = set(statements) - _OTHER_STATEMENTS - {b"v", b"f", b"fo"}
    if unknown:
        first = min(map(statements.index, unknown))
        raise MeshError(f"line {lines.numbers[first]} is no OBJ statement: {quoted(lines.texts[first])}")
    vertex_lines = lines.where([statement == b"v" for statement in statements])
    face_lines = lines.where([statement in (b"f", b"fo") for statement in statements])
    vertices = positions(vertex_lines, (1, 2, 3))
    return vertices, _absolute_indices(_vertex_numbers(face_lines), vertex_lines, face_lines)


def encode_obj(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> bytes:
    """OBJ text whose numbers read back as the same doubles."""
    text = "v %r %r %r\n" * len(vertices) % tuple(vertices.ravel().tolist())
    text += "f %d %d %d\n" * len(faces) % tuple((faces + 1).ravel().tolist())
    return text.encode("ascii")


def _join_continued_lines(data: bytes) -> bytes:
    r"""Joins a line that ends in `\` to the next, and keeps the count of lines by blank ones behind it."""
    first, *rest = re.split(rb"\\(?:\r\n|\n|\r)", data)
    joined, owed = [first], 0
    for piece in rest:
        owed += 1
        end = re.search(rb"[\r\n]", piece)
        if end is None:
            joined += [b" ", piece]
        else:
            joined += [b" ", piece[: end.start()], b"\n" * owed, piece[end.start() :]]
            owed = 0
    return b"".join(joined)


def _vertex_numbers(faces: Lines) -> Int[np.ndarray, "F 3"]:
    """The vertex numbers of faces written `f 1/5/2 3//7 2`: 1, 3 and 2."""
    bare = re.sub(rb"/\S*", b"", b"\n".join(faces.texts)).split(b"\n") if faces.texts else []
    check_triangles(faces, np.array([len(face.split()) - 1 for face in bare], dtype=np.int64))
    return integers(faces, bare, (1, 2, 3))


def _absolute_indices(
    numbers: Int[np.ndarray, "F 3"], vertex_lines: Lines, face_lines: Lines
) -> Int[np.ndarray, "F 3"]:
    """Indices from 0; the file's count from 1, or if negative backwards from the last vertex so far."""
    above = np.searchsorted(np.asarray(vertex_lines.numbers), np.asarray(face_lines.numbers))
    indices = np.where(numbers < 0, above[:, None] + numbers, numbers - 1)
    n_vertices = len(vertex_lines.numbers)
    outside = np.flatnonzero(((indices < 0) | (indices >= n_vertices) | (numbers == 0)).any(axis=1))
    if outside.size:
        raise MeshError(
            f"{face_lines.quote(outside[0])} names a vertex that does not exist; the file has {n_vertices} "
            "vertices, numbered from 1 (or from −1 backwards)"
        )
    return indices
