"""Which closed pieces of a surface are turned inside out."""

import numpy as np
from jaxtyping import Bool, Float, Int

from ._defects import Gluing

# Rays in a direction that no edge of a made mesh has.
_AXES = np.linalg.qr(np.array([[0.91, 0.33, 0.27], [-0.29, 0.83, 0.41], [0.17, -0.53, 0.74]]))[0]


def inside_out(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], gluing: Gluing
) -> Bool[np.ndarray, " F"]:
    """Faces of the closed pieces that look inwards, for faces of which neighbours agree.

    A piece inside of another may be a cavity, which looks inwards, or a body of its own: it counts only if it looks outwards
    in one that looks inwards, as when all of a hollow body is turned over.
    """
    count, piece = gluing.face_components()
    is_open = np.zeros(count, bool)
    is_open[piece[np.flatnonzero((gluing.uses != 2)[gluing.halfedge_edges]) // 3]] = True
    corner = vertices[faces].astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        low, high = corner.min(axis=(0, 1)), corner.max(axis=(0, 1))
        corner = (corner - low) / (high - low).max()
    order = np.argsort(piece, kind="stable")
    members = np.split(order, np.cumsum(np.bincount(piece, minlength=count))[:-1])
    first = corner[[face[0] for face in members], 0]
    arms = corner - first[piece][:, None]
    volume = np.bincount(piece, np.linalg.det(arms), minlength=count)
    inwards = (volume < 0) & ~is_open
    if not inwards.any():
        return np.zeros(len(faces), bool)
    lows, highs = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(lows, piece, corner.min(axis=1))
    np.maximum.at(highs, piece, corner.max(axis=1))
    turned = np.zeros(count, bool)
    outermost = [
        p
        for p in np.flatnonzero(inwards).tolist()
        if not _around(p, ~is_open, lows, highs, members, corner, first)
    ]
    turned[outermost] = True
    for p in np.flatnonzero((volume > 0) & ~is_open).tolist():
        turned[p] = any(turned[q] for q in _around(p, turned, lows, highs, members, corner, first))
    return turned[piece]


def _around(  # noqa: PLR0917
    p: int,
    among: Bool[np.ndarray, " P"],
    lows: np.ndarray,
    highs: np.ndarray,
    members: list[np.ndarray],
    corner: np.ndarray,
    first: np.ndarray,
) -> list[int]:
    """The closed pieces that contain piece p."""
    boxes = among & (lows <= lows[p]).all(axis=1) & (highs >= highs[p]).all(axis=1)
    boxes[p] = False
    return [q for q in np.flatnonzero(boxes).tolist() if _contains(corner[members[q]], first[p])]


def _contains(triangles: Float[np.ndarray, "n 3 3"], point: Float[np.ndarray, "3"]) -> bool:
    """Whether a ray from the point crosses the closed surface an odd number of times."""
    x = (triangles - point) @ _AXES
    sides = x[:, :, :2]
    after = np.roll(sides, -1, axis=1)
    area = (
        sides[..., 0] * after[..., 1] - sides[..., 1] * after[..., 0]
    )  # opposite corner's share: side by side
    hit = (area > 0).all(axis=1) | (area < 0).all(axis=1)
    share = np.roll(area[hit], -1, axis=1)
    height = (share * x[hit, :, 2]).sum(axis=1) / share.sum(axis=1)
    return bool((height > 0).sum() % 2)
