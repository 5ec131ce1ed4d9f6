"""Several fields on one mesh, side by side."""

import os
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Integer

from ..files import write_whole
from ._camera import View
from ._checks import checked_fields, checked_mesh, png_path
from ._scene import Scene
from ._series import series_page

PANEL = (480, 540)
"""Pixels of a panel where the size is not given."""


def render_fields(
    path: str | os.PathLike[str],
    vertices: Float[np.ndarray, "V 3"],
    faces: Integer[np.ndarray, "F 3"],
    vectors: Float[np.ndarray, "k V 3"],
    titles: Sequence[str] | None = None,
    *,
    size: tuple[int, int] | None = None,
    view: View | None = None,
    arrows: int = 250,
    smooth: bool = True,
) -> None:
    """Write a strip of fields side by side, from one camera, each coloured up to its own largest norm.

    Args:
        path: the PNG file to write; an older one is replaced.
        vertices: positions, of any size and place.
        faces: vertex indices, counter-clockwise.
        vectors: the fields, pointwise, in space; all are drawn: pass `vectors[:4]` for the first four.
        titles: a short caption for each, such as 'λ₀·Area = 1.2e-7'; mathematics between $ signs is typeset.
        size: width and height of the whole picture in pixels; `None` is 480 a field by 540.
        view: (direction from the mesh to the camera, up); `None` is `Y_UP`.
        arrows: how many at most on each; never more than vertices; 0 for none.
        smooth: shade with vertex normals; `False` shows the facets.

    Raises:
        ValueError: the mesh, a field, the titles, the size or the view cannot be drawn.
        FileNotFoundError: the file's folder does not exist.
        ImportError: the extra `jaxkvf[viz]` is not installed.
        RuntimeError: off-screen rendering is not available; the message says what mends it.
    """
    target = png_path(path)
    vertices, faces = checked_mesh(vertices, faces)
    fields = checked_fields(vectors, vertices)
    titles = [""] * len(fields) if titles is None else titles
    if len(titles) != len(fields):
        raise ValueError(f"titles: {len(titles)} captions for {len(fields)} fields")
    scenes = [
        Scene(vertices, faces, title, field, arrows) for field, title in zip(fields, titles, strict=True)
    ]
    page = series_page(scenes, len(scenes), size, panel=PANEL, view=view, smooth=smooth, same_scale=True)
    write_whole(target, page)
