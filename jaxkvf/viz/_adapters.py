"""The mesh and its fields as objects of other libraries, for people who live there."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, Integer

from ..extras import extra
from ._checks import checked_mesh, checked_point_data


def to_pyvista(
    vertices: Float[np.ndarray, "V 3"],
    faces: Integer[np.ndarray, "F 3"],
    point_data: Mapping[str, object] | None = None,
) -> Any:
    """A `pyvista.PolyData` with arrays at its points: `to_pyvista(x, f, {"U0": fields.vectors[0]}).glyph(orient="U0")`.

    Args:
        vertices: positions.
        faces: vertex indices, counter-clockwise.
        point_data: arrays `[V]` or `[V, c]`, such as λ's fields or their norms, by name.

    Raises:
        ValueError: the mesh cannot be drawn, or an array has not one row per vertex.
        ImportError: pyvista is not installed.
    """
    vertices, faces, arrays = _checked(vertices, faces, point_data)
    mesh = extra("pyvista").PolyData.from_regular_faces(vertices, faces)
    for name, values in arrays.items():
        mesh.point_data[name] = values
    return mesh


def to_trimesh(
    vertices: Float[np.ndarray, "V 3"],
    faces: Integer[np.ndarray, "F 3"],
    point_data: Mapping[str, object] | None = None,
) -> Any:
    """A `trimesh.Trimesh` with arrays in its `vertex_attributes`; its vertices are these, in this order.

    trimesh writes the arrays into PLY files too. Arguments and errors as for `to_pyvista`.
    """
    vertices, faces, arrays = _checked(vertices, faces, point_data)
    return extra("trimesh").Trimesh(vertices, faces, vertex_attributes=arrays, process=False)


def _checked(
    vertices: Float[np.ndarray, "V 3"],
    faces: Integer[np.ndarray, "F 3"],
    point_data: Mapping[str, object] | None,
) -> tuple[Float[np.ndarray, "V 3"], Integer[np.ndarray, "F 3"], dict[str, np.ndarray]]:
    vertices, faces = checked_mesh(vertices, faces)
    return vertices, faces, checked_point_data(point_data or {}, vertices)
