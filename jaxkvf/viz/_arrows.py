"""Arrows for a vertex field: as long as the field is fast there."""

import numpy as np
from jaxtyping import Bool, Float, Int

from ..geometry import Samples
from ._colors import ARROW_COLOR, plain
from ._photo import PaintedMesh

REACH = 1.35
"""Length of the fastest arrow; this and the next four in mean distances between arrows."""
LIFT = 0.07
SHAFT_RADIUS = 0.026
HEAD_RADIUS = 0.075
HEAD_LENGTH = 0.28
HEAD_SHARE = 0.45
"""Arrows so short that the head would exceed this share of them are thinned in proportion."""
SPEED_FLOOR = 0.015
"""Arrows slower than this share of the fastest would be specks; they are left out."""
GRAZING = 0.12
"""Cosine between the normal and the line of sight below which arrows are left out, …"""
END_ON = 0.4
"""… and sine between the arrow and the line of sight: they would be dots that beset the silhouette."""
SIDES = 10


def arrows_at(
    samples: Samples,
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    vectors: Float[np.ndarray, "V 3"],
    *,
    eye: Float[np.ndarray, "3"],
) -> list[PaintedMesh]:
    """Arrows of a vertex field, centred at the samples, as one mesh; none where the field is 0.

    Lengths are proportional to the norm; the fastest vertex has `REACH` mean distances between samples.

    Args:
        samples: where on the mesh.
        vertices: the mesh.
        faces: the mesh.
        vectors: the field; between vertices it is interpolated linearly.
        eye: where the camera stands; arrows are lifted off the surface towards it.
    """
    corners, weights = faces[samples.faces], samples.barycentric[:, :, None]
    places, values = ((weights * at[corners]).sum(axis=1) for at in (vertices, vectors))
    top_speed = float(np.linalg.norm(vectors[faces], axis=2).max())
    a, b, c = np.moveaxis(vertices[corners], 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sight = (eye - places) / np.linalg.norm(eye - places, axis=1, keepdims=True)
    cosines = (normals * sight).sum(axis=1)
    speeds = np.linalg.norm(values, axis=1)
    shown = speeds > SPEED_FLOOR * top_speed
    shown &= np.linalg.norm(np.cross(values, sight), axis=1) > END_ON * speeds
    shown &= _outer_side(vertices, faces, cosines) & (np.abs(cosines) > GRAZING)
    if not shown.any():
        return []
    lifts = LIFT * samples.spacing * normals[shown] * np.sign(cosines[shown])[:, None]
    shafts = values[shown] * (REACH * samples.spacing / top_speed)
    return [arrow_mesh(places[shown] + lifts - shafts / 2, shafts, samples.spacing)]


def _outer_side(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], cosines: Float[np.ndarray, "N"]
) -> Bool[np.ndarray, "N"]:
    """Whether each point's side of the surface is one that shows: any, or the outer if closed."""
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    closed = (np.unique(ends @ [len(vertices), 1], return_counts=True)[1] == 2).all()
    if not closed:
        return np.ones(len(cosines), dtype=bool)
    volume = np.linalg.det(vertices[faces]).sum()
    return cosines * volume > 0


def arrow_mesh(
    tails: Float[np.ndarray, "N 3"], shafts: Float[np.ndarray, "N 3"], spacing: float
) -> PaintedMesh:
    """Round arrows with conical heads as one mesh: each is a profile turned about its axis."""
    lengths = np.linalg.norm(shafts, axis=1)
    axes = shafts / lengths[:, None]
    thickness = spacing * np.minimum(1.0, HEAD_SHARE * lengths / (HEAD_LENGTH * spacing))
    neck = lengths - HEAD_LENGTH * thickness
    zero = np.zeros_like(lengths)
    along = np.stack([zero, zero, neck, neck, lengths], axis=1)
    radii = np.stack(
        [zero, SHAFT_RADIUS * thickness, SHAFT_RADIUS * thickness, HEAD_RADIUS * thickness, zero], 1
    )
    helper = np.eye(3)[np.argmin(np.abs(axes), axis=1)]
    first = np.cross(axes, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axes, first)
    angles = 2 * np.pi * np.arange(SIDES) / SIDES
    spokes = np.cos(angles)[:, None] * first[:, None] + np.sin(angles)[:, None] * second[:, None]
    points = (
        tails[:, None, None]
        + along[:, :, None, None] * axes[:, None, None]
        + radii[:, :, None, None] * spokes[:, None]
    )
    faces = _turned_faces(rings=along.shape[1], sides=SIDES)
    per_arrow = along.shape[1] * SIDES
    faces = faces[None] + per_arrow * np.arange(len(tails))[:, None, None]
    vertices = points.reshape(-1, 3)
    return PaintedMesh(vertices, faces.reshape(-1, 3), plain(len(vertices), ARROW_COLOR), smooth=False)


def _turned_faces(*, rings: int, sides: int) -> Int[np.ndarray, "F 3"]:
    ring, side = (grid.ravel() for grid in np.mgrid[: rings - 1, :sides])
    a, b = ring * sides + side, ring * sides + (side + 1) % sides
    quads = np.stack([a, b, b + sides, a, b + sides, a + sides], axis=1)
    return quads.reshape(-1, 3)
