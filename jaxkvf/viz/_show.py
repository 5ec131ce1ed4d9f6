"""Pictures in notebooks."""

import base64
import io
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..extras import extra

JPEG_QUALITY = 75
COLORS = 128
"""Of a plot."""
SHADED = 0.5
"""Where a JPEG file has less than this share of the size of the PNG file, the picture is one of shaded surfaces."""


class Picture:
    """A PNG file in memory; notebooks display it."""

    def __init__(self, png: bytes) -> None:
        self.png = png

    def _repr_mimebundle_(self, **_: Any) -> dict[str, str]:
        """Shaded surfaces as JPEG, plots as PNG of few colours: notebooks stay small."""
        few_colors, jpeg = _recoded(self.png)
        shaded = len(jpeg) < SHADED * len(self.png)
        kind, content = ("image/jpeg", jpeg) if shaded else ("image/png", few_colors)
        return {kind: base64.b64encode(content).decode("ascii")}


def show(draw: Callable[..., None], *arguments: Any, **options: Any) -> Picture:
    """What `draw(path, …)` writes, to be displayed: `show(render, scene)` instead of `render(path, scene)`.

    Args:
        draw: `render`, or a `plot_…` function.
        arguments, options: of it, the path left out.

    Raises:
        What `draw` raises.
    """
    with tempfile.TemporaryDirectory(prefix="jaxkvf-") as folder:
        path = Path(folder, "picture.png")
        draw(path, *arguments, **options)
        return Picture(path.read_bytes())


def _recoded(png: bytes) -> tuple[bytes, bytes]:
    """The picture with `COLORS` colours as PNG, and as JPEG."""
    picture = extra("PIL.Image").open(io.BytesIO(png)).convert("RGB")
    files = io.BytesIO(), io.BytesIO()
    picture.quantize(COLORS).save(files[0], format="PNG", optimize=True)
    picture.save(files[1], format="JPEG", quality=JPEG_QUALITY, optimize=True)
    return files[0].getvalue(), files[1].getvalue()
