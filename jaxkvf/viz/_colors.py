"""Colour maps: perceptual, safe for colour-blind readers, lightened so that dark arrows stand out on them."""

from typing import Any

import numpy as np
from jaxtyping import Float

from ._extras import extra

ARROW_COLOR = (0.10, 0.10, 0.13)
SURFACE_COLOR = (0.86, 0.85, 0.83)
SPEED_MAP, SIGNED_MAP = "viridis", "RdBu_r"
WHITENING = {SPEED_MAP: 0.28, SIGNED_MAP: 0.10}
"""Share of white mixed into each map."""


def color_map(name: str) -> Any:
    """The named matplotlib map, lightened, as a matplotlib colour map of 256 colours."""
    rgb = extra("matplotlib").colormaps[name](np.linspace(0.0, 1.0, 256))[:, :3]
    white = WHITENING[name]
    return extra("matplotlib.colors").ListedColormap((1 - white) * rgb + white, name=f"jaxkvf {name}")


def mapped(
    values: Float[np.ndarray, "V"], limits: tuple[float, float], name: str
) -> Float[np.ndarray, "V 3"]:
    """The map's colour of each value; values outside the limits get the end colours."""
    low, high = limits
    t = np.clip((values - low) / (high - low), 0.0, 1.0) if high > low else np.zeros_like(values)
    return np.asarray(color_map(name)(t), dtype=np.float64)[:, :3]


def plain(count: int, color: tuple[float, float, float] = SURFACE_COLOR) -> Float[np.ndarray, "V 3"]:
    """The same colour for every vertex."""
    return np.tile(np.array(color), (count, 1))
