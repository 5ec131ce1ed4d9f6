"""A mesh file with a colour for each vertex and face: pictures that other programs can turn around."""

import os

import numpy as np
from jaxtyping import Float, Int, UInt8

from ..mesh import Attributes, write_mesh
from ._checks import checked_mesh
from ._colors import ColorScale


def save_colored_mesh(
    path: str | os.PathLike[str],
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    vertex_values: Float[np.ndarray, "V"],
    face_values: Float[np.ndarray, "F"],
) -> None:
    """Writes a binary PLY file with property `quality` and its colour at vertices and faces (MeshLab's names).

    Colours go from 0 at vertices, and from the least value at faces, up to the largest but the uppermost half per cent.

    Raises:
        ImportError: matplotlib, whose colour maps these are, is missing.
        OSError: the file cannot be written.
        ValueError: arrays that do not fit.
    """
    vertices, faces = checked_mesh(vertices, faces)
    if vertex_values.shape != vertices.shape[:1] or face_values.shape != faces.shape[:1]:
        raise ValueError(
            f"expected {len(vertices)} values at vertices and {len(faces)} at faces, "
            f"got {list(vertex_values.shape)} and {list(face_values.shape)}"
        )
    vertex, face = (
        {"quality": values.astype(np.float32), "color": _shades(values, lowest)}
        for values, lowest in ((vertex_values, 0.0), (face_values, float(face_values.min())))
    )
    write_mesh(path, vertices, faces, Attributes(vertex, face))


def _shades(values: Float[np.ndarray, " n"], lowest: float) -> UInt8[np.ndarray, "n 3"]:
    above = values - lowest
    return np.rint(255 * ColorScale.of(above)(above)).astype(np.uint8)
