"""A mesh file with a colour for each vertex and face: pictures that other programs can turn around."""

import os

import numpy as np
from jaxtyping import Float, Int

from ..files import write_whole
from ._checks import checked_mesh
from ._colors import SPEED_MAP, mapped
from ._displacement import color_limits


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
    color = [(name, "u1") for name in ("red", "green", "blue")]
    vertex_type = np.dtype([(axis, "<f8") for axis in "xyz"] + [("quality", "<f4"), *color])
    face_type = np.dtype([("count", "u1"), ("corners", "<i4", 3), ("quality", "<f4"), *color])
    vertex_table, face_table = np.zeros(len(vertices), vertex_type), np.zeros(len(faces), face_type)
    for number, axis in enumerate("xyz"):
        vertex_table[axis] = vertices[:, number]
    face_table["count"], face_table["corners"] = 3, faces
    for table, values, lowest in (
        (vertex_table, vertex_values, 0.0),
        (face_table, face_values, face_values.min()),
    ):
        table["quality"] = values
        (_, span), _ = color_limits(values - lowest, signed=False)
        shades = np.rint(255 * mapped(values, (lowest, lowest + span), SPEED_MAP))
        for channel, (name, _) in enumerate(color):
            table[name] = shades[:, channel]
    colors = [f"property uchar {name}" for name, _ in color]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        "property float quality",
        *colors,
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "property float quality",
        *colors,
        "end_header\n",
    ]
    write_whole(path, "\n".join(header).encode() + vertex_table.tobytes() + face_table.tobytes())
