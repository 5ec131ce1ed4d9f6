"""Spectra against the one that is known."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from ..files import write_whole
from ._axes import KNOWN, MARKERS, SERIES_COLORS, bare_axes, legend, logarithmic
from ._checks import checked_series, checked_size, png_path
from ._figure import png_of_figure


def plot_spectrum(
    path: str | os.PathLike[str],
    spectra: Mapping[str, Float[np.ndarray, "_"]],
    reference: Float[np.ndarray, "k"] | None = None,
    *,
    quantity: str = "λ",
    reference_name: str = "exact",
    size: tuple[int, int] = (1000, 640),
) -> None:
    """Write a plot of eigenvalues by their number, over steps of the reference; below it, their relative errors.

    Where the reference is 0 the error is taken relative to its first eigenvalue above 0.

    Args:
        path: the PNG file to write; an older one is replaced.
        spectra: eigenvalues, ascending, under the name that the legend gives them; at most six spectra.
        reference: what they should be; at least as many as the longest of them.
        quantity: label of the axis.
        reference_name: what the legend calls the reference.
        size: width and height in pixels.

    Raises:
        ValueError: a spectrum that is empty, not finite, or longer than the reference; too many of them; the size.
        FileNotFoundError: the file's folder does not exist.
        ImportError: the extra `jaxkvf[viz]` is not installed.
    """
    target, size = png_path(path), checked_size(size)
    found = checked_series(spectra, len(SERIES_COLORS))
    longest = max(len(values) for values in found.values())
    exact = None if reference is None else _checked_reference(reference, longest)
    point = {"ls": "none", "mew": 0, "ms": 3.0 if longest > 60 else 5.0}
    styles = [
        point | {"color": color, "marker": marker}
        for color, marker in zip(SERIES_COLORS, MARKERS, strict=True)
    ]

    def draw(figure: Any) -> None:
        figure.set_layout_engine("constrained")
        heights = (2, 1) if exact is not None else (1,)
        upper, *lower = figure.subplots(
            len(heights), squeeze=False, sharex=True, height_ratios=heights
        ).ravel()
        axes = bare_axes(upper, "" if lower else "number", quantity)
        if exact is not None:
            numbers = np.arange(longest)
            axes.hlines(exact, numbers - 0.5, numbers + 0.5, color=KNOWN, lw=6, label=reference_name)
        for (name, values), style in zip(found.items(), styles, strict=False):
            axes.plot(np.arange(len(values)), values, label=name, **style)
        legend(axes, "upper left")
        if exact is not None:
            errors = bare_axes(lower[0], "number", "relative error")
            errors.set_yscale("log")
            for values, style in zip(found.values(), styles, strict=False):
                error = _relative(values, exact[: len(values)])
                errors.plot(np.arange(len(values)), np.where(error > 0, error, np.nan), **style)
            logarithmic(errors.yaxis)

    write_whole(target, png_of_figure(size, draw))


def _checked_reference(reference: Float[np.ndarray, "k"], count: int) -> Float[np.ndarray, "_"]:
    exact = checked_series({"reference": reference}, 1)["reference"]
    if len(exact) < count:
        raise ValueError(f"the reference has {len(exact)} eigenvalues, a spectrum {count}")
    return exact[:count]


def _relative(values: Float[np.ndarray, "n"], exact: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    least = float(exact[exact > 0].min()) if (exact > 0).any() else 1.0
    return np.abs(values - exact) / np.where(exact > 0, exact, least)
