"""A vector field on a mesh: colour for its speed, arrows for its direction."""

import os

import numpy as np
from jaxtyping import Float, Integer

from ..files import write_whole
from ._camera import View
from ._checks import checked_size, png_path
from ._page import png_of
from ._scene import Scene, pictures_of


def render_field(
    path: str | os.PathLike[str],
    vertices: Float[np.ndarray, "V 3"],
    faces: Integer[np.ndarray, "F 3"],
    vectors: Float[np.ndarray, "V 3"],
    *,
    size: tuple[int, int] = (1200, 900),
    view: View | None = None,
    arrows: int = 500,
    smooth: bool = True,
) -> None:
    """Write a picture of a field on a mesh, coloured from 0 (dark) to the largest norm (yellow), with arrows.

    The arrows stand at points spread evenly over the surface, not at the vertices, and their lengths are
    proportional to the norm: the norm of a Killing field is the speed of its flow.

    Args:
        path: the PNG file to write; an older one is replaced.
        vertices: positions, of any size and place.
        faces: vertex indices, counter-clockwise.
        vectors: the field, pointwise, in space; its unit does not matter.
        size: width and height in pixels.
        view: (direction from the mesh to the camera, up); `None` is `Y_UP`.
        arrows: how many at most, on both sides of the object; never more than vertices; 0 for none.
        smooth: shade with vertex normals; `False` shows the facets.

    Raises:
        ValueError: the mesh, the field, the size or the view cannot be drawn.
        FileNotFoundError: the file's folder does not exist.
        ImportError: the extra `jaxkvf[viz]` is not installed.
        RuntimeError: off-screen rendering is not available; the message says what mends it.
    """
    target, size = png_path(path), checked_size(size)
    scene = Scene(vertices, faces, vectors=vectors, arrows=arrows)
    (pixels,) = pictures_of([scene], size=size, view=view, smooth=smooth)
    write_whole(target, png_of(pixels))
