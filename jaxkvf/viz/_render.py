"""Pictures of surfaces."""

import os
from collections.abc import Sequence

from ..arguments import checked_integer
from ..files import write_whole
from ._camera import View
from ._checks import checked_size, png_path
from ._color_bar import ColorBar, bar_width
from ._page import Panel, png_of_page, text_height
from ._pictures import color_scale, pictures_of
from ._scene import Scene

ALONE, PANEL = (1200, 900), (400, 480)
"""Pixels of one scene, and of each of several, where the size is not given."""


def render(
    path: str | os.PathLike[str],
    scenes: Scene | Sequence[Scene],
    *,
    columns: int | None = None,
    size: tuple[int, int] | None = None,
    view: View | None = None,
    same_scale: bool = True,
) -> None:
    """Writes a picture of a scene, or of several side by side: fields of one mesh, a mesh before and after, a series.

    Args:
        path: the PNG file to write; an older one is replaced.
        scenes: what to show, row by row.
        columns: how many in a row; `None` puts all into one.
        size: width and height of the whole picture in pixels; `None` is 1200 by 900 for a scene alone, and 400 by 480 for
            each of several.
        view: (direction from the meshes to the camera, up), see `view_upright`; `None` is `Y_UP`.
        same_scale: one camera for all, so that sizes and places can be compared; `False` shows each as large as fits.

    Raises:
        ValueError: there is no scene, or something in one of them, the size or the view cannot be drawn.
        FileNotFoundError: the file's folder does not exist.
        ImportError: the extra `jaxkvf[viz]` is not installed.
        RuntimeError: off-screen rendering is not available; the message says what mends it.
    """
    target = png_path(path)
    shown = [scene.checked() for scene in ([scenes] if isinstance(scenes, Scene) else scenes)]
    if not shown:
        raise ValueError("there is no scene to draw")
    columns = len(shown) if columns is None else checked_integer("columns", columns)
    rows = -(-len(shown) // columns)
    whole = ALONE if len(shown) == 1 else (PANEL[0] * columns, PANEL[1] * rows)
    width, height = checked_size(whole if size is None else size)

    row = height // rows
    text = text_height(row)
    top = 2 * text if any(scene.title or scene.color_bar for scene in shown) else 0
    bars = [
        None if scale is None or not scene.color_bar else ColorBar(scale, scene.color_bar)
        for scene, scale in zip(shown, map(color_scale, shown), strict=True)
    ]
    beside = [
        max(bar_width(bar, row - top, text) for bar in bars[column::columns]) for column in range(columns)
    ]
    panel = checked_size(((width - sum(beside)) // columns, row - top))
    places = [
        (i % columns * panel[0] + sum(beside[: i % columns]), i // columns * row + top)
        for i in range(len(shown))
    ]
    pictures = pictures_of(shown, size=panel, view=view, same_scale=same_scale)
    panels = [
        Panel(pixels, *place, scene.title, bar)
        for pixels, place, scene, bar in zip(pictures, places, shown, bars, strict=True)
    ]
    write_whole(target, png_of_page((width, height), panels, text))
