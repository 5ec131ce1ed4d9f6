"""Several meshes side by side."""

import os
from collections.abc import Sequence

from ..files import write_whole
from ._camera import View
from ._checks import checked_at_least_one, checked_size, png_path
from ._page import Panel, png_of_page, text_height
from ._scene import Scene, pictures_of

PANEL = (400, 480)
"""Pixels of a panel where the size is not given."""


def render_series(
    path: str | os.PathLike[str],
    scenes: Sequence[Scene],
    *,
    columns: int | None = None,
    size: tuple[int, int] | None = None,
    view: View | None = None,
    smooth: bool = True,
    same_scale: bool = True,
) -> None:
    """Write meshes side by side, such as a shape that changes step by step, each with its field, curves or colours.

    Args:
        path: the PNG file to write; an older one is replaced.
        scenes: what to show in each panel, row by row.
        columns: how many in a row; `None` puts all into one.
        size: width and height of the whole picture in pixels; `None` is 400 by 480 a panel.
        view: (direction from the meshes to the camera, up); `None` is `Y_UP`.
        smooth: shade with vertex normals; `False` shows the facets.
        same_scale: one camera for all, so that sizes and places can be compared; `False` shows each as large as fits.

    Raises:
        ValueError: there is no scene, or one of them, the size or the view cannot be drawn.
        FileNotFoundError: the file's folder does not exist.
        ImportError: the extra `jaxkvf[viz]` is not installed.
        RuntimeError: off-screen rendering is not available; the message says what mends it.
    """
    target = png_path(path)
    columns = max(len(scenes), 1) if columns is None else checked_at_least_one("columns", columns)
    page = series_page(scenes, columns, size, panel=PANEL, view=view, smooth=smooth, same_scale=same_scale)
    write_whole(target, page)


def series_page(
    scenes: Sequence[Scene],
    columns: int,
    size: tuple[int, int] | None,
    *,
    panel: tuple[int, int],
    view: View | None,
    smooth: bool,
    same_scale: bool,
) -> bytes:
    """The scenes and their titles as a PNG file; `panel` is the size of each where the page's is `None`."""
    rows = max(-(-len(scenes) // columns), 1)
    width, height = checked_size((panel[0] * columns, panel[1] * rows) if size is None else size)
    row = height // rows
    text = text_height(row)
    top = 2 * text if any(scene.title for scene in scenes) else 0
    panel = checked_size((width // columns, row - top))
    pictures = pictures_of(scenes, size=panel, view=view, smooth=smooth, same_scale=same_scale)
    panels = [
        Panel(pixels, i % columns * panel[0], i // columns * row + top, scene.title)
        for i, (pixels, scene) in enumerate(zip(pictures, scenes, strict=True))
    ]
    return png_of_page((width, height), panels, text=text)
