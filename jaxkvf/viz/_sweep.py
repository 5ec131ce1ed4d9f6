"""How something changes with a parameter: energy with noise, eigenvalues with a shape, time with size."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from ..files import write_whole
from ._axes import KNOWN, MARKERS, SERIES_COLORS, bare_axes, legend, logarithmic
from ._checks import checked_series, checked_size, png_path
from ._figure import png_of_figure

FEW = 8
"""Up to as many values of the parameter are the ticks of a logarithmic axis."""


def plot_sweep(
    path: str | os.PathLike[str],
    parameter: Float[np.ndarray, "n"],
    curves: Mapping[str, Float[np.ndarray, "_"]],
    references: Mapping[str, Float[np.ndarray, "_"]] | None = None,
    *,
    x_label: str = "",
    y_label: str = "",
    log_x: bool = False,
    log_y: bool = False,
    size: tuple[int, int] = (900, 560),
) -> None:
    """Write a plot of some quantities against a parameter, such as λ·area against the noise on a mesh.

    Args:
        path: the PNG file to write; an older one is replaced.
        parameter: its values.
        curves: a value for each of them, under the name that the legend gives the curve, as points joined by lines; at
            most six curves.
        references: what is known from elsewhere, as broad grey lines under the curves; the name "" keeps one out of the
            legend.
        x_label, y_label: of the axes.
        log_x, log_y: logarithmic axes; values that are not positive are then left out.
        size: width and height in pixels.

    Raises:
        ValueError: a curve that is empty, not finite, or of another length than the parameter; too many of them; the size.
        FileNotFoundError: the file's folder does not exist.
        ImportError: the extra `jaxkvf[viz]` is not installed.
    """
    target, size = png_path(path), checked_size(size)
    x = checked_series({"parameter": parameter}, 1)["parameter"]
    known = checked_series(references, 6, length=len(x)) if references else {}
    found = checked_series(curves, len(SERIES_COLORS), length=len(x))

    def draw(figure: Any) -> None:
        figure.set_layout_engine("constrained")
        axes = bare_axes(figure.add_subplot(), x_label, y_label)
        axes.set_xscale("log" if log_x else "linear")
        axes.set_yscale("log" if log_y else "linear")
        for name, values in known.items():
            axes.plot(x, _shown(values, log_y), color=KNOWN, lw=6, solid_capstyle="round", label=name)
        for (name, values), color, marker in zip(found.items(), SERIES_COLORS, MARKERS, strict=False):
            axes.plot(x, _shown(values, log_y), color=color, marker=marker, ms=5.5, lw=1.6, label=name)
        if log_x and len(x) <= FEW:
            axes.set_xticks(x, [f"{value:,g}" for value in x])
            axes.set_xticks([], minor=True)
        if log_y:
            logarithmic(axes.yaxis)
        if len(known) + len(found) > 1:
            legend(axes, "best")

    write_whole(target, png_of_figure(size, draw))


def _shown(values: Float[np.ndarray, "n"], log: bool) -> Float[np.ndarray, "n"]:
    return np.where(values > 0, values, np.nan) if log else values
