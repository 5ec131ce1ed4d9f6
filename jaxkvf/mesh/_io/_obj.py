"""Wavefront OBJ."""

import re

import numpy as np
from jaxtyping import Float, Int

from .._attributes import COLOR, NO_ATTRIBUTES, Attributes, color_from
from .._errors import MeshError
from .._polygons import Polygons
from .._raw import RawAttributes, RawMesh
from ._text import Lines, numbers, polygons, positions, quoted, significant_lines

# Statements of the format that do not bear on the triangles: attributes, groups, materials, curves.
_OTHER_STATEMENTS = frozenset(
    b"vt vn vp p l g s o mg mtllib usemtl maplib usemap bevel c_interp d_interp lod shadow_obj trace_obj "
    b"ctech stech cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con call csh".split()
)


def decode_obj(data: bytes) -> RawMesh:
    """The `v` vertices of an OBJ file, in their order, and its `f` faces.

    Texture coordinates and normals have indices of their own, so their seams split no vertex. A weight behind the
    coordinates is not read, nor are normals, points and lines.

    Raises:
        MeshError: a line that is no OBJ statement, a number that is none, or a vertex number out of range. Messages name
            the line.
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
    bare = re.sub(rb"/\S*", b"", b"\n".join(face_lines.texts)).split(b"\n") if face_lines.texts else []
    sizes = np.array([len(face.split()) - 1 for face in bare], dtype=np.int64)
    corners = polygons(face_lines, bare, sizes, 1)
    indices = _absolute_indices(corners, np.repeat(np.arange(len(sizes)), sizes), vertex_lines, face_lines)

    def attributes() -> RawAttributes:
        color = None
        if len(vertex_lines.texts) and len(vertex_lines.texts[0].split()) >= 7:
            color = numbers(vertex_lines, (4, 5, 6))
        texture_lines = lines.where([statement == b"vt" for statement in statements])
        return RawAttributes(
            {} if color is None else {COLOR: color_from(color)}, {}, _texture(texture_lines, face_lines)
        )

    return RawMesh(
        vertices, Polygons(indices, sizes), lambda i: f"{face_lines.quote(i)} is a face with", attributes
    )


def encode_obj(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], attributes: Attributes = NO_ATTRIBUTES
) -> bytes:
    """OBJ text whose positions read back as the same doubles; colours 0…1 stand behind them, as many programs read them."""
    color = attributes.vertex.get(COLOR)
    if color is None:
        text = "v %r %r %r\n" * len(vertices) % tuple(vertices.ravel().tolist())
    else:
        table = np.concatenate([vertices, np.round(color / 255, 4)], axis=1)
        text = "v %r %r %r %g %g %g\n" * len(vertices) % tuple(table.ravel().tolist())
    numbers_of = np.repeat(faces[..., None] + 1, 1 if attributes.texture is None else 2, axis=2)
    corner = "%d"
    if attributes.texture is not None:
        uv, which = np.unique(attributes.texture.reshape(-1, 2), axis=0, return_inverse=True)
        text += "vt %.9g %.9g\n" * len(uv) % tuple(uv.ravel().tolist())
        numbers_of[..., 1] = which.reshape(faces.shape) + 1
        corner = "%d/%d"
    text += f"f {corner} {corner} {corner}\n" * len(faces) % tuple(numbers_of.ravel().tolist())
    return text.encode("ascii")


def _texture(texture_lines: Lines, face_lines: Lines) -> Float[np.ndarray, "C 2"] | None:
    """Texture coordinates at all corners; None unless each corner names some that exist."""
    if not texture_lines.texts:
        return None
    places = numbers(texture_lines, (1, 2))
    tokens = [token.split(b"/") for text in face_lines.texts for token in text.split()[1:]]
    counts = [len(text.split()) - 1 for text in face_lines.texts]
    try:
        named = np.array([int(token[1]) for token in tokens], np.int64)
    except (IndexError, ValueError, OverflowError):
        return None
    above = np.searchsorted(np.asarray(texture_lines.numbers), np.asarray(face_lines.numbers))
    indices = np.where(named < 0, np.repeat(above, counts) + named, named - 1)
    if places is None or ((indices < 0) | (indices >= len(places))).any():
        return None
    return places[indices]


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


def _absolute_indices(
    numbers: Int[np.ndarray, " C"], face_of: Int[np.ndarray, " C"], vertex_lines: Lines, face_lines: Lines
) -> Int[np.ndarray, " C"]:
    """Indices from 0; the file's count from 1, or if negative backwards from the last vertex so far."""
    above = np.searchsorted(np.asarray(vertex_lines.numbers), np.asarray(face_lines.numbers))
    indices = np.where(numbers < 0, above[face_of] + numbers, numbers - 1)
    n_vertices = len(vertex_lines.numbers)
    outside = face_of[(indices < 0) | (indices >= n_vertices) | (numbers == 0)]
    if outside.size:
        raise MeshError(
            f"{face_lines.quote(outside[0])} names a vertex that does not exist; the file has {n_vertices} "
            "vertices, numbered from 1 (or from −1 backwards)"
        )
    return indices
