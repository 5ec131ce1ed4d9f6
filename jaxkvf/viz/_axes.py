"""Axes without clutter, and colours for curves that colour-blind readers tell apart (Okabe and Ito)."""

from typing import Any

from ..extras import extra
from ._figure import INK

SERIES_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
MARKERS = ("o", "s", "^", "D", "v", "P")
KNOWN = "#cfcfd6"
"""Of what is known from elsewhere: drawn broad, under the rest."""
FONT_SIZE = 12.5


def bare_axes(axes: Any, x_label: str, y_label: str) -> Any:
    """The axes with a light grid and no frame."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#9a9aa2")
    axes.grid(color="#e4e4e8", lw=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, labelsize=FONT_SIZE * 0.9, color="#9a9aa2")
    axes.set_xlabel(x_label, color=INK, fontsize=FONT_SIZE)
    axes.set_ylabel(y_label, color=INK, fontsize=FONT_SIZE)
    return axes


def logarithmic(axis: Any) -> None:
    """Plain numbers at 1, 2 and 5 where the axis spans less than two decades, and powers of ten elsewhere."""
    low, high = axis.get_view_interval()
    if high < 100 * low:
        axis.set_major_locator(extra("matplotlib.ticker").LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:,g}")
    axis.set_minor_formatter(extra("matplotlib.ticker").NullFormatter())


def legend(axes: Any, place: str) -> None:
    axes.legend(loc=place, frameon=False, fontsize=FONT_SIZE, labelcolor=INK)
