"""Pictures on a white page, with captions and colour bars."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import UInt8

from ._color_bar import ColorBar, draw_bar
from ._figure import DPI, INK, png_of_figure


@dataclasses.dataclass(frozen=True)
class Panel:
    """A picture, its left top corner at (x, y) pixels from the page's left top, a caption above it and a bar beside it."""

    pixels: UInt8[np.ndarray, "H W 3"]
    x: int
    y: int
    caption: str = ""
    bar: ColorBar | None = None


def text_height(page_height: int) -> int:
    """Height of a line of text in pixels: legible when the page is shown at half its size."""
    return int(np.clip(round(0.036 * page_height), 11, 40))


def png_of_page(size: tuple[int, int], panels: Sequence[Panel], text: int) -> bytes:
    """The page as a PNG file of exactly `size` pixels; `text` is the height of a line."""

    def draw(figure: Any) -> None:
        captions = [_place(figure, panel, size, text) for panel in panels]
        room = min(
            0.94 * panel.pixels.shape[1] / max(caption.get_window_extent().width, 1.0)
            for panel, caption in zip(panels, captions, strict=True)
        )
        for caption in captions:
            caption.set_fontsize(caption.get_fontsize() * min(1.0, room))
        for panel in panels:
            if panel.bar is not None:
                height, width = panel.pixels.shape[:2]
                draw_bar(figure, panel.bar, (panel.x + width, panel.y), height, text)

    return png_of_figure(size, draw)


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
