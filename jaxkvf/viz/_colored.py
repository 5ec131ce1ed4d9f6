"""A mesh in given colours."""

import os

import numpy as np
from jaxtyping import Float, Integer

from ..files import write_whole
from ._camera import View
from ._checks import checked_size, png_path
from ._page import png_of
from ._scene import Scene, pictures_of


def render_colored(
    path: str | os.PathLike[str],
    vertices: Float[np.ndarray, "V 3"],
    faces: Integer[np.ndarray, "F 3"],
    colors: Float[np.ndarray, "V 3"],
    *,
    size: tuple[int, int] = (1200, 900),
    view: View | None = None,
    smooth: bool = True,
) -> None:
    """Write a picture of a mesh with a colour at each vertex.

    Args:
        path: the PNG file to write; an older one is replaced.
        vertices: positions, of any size and place.
        faces: vertex indices, counter-clockwise.
        colors: sRGB, 0…1.
        size: width and height in pixels.
        view: (direction from the mesh to the camera, up); `None` is `Y_UP`.
        smooth: shade with vertex normals; `False` shows the facets.

    Raises:
        ValueError: the mesh, the colours, the size or the view cannot be drawn.
        FileNotFoundError: the file's folder does not exist.
        ImportError: the extra `jaxkvf[viz]` is not installed.
        RuntimeError: off-screen rendering is not available; the message says what mends it.
    """
    target, size = png_path(path), checked_size(size)
    (pixels,) = pictures_of([Scene(vertices, faces, colors=colors)], size=size, view=view, smooth=smooth)
    write_whole(target, png_of(pixels))
