"""Polylines as round tubes."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

SIDES = 8


def tubes(
    curves: Sequence[Float[np.ndarray, "_ 3"]], radii: Sequence[Float[np.ndarray, "_"]]
) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
    """Rings of `SIDES` points around each point of each curve, joined; the rings do not turn about the curve.

    Points that coincide with the one before are left out.

    Args:
        curves: polylines.
        radii: of the tube at each point of each.
    """
    points, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    for curve, radius in zip(curves, radii, strict=True):
        moved = np.concatenate([[True], np.linalg.norm(np.diff(curve, axis=0), axis=1) > 1e-9])
        line = curve[moved]
        if len(line) < 2:
            continue
        tangent = np.gradient(line, axis=0)
        tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
        normal = np.empty_like(line)
        side = np.eye(3)[np.argmin(np.abs(tangent[0]))]
        for i, t in enumerate(tangent):
            side = side - (side @ t) * t
            side = side / np.linalg.norm(side)
            normal[i] = side
        other = np.cross(tangent, normal)
        ring = np.cos(angle)[:, None] * normal[:, None] + np.sin(angle)[:, None] * other[:, None]
        points.append((line[:, None] + radius[moved][:, None, None] * ring).reshape(-1, 3))
        step, around = (g.ravel() for g in np.mgrid[: len(line) - 1, :SIDES])
        a, b = count + step * SIDES + around, count + step * SIDES + (around + 1) % SIDES
        quads = np.stack([a, b, b + SIDES, a, b + SIDES, a + SIDES], axis=1)
        faces.append(quads.reshape(-1, 3))
        count += len(line) * SIDES
    return np.concatenate(points), np.concatenate(faces)
