"""Colour bars whose numbers and labels always have room."""

import dataclasses
import math
import textwrap
from typing import Any

from ..extras import extra
from ._colors import ColorScale, color_map
from ._figure import DPI, INK, measured

LEAST = 6
"""Least width of a bar with its numbers and label; this and the next in heights of a line of text."""
GAP, THICKNESS, RIGHT = 0.6, 0.7, 0.1
MARGIN, LENGTH = 0.12, 0.76
"""Of the bar, in heights of its picture."""
LOW, HIGH = -3, 5
"""Powers of ten between which numbers are written as they are; others are told in the label's power of ten."""
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclasses.dataclass(frozen=True)
class ColorBar:
    """An upright colour bar and what it says."""

    scale: ColorScale
    label: str

    @property
    def power(self) -> int:
        """The power of ten that the numbers are told in."""
        power = math.floor(math.log10(max(map(abs, self.scale.limits))))
        return 0 if LOW <= power < HIGH else power

    @property
    def caption(self) -> str:
        return f"{self.label}, × 10{str(self.power).translate(_SUPERSCRIPTS)}" if self.power else self.label


def bar_width(bar: ColorBar | None, height: int, text: int) -> int:
    """Pixels that a bar takes beside a picture of this height: as many as its numbers and label need in text so high."""
    if bar is None:
        return 0

    def draw(figure: Any) -> Any:
        return draw_bar(figure, bar, (0, 0), height, text).get_tightbbox()

    return max(LEAST * text, math.ceil(measured((20 * text, height), draw).x1 + RIGHT * text))


def draw_bar(figure: Any, bar: ColorBar, place: tuple[int, int], height: int, text: int) -> Any:
    """Draws a bar for a picture of this height, its upper right corner in this place; returns its axes.

    In pixels, from the page's left top.
    """
    page = figure.get_size_inches() * DPI
    x, y = place[0] + GAP * text, place[1] + (MARGIN + LENGTH) * height
    points = text * 72 / DPI
    axes = figure.add_axes(
        (x / page[0], 1 - y / page[1], THICKNESS * text / page[0], LENGTH * height / page[1])
    )
    low, high = (limit / 10.0**bar.power for limit in bar.scale.limits)
    numbers = extra("matplotlib.ticker").ScalarFormatter(useOffset=False)
    numbers.set_scientific(False)
    drawn = figure.colorbar(
        extra("matplotlib.cm").ScalarMappable(
            extra("matplotlib.colors").Normalize(low, high), color_map(bar.scale.map_name)
        ),
        cax=axes,
        ticks=extra("matplotlib.ticker").MaxNLocator(5),
        format=numbers,
        extend=bar.scale.clipped,
        extendfrac=0.04,
    )
    drawn.outline.set_visible(False)
    drawn.set_label(bar.caption, color=INK, fontsize=points * 0.85, labelpad=0.5 * points)
    _fit(axes.yaxis.label, 0.96 * height)
    axes.tick_params(labelsize=points * 0.8, labelcolor=INK, color=INK, length=0.3 * points, width=0.8)
    return axes


def _fit(label: Any, room: float) -> None:
    """Breaks a label that is too long into lines, and makes it smaller where a single word is too long."""
    text = label.get_text()
    if (length := label.get_window_extent().height) > room:
        label.set_text(
            "\n".join(
                textwrap.wrap(text, max(int(0.95 * len(text) * room / length), 1), break_long_words=False)
            )
        )
    label.set_fontsize(label.get_fontsize() * min(1.0, room / max(label.get_window_extent().height, 1.0)))
