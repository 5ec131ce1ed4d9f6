"""Pictures and plots on a white page, with captions and a colour bar: matplotlib without its global state."""

import dataclasses
import io
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from jaxtyping import UInt8

from ._colors import color_map
from ._extras import extra

DPI = 100
INK = "#26262b"


@dataclasses.dataclass(frozen=True)
class Panel:
    """A picture, its left top corner at (x, y) pixels from the page's left top, and a caption above it."""

    pixels: UInt8[np.ndarray, "H W 3"]
    x: int
    y: int
    caption: str = ""


@dataclasses.dataclass(frozen=True)
class ColorBar:
    """An upright colour bar in the box (x, y, width, height), in pixels from the page's left top.

    `clipped` says which ends also stand for values beyond the limits.
    """

    box: tuple[float, float, float, float]
    limits: tuple[float, float]
    map_name: str
    label: str
    clipped: Literal["neither", "max", "both"]


def text_height(page_height: int) -> int:
    """Height of a line of text in pixels: legible when the page is shown at half its size."""
    return int(np.clip(round(0.036 * page_height), 11, 40))


def png_of(pixels: UInt8[np.ndarray, "H W 3"]) -> bytes:
    """The pixels as a PNG file."""
    file = io.BytesIO()
    extra("matplotlib.image").imsave(file, np.ascontiguousarray(pixels), format="png")
    return file.getvalue()


def png_of_page(
    size: tuple[int, int], panels: Sequence[Panel], bar: ColorBar | None = None, *, text: int | None = None
) -> bytes:
    """The page as a PNG file of exactly `size` pixels; `text` is the height of a line, by default the page's."""
    text = text_height(size[1]) if text is None else text

    def draw(figure: Any) -> None:
        captions = [_place(figure, panel, size, text) for panel in panels]
        room = min(
            0.94 * panel.pixels.shape[1] / max(caption.get_window_extent().width, 1.0)
            for panel, caption in zip(panels, captions, strict=True)
        )
        for caption in captions:
            caption.set_fontsize(caption.get_fontsize() * min(1.0, room))
        if bar is not None:
            _draw_bar(figure, bar, size, text * 72 / DPI)

    return png_of_figure(size, draw)


def png_of_figure(size: tuple[int, int], draw: Callable[[Any], None]) -> bytes:
    """What `draw` does to a white figure of exactly `size` pixels, whatever style the caller has set for matplotlib."""
    matplotlib, figures = extra("matplotlib"), extra("matplotlib.figure")
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        figure = figures.Figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI, facecolor="white")
        canvas = extra("matplotlib.backends.backend_agg").FigureCanvasAgg(figure)
        draw(figure)
        canvas.draw()
        return png_of(np.asarray(canvas.buffer_rgba())[:, :, :3])


def _place(figure: Any, panel: Panel, size: tuple[int, int], text: int) -> Any:
    """Puts a picture on the page; returns its caption."""
    width, height = size
    rows, columns = panel.pixels.shape[:2]
    figure.figimage(panel.pixels, xo=panel.x, yo=height - panel.y - rows, origin="upper")
    return figure.text(
        (panel.x + columns / 2) / width,
        1 - (panel.y - 0.3 * text) / height,
        panel.caption,
        ha="center",
        va="bottom",
        color=INK,
        fontsize=text * 72 / DPI,
    )


def _draw_bar(figure: Any, bar: ColorBar, size: tuple[int, int], points: float) -> None:
    width, height = size
    x, y, bar_width, bar_height = bar.box
    axes = figure.add_axes((x / width, 1 - (y + bar_height) / height, bar_width / width, bar_height / height))
    scale = extra("matplotlib.colors").Normalize(*bar.limits)
    drawn = figure.colorbar(
        extra("matplotlib.cm").ScalarMappable(scale, color_map(bar.map_name)),
        cax=axes,
        ticks=extra("matplotlib.ticker").MaxNLocator(5),
        extend=bar.clipped,
        extendfrac=0.04,
    )
    drawn.outline.set_visible(False)
    drawn.set_label(bar.label, color=INK, fontsize=points * 0.85, labelpad=0.5 * points)
    axes.tick_params(labelsize=points * 0.8, labelcolor=INK, color=INK, length=0.3 * points, width=0.8)
