"""Colour maps: perceptual, safe for colour-blind readers, lightened so that dark arrows stand out on them."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from ..extras import extra

ARROW_COLOR = (0.10, 0.10, 0.13)
SURFACE_COLOR = (0.86, 0.85, 0.83)
SPEED_MAP, SIGNED_MAP = "viridis", "RdBu_r"
WHITENING = {SPEED_MAP: 0.28, SIGNED_MAP: 0.10}
"""Share of white mixed into each map."""
CLIPPED_PERCENT = 0.5
"""Share of the values that may lie beyond the end of the colours."""


@dataclasses.dataclass(frozen=True)
class ColorScale:
    """Which colour a number has."""

    limits: tuple[float, float]
    """The numbers of the first and the last colour, …"""
    map_name: str
    clipped: str = "neither"
    """… and which of these also stand for numbers beyond: "neither", "min", "max" or "both"."""

    @classmethod
    def of(
        cls,
        values: Float[np.ndarray, " N"],
        *,
        signed: bool = False,
        limits: tuple[float, float] | None = None,
        clip: bool = True,
    ) -> "ColorScale":
        """Between the limits; by default from −m or 0 to m, the largest size but the uppermost `CLIPPED_PERCENT` if `clip`.

        Where all values are 0, m is 1.
        """
        if limits is None:
            sizes = np.abs(values)
            most = float(sizes.max())
            m = (float(np.percentile(sizes, 100 - CLIPPED_PERCENT)) if clip else most) or most or 1.0
            limits = (-m if signed else 0.0, m)
            beyond = ("neither", "both" if signed else "max")[most > m]
        else:
            below, above = bool(values.min() < limits[0]), bool(values.max() > limits[1])
            beyond = (("neither", "max"), ("min", "both"))[below][above]
        return cls(limits, SIGNED_MAP if signed else SPEED_MAP, beyond)

    def __call__(self, values: Float[np.ndarray, " N"]) -> Float[np.ndarray, "N 3"]:
        """The colour of each; those outside the limits get the end colours."""
        low, high = self.limits
        t = np.clip((values - low) / (high - low), 0.0, 1.0)
        return np.asarray(color_map(self.map_name)(t), dtype=np.float64)[:, :3]


def color_map(name: str) -> Any:
    """The named matplotlib map, lightened, as a matplotlib colour map of 256 colours."""
    rgb = extra("matplotlib").colormaps[name](np.linspace(0.0, 1.0, 256))[:, :3]
    white = WHITENING[name]
    return extra("matplotlib.colors").ListedColormap((1 - white) * rgb + white, name=f"jaxkvf {name}")


def plain(count: int, color: tuple[float, float, float] = SURFACE_COLOR) -> Float[np.ndarray, "V 3"]:
    """The same colour for every vertex."""
    return np.tile(np.array(color), (count, 1))
