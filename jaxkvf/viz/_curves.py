"""Integral curves as dark tubes that end in an arrow head."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ._colors import ARROW_COLOR, plain
from ._photo import PaintedMesh
from ._tubes import tubes

RADIUS = 0.0028
"""Of the tubes; this and the next in diagonals of the picture's bounding box."""
HEAD_LENGTH = 0.030
"""Never more than half of the curve, …"""
HEAD_SLOPE = 0.30
"""… and this times as thick at its base."""


def curves_on(curves: Sequence[Float[np.ndarray, "_ 3"]]) -> list[PaintedMesh]:
    """The curves as one mesh, in coordinates of order one; those of no length are left out."""
    headed = [_with_head(curve) for curve in curves if len(curve) > 1 and np.ptp(curve, axis=0).any()]
    vertices, faces = tubes([line for line, _ in headed], [radii for _, radii in headed])
    return [PaintedMesh(vertices, faces, plain(len(vertices), ARROW_COLOR))] if len(faces) else []


def _with_head(curve: Float[np.ndarray, "_ 3"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
    """The curve up to the neck, the neck, the base of the head and its tip; and the tube's radius at each."""
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    length = gone[-1]
    head = min(HEAD_LENGTH, length / 2)
    neck = np.array([np.interp(length - head, gone, x) for x in curve.T])
    shaft = curve[gone < length - head]
    base = neck + 1e-3 * (curve[-1] - neck)
    radius = min(RADIUS, HEAD_SLOPE * head / 2)
    radii = np.concatenate([np.full(len(shaft) + 1, radius), [HEAD_SLOPE * head, 0.0]])
    return np.concatenate([shaft, [neck, base, curve[-1]]]), radii
