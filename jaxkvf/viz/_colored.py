"""A mesh in given colours, with curves on it."""

import os
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Integer

from ..files import write_whole
from ._camera import View, fit_camera
from ._checks import checked_mesh, checked_positions, checked_size, png_path
from ._colors import ARROW_COLOR, plain
from ._material import SOFT, STRONG
from ._page import png_of
from ._photo import Frame, Surface, photograph
from ._tubes import tubes


def render_colored(
    path: str | os.PathLike[str],
    vertices: Float[np.ndarray, "V 3"],
    faces: Integer[np.ndarray, "F 3"],
    colors: Float[np.ndarray, "V 3"] | None = None,
    *,
    curves: Sequence[Float[np.ndarray, "_ 3"]] = (),
    width: float = 0.0025,
    size: tuple[int, int] = (1200, 900),
    view: View | None = None,
    smooth: bool = True,
) -> None:
    """Write a picture of a mesh with a colour at each vertex, and dark lines along curves.

    Args:
        path: the PNG file to write; an older one is replaced.
        vertices: positions, of any size and place.
        faces: vertex indices, counter-clockwise.
        colors: sRGB, 0…1; `None` is grey.
        curves: polylines on the surface, in the same coordinates.
        width: radius of the lines, in diagonals of the mesh's bounding box.
        size: width and height in pixels.
        view: (direction from the mesh to the camera, up); `None` is `Y_UP`.
        smooth: shade with vertex normals; `False` shows the facets.

    Raises:
        ValueError: the mesh, the colours, a curve, the size or the view cannot be drawn.
        FileNotFoundError: the file's folder does not exist.
        ImportError: the extra `jaxkvf[viz]` is not installed.
        RuntimeError: off-screen rendering is not available; the message says what mends it.
    """
    target, size = png_path(path), checked_size(size)
    vertices, faces = checked_mesh(vertices, faces)
    shown = plain(len(vertices)) if colors is None else checked_positions(colors, "colors")
    if len(shown) != len(vertices) or shown.min() < 0 or shown.max() > 1:
        raise ValueError(f"colors must be {len(vertices)} rows within 0…1, one a vertex; got {len(shown)}")
    frame = Frame.around(vertices[np.unique(faces)])
    placed = frame(vertices)
    scene = [Surface(placed, faces, shown, smooth, STRONG if colors is None else SOFT)]
    lines = [frame(checked_positions(curve, "a curve")) for curve in curves]
    x, f = tubes([line for line in lines if len(line) > 1], width)
    if len(f):
        scene.append(Surface(x, f, plain(len(x), ARROW_COLOR)))
    camera = fit_camera(placed[np.unique(faces)], size, view)
    write_whole(target, png_of(photograph(scene, camera, size)))
