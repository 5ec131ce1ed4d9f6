"""matplotlib without its global state."""

import io
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import UInt8

from ..extras import extra

DPI = 100
INK = "#26262b"


def png_of(pixels: UInt8[np.ndarray, "H W 3"]) -> bytes:
    """The pixels as a PNG file."""
    file = io.BytesIO()
    extra("matplotlib.image").imsave(file, np.ascontiguousarray(pixels), format="png")
    return file.getvalue()


def png_of_figure(size: tuple[int, int], draw: Callable[[Any], None]) -> bytes:
    """What `draw` does to a white figure of exactly `size` pixels, whatever style the caller has set for matplotlib."""

    def pixels(figure: Any, canvas: Any) -> bytes:
        draw(figure)
        canvas.draw()
        return png_of(np.asarray(canvas.buffer_rgba())[:, :, :3])

    return _with_figure(size, pixels)


def measured(size: tuple[int, int], draw: Callable[[Any], Any]) -> Any:
    """What `draw` finds about a figure that is thrown away."""
    return _with_figure(size, lambda figure, _: draw(figure))


def _with_figure(size: tuple[int, int], use: Callable[[Any, Any], Any]) -> Any:
    matplotlib, figures = extra("matplotlib"), extra("matplotlib.figure")
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        inches = (
            (size[0] + 1e-6) / DPI,
            (size[1] + 1e-6) / DPI,
        )  # or 115 pixels are 1.15 inches are 114 pixels
        figure = figures.Figure(figsize=inches, dpi=DPI, facecolor="white")
        canvas = extra("matplotlib.backends.backend_agg").FigureCanvasAgg(figure)
        return use(figure, canvas)
