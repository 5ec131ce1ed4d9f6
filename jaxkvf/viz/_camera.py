"""Where the camera stands: the nearest place along a viewing direction from which all points are visible."""

import dataclasses
import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

View: TypeAlias = tuple[Sequence[float] | np.ndarray, Sequence[float] | np.ndarray]
"""(direction from the object towards the camera, direction that is up in the picture), of any lengths."""

X_UP: View = ((0.45, 1.0, 0.65), (1.0, 0.0, 0.0))
"""Three-quarter view of an object that stands along x."""

Y_UP: View = ((0.65, 0.45, 1.0), (0.0, 1.0, 0.0))
"""Three-quarter view of an object that stands along y, as most mesh files do. The default."""

Z_UP: View = ((0.65, -1.0, 0.45), (0.0, 0.0, 1.0))
"""Three-quarter view of an object that stands along z, as surfaces of revolution in formulas do."""

_UPRIGHT = (X_UP, Y_UP, Z_UP)

FIELD_OF_VIEW = 28.0
"""Vertical field of view in degrees: a long lens, little distortion."""

MARGIN = 0.06
"""Part of the picture's half-width and half-height that stays empty."""


@dataclasses.dataclass(frozen=True)
class Camera:
    """A pinhole camera: it stands at `position`, looks at `target`, and `up` is up in its picture."""

    position: Float[np.ndarray, "3"]
    target: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]


def view_upright(axis: Sequence[float] | np.ndarray) -> View:
    """Three-quarter view of an object that stands along an axis, of either sense: its largest component is taken to be up.

    Along x, y and z it is `X_UP`, `Y_UP` and `Z_UP`; otherwise the nearest of these, turned with the axis.

    Raises:
        ValueError: the axis is not three finite numbers, or is zero.
    """
    up = np.asarray(axis, np.float64)
    if up.shape != (3,) or not np.isfinite(up).all() or not up.any():
        raise ValueError(f"an axis must be three finite numbers, not all 0; got {axis}")
    nearest = int(np.argmax(np.abs(up)))
    up = up / np.linalg.norm(up) * np.sign(up[nearest])
    direction, old = (np.array(part) for part in _UPRIGHT[nearest])
    # Rodrigues' formula for the smallest rotation that takes one unit vector to another, less than a right angle away.
    normal, cosine = np.cross(old, up), old @ up
    turned = direction * cosine + np.cross(normal, direction) + normal * (normal @ direction) / (1 + cosine)
    return turned, up


def view_axes(
    view: View | None,
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Orthonormal axes of the picture: right, up, and back (from the object towards the camera).

    Raises:
        ValueError: a direction is not three finite numbers, or is zero, or the two are parallel.
    """
    back, up = (np.asarray(v, dtype=np.float64) for v in (Y_UP if view is None else view))
    if back.shape != (3,) or up.shape != (3,) or not (np.isfinite(back).all() and np.isfinite(up).all()):
        raise ValueError("view must be (direction to the camera, up), each of three finite numbers")
    right = np.cross(up, back)
    if np.linalg.norm(right) <= 1e-9 * np.linalg.norm(up) * np.linalg.norm(back):
        raise ValueError("view: neither direction may be zero, and up must not be parallel to the direction")
    back, right = back / np.linalg.norm(back), right / np.linalg.norm(right)
    return right, np.cross(back, right), back


def fit_camera(points: Float[np.ndarray, "N 3"], size: tuple[int, int], view: View | None = None) -> Camera:
    """The nearest camera along the view that sees all the points, centred, with a margin around them.

    A point p, in axes (right, up, back), is between the left and right sides of the picture of a camera at
    (x, y, z) if |p_right − x| ≤ t (z − p_back), t = tan(half the field of view): two half-planes a point,
    so the nearest apex has a closed form; likewise for top and bottom, and the farther z serves both.

    Args:
        points: the points to see.
        size: width and height of the picture in pixels.
        view: direction to the camera and up; `None` is `Y_UP`.
    """
    axes = np.stack(view_axes(view))
    across, along, depth = axes @ points.T
    slope = math.tan(math.radians(FIELD_OF_VIEW) / 2) * (1 - MARGIN)
    z = max(_apex_depth(across, depth, slope * size[0] / size[1]), _apex_depth(along, depth, slope)) + 1e-3
    x, y = _centered(across, z - depth), _centered(along, z - depth)
    target_depth = min(float(depth.min() + depth.max()) / 2, z - 1e-3)
    return Camera(
        position=np.array([x, y, z]) @ axes, target=np.array([x, y, target_depth]) @ axes, up=axes[1]
    )


def _apex_depth(offsets: Float[np.ndarray, "N"], depths: Float[np.ndarray, "N"], slope: float) -> float:
    """Lowest z for which some x has |offset − x| ≤ slope · (z − depth) for every point."""
    return float(np.max(depths + offsets / slope) + np.max(depths - offsets / slope)) / 2


def _centered(offsets: Float[np.ndarray, "N"], distances: Float[np.ndarray, "N"]) -> float:
    """The x that leaves equal room on both sides: max (offset − x)/distance = max (x − offset)/distance.

    The left side less the right one falls as x grows: bisection.
    """
    low, high = float(offsets.min()), float(offsets.max())
    for _ in range(30):
        x = (low + high) / 2
        angles = (offsets - x) / distances
        low, high = (x, high) if angles.max() > -angles.min() else (low, x)
    return (low + high) / 2
