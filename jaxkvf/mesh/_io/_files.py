"""Reads and writes mesh files; the file's ending tells the format.

The formats are parsed here, on top of NumPy, since no library at hand reads them exactly and safely:
- libigl 2.6.3 crashes on PLY files with mixed polygons or an unknown type and returns arbitrary memory for truncated
  ones; its OBJ reader loses the first vertex after a byte-order mark, lets face indices overflow, fails on a comment
  behind a face and talks on stderr; its writers do not notice a full disk and round OFF to 15 digits.
- meshio 5.3 ends the process on a bad file and misreads negative OBJ indices.
- trimesh 5.2 splits quads silently and drops vertices.
"""

import os
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Int32

from ...files import write_whole
from .._attributes import NO_ATTRIBUTES, Attributes
from .._errors import MeshError, check_fits
from .._raw import RawMesh
from ._obj import decode_obj, encode_obj
from ._off import decode_off, encode_off
from ._ply import decode_ply, encode_ply
from ._stl import decode_stl, encode_stl

_DECODERS = {".obj": decode_obj, ".ply": decode_ply, ".off": decode_off, ".stl": decode_stl}
_READING_TAKES = 20  # bytes of memory for each byte of a file: text of short lines is the worst case
_ENCODERS = {".obj": encode_obj, ".ply": encode_ply, ".off": encode_off, ".stl": encode_stl}


def read_mesh(path: str | os.PathLike[str]) -> tuple[Float[np.ndarray, "V 3"], Int32[np.ndarray, "F 3"]]:
    """The vertices and triangles of an OBJ, PLY, OFF or STL file, as they stand in it.

    Order is kept, unreferenced vertices are kept, texture seams split nothing. STL alone has no connectivity:
    its corners with exactly equal coordinates become one vertex.

    Args:
        path: the file; its ending, in upper or lower case, tells the format.

    Returns:
        Positions, float64 `[V, 3]`, in the file's unit, and corners of faces, int32 `[F, 3]`, counted from 0.

    Raises:
        OSError: the file cannot be read.
        MeshError: unknown ending, or content that is damaged or no triangle mesh; the message names the path
            and what is wrong. Whether the triangles form an oriented manifold is not looked at.
    """
    raw = read_raw(path)
    try:
        faces = raw.triangles
        _check_arrays(raw.vertices, faces)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    return raw.vertices, faces.astype(np.int32)


def read_attributes(path: str | os.PathLike[str]) -> Attributes:
    """The colours, scalars and texture coordinates in the file of a triangle mesh; normals are none, they follow from it.

    Raises:
        OSError: the file cannot be read.
        MeshError: content that is damaged or no triangle mesh.
    """
    raw = read_raw(path)
    corners = np.arange(raw.triangles.size).reshape(-1, 3)
    return raw.attributes().gather(np.arange(len(raw.vertices)), np.arange(len(corners)), corners)


def read_raw(path: str | os.PathLike[str]) -> RawMesh:
    """What stands in a mesh file, whether or not corners are in range, positions finite, or anything is there at all.

    Raises:
        OSError: the file cannot be read.
        MeshError: unknown ending, or content that is damaged.
    """
    file = Path(path)
    decode = _DECODERS.get(file.suffix.lower())
    if decode is None:
        raise MeshError(f"{file}: {_unknown_ending(file)}")
    check_fits(_READING_TAKES * file.stat().st_size, f"reading {file}")
    try:
        return decode(file.read_bytes())
    except MeshError as error:
        raise MeshError(f"{file}: {error}") from None


def write_mesh(
    path: str | os.PathLike[str],
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    attributes: Attributes = NO_ATTRIBUTES,
) -> None:
    """Writes an OBJ, PLY (binary), OFF or STL (binary) file.

    OBJ, PLY and OFF hold every bit of float64 positions; STL rounds to float32. The file is written under a
    temporary name in the same folder and then renamed, so that nobody sees a part of it.

    Args:
        path: the file; its ending, in upper or lower case, tells the format. An existing file is replaced.
        vertices: positions, `[V, 3]`.
        faces: corners of the faces, `[F, 3]`, counted from 0.
        attributes: colours, scalars and texture coordinates to write beside them.

    Raises:
        ValueError: unknown ending, attributes that do not fit the mesh, or that the format does not hold.
        MeshError: no faces, a position that is not finite, or a corner out of range: `read_mesh` would refuse the file.
        OSError: the file cannot be written; nothing is left behind and an existing file stays as it was.
    """
    file = Path(path)
    encode = _ENCODERS.get(file.suffix.lower())
    if encode is None:
        raise ValueError(f"{file}: {_unknown_ending(file)}")
    vertices = vertices.astype(np.float64)
    _check_arrays(vertices, faces)
    attributes.check(len(vertices), len(faces))
    _, lost = attributes.held_by(file.suffix.lower())
    if lost:
        raise ValueError(f"{file}: the format holds no {', '.join(lost)}; take what Attributes.held_by gives")
    write_whole(file, encode(vertices, faces, attributes))


def _unknown_ending(file: Path) -> str:
    ending = f"the ending '{file.suffix}' is" if file.suffix else "a file without an ending is"
    return f"{ending} no known mesh format; known are {', '.join(_DECODERS)}"


def _check_arrays(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> None:
    """Something is there, finite, and within range."""
    if not len(vertices):
        raise MeshError("there are no vertices")
    if not len(faces):
        raise MeshError("there are no faces")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if bad.size:
        raise MeshError(
            f"vertex {bad[0]} (counted from 0) is not finite: {vertices[bad[0]].tolist()} "
            f"({bad.size} of the {len(vertices)} vertices are not)"
        )
    outside = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))
    if outside.size:
        raise MeshError(
            f"face {outside[0]} (counted from 0) has corners {faces[outside[0]].tolist()}, but vertices are "
            f"numbered from 0 to {len(vertices) - 1} ({outside.size} of the {len(faces)} faces are outside)"
        )
