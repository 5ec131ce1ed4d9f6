"""A mesh with an image on parts of it."""

import os

import numpy as np
from jaxtyping import Float, Integer

from ..files import write_whole
from ._camera import View
from ._checks import checked_size, png_path
from ._page import png_of
from ._photo import Texture
from ._scene import Scene, pictures_of


def render_pattern(
    path: str | os.PathLike[str],
    vertices: Float[np.ndarray, "V 3"],
    faces: Integer[np.ndarray, "F 3"],
    texture: Texture,
    *,
    size: tuple[int, int] = (1200, 900),
    view: View | None = None,
    smooth: bool = True,
) -> None:
    """Write a picture of a textured mesh: sharp even where triangles are larger than what is on them.

    Of a `jaxkvf.Pattern` it is `Texture(*patterns.texture_coordinates(made), patterns.texture(image))`; the vertices may be
    those of the relief `patterns.emboss(made, height)`.

    Args:
        path: the PNG file to write; an older one is replaced.
        vertices: positions, of any size and place.
        faces: vertex indices, counter-clockwise.
        texture: the image and where it lies.
        size: width and height in pixels.
        view: (direction from the mesh to the camera, up); `None` is `Y_UP`.
        smooth: shade with vertex normals; `False` shows the facets.

    Raises:
        ValueError: the mesh, the texture, the size or the view cannot be drawn.
        FileNotFoundError: the file's folder does not exist.
        ImportError: the extra `jaxkvf[viz]` is not installed.
        RuntimeError: off-screen rendering is not available; the message says what mends it.
    """
    target, size = png_path(path), checked_size(size)
    (pixels,) = pictures_of([Scene(vertices, faces, texture=texture)], size=size, view=view, smooth=smooth)
    write_whole(target, png_of(pixels))
