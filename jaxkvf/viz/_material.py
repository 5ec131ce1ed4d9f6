"""How surfaces take the light: softly, and true to the colours asked for.

Polyscope's own shaded materials wash colours out: they take a colour as linear light, brighten it and encode
it. So our materials are plain grey shades within 0 … 1, and `linear_light` undoes the rest; where the shade
is 1, the picture shows exactly the colour asked for, as a colour bar does.
"""

import tempfile
from pathlib import Path
from types import ModuleType

import numpy as np
from jaxtyping import Float

from ..extras import extra

SOFT, STRONG = "jaxkvf soft", "jaxkvf strong"
"""Materials for surfaces whose colour is to be read, and for plain ones whose shape is."""
CONTRAST = {SOFT: 1.3, STRONG: 2.4}
LIGHT = (-0.45, 0.6, 0.66)
"""Direction to the light in the camera's axes: from above the left shoulder."""
SHADOW = 0.10
"""Shade, in linear light, of a normal that points away from the light."""
RIM = 0.15
"""Extra darkening at the silhouette, so that light colours stand out from the white page."""
GAMMA, EXPOSURE = 2.2, 1.1077
"""Polyscope's encoding of linear light and its brightening, as measured."""


def linear_light(colors: Float[np.ndarray, "*N 3"]) -> Float[np.ndarray, "*N 3"]:
    """What polyscope must be given so that fully lit pixels have these sRGB colours (0 … 1)."""
    return colors**GAMMA / EXPOSURE


def load_materials(ps: ModuleType) -> None:
    """Teach polyscope the materials: each is pictures of a lit sphere, for red, green, blue and the rest."""
    for name, contrast in CONTRAST.items():
        shade = lit_sphere(256, contrast) ** (1 / GAMMA)
        with tempfile.TemporaryDirectory(prefix="jaxkvf-") as folder:
            files = [str(Path(folder, f"{channel}.png")) for channel in "rgbk"]
            for channel, file in enumerate(files):
                picture = np.zeros((*shade.shape, 3))
                if channel < 3:
                    picture[:, :, channel] = shade
                extra("matplotlib.image").imsave(file, picture)
            ps.load_blendable_material(name, filenames=tuple(files))


def lit_sphere(pixels: int, contrast: float) -> Float[np.ndarray, "n n"]:
    """Shade of each normal, in linear light: a sphere that fills the square, seen from the front."""
    y, x = np.mgrid[1 : -1 : pixels * 1j, -1 : 1 : pixels * 1j]
    beyond = np.maximum(np.hypot(x, y), 1.0)
    x, y = x / beyond, y / beyond
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0.0))
    light = np.array(LIGHT) / np.linalg.norm(LIGHT)
    facing = 0.5 + 0.5 * (x * light[0] + y * light[1] + z * light[2])
    shade = (SHADOW + (1 - SHADOW) * facing**contrast) * (1 - RIM * (1 - z) ** 2)
    return shade / shade.max()
