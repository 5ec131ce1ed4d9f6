"""Scenes as pixels: one camera, one scale."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8

from ..geometry import split_at_creases, spread_evenly
from ._arrows import arrows_at
from ._camera import FIELD_OF_VIEW, View, fit_camera
from ._colors import ColorScale, plain
from ._curves import curves_on
from ._material import SOFT, STRONG
from ._photo import Frame, PaintedMesh, photograph, shown_points
from ._scene import MOST_ARROWS, Scene

ARROW_SPACING = 0.075
"""Distance between arrows by default, in the shorter side of the picture, …"""
ARROW_PIXELS = 46
"""… and at least: they can still be seen where the picture is shown at half its size."""


def pictures_of(
    scenes: Sequence[Scene], *, size: tuple[int, int], view: View | None, same_scale: bool = True
) -> list[UInt8[np.ndarray, "H W 3"]]:
    """A picture of each checked scene: one camera and one scale, or each as large as fits from the same direction."""
    used = [scene.vertices[np.unique(scene.faces)] for scene in scenes]
    together = Frame.around(np.concatenate(used))
    frames = [together if same_scale else Frame.around(points) for points in used]
    groups = [range(len(scenes))] if same_scale else [[i] for i in range(len(scenes))]
    pictures: list[UInt8[np.ndarray, "H W 3"]] = []
    for group in groups:
        eye = fit_camera(np.concatenate([frames[i](used[i]) for i in group]), size, view).position
        drawn = [_painted(scenes[i], frames[i], eye, size) for i in group]
        camera = fit_camera(shown_points(drawn), size, view)
        pictures += [photograph(meshes, camera, size) for meshes in drawn]
    return pictures


def color_scale(scene: Scene) -> ColorScale | None:
    """What the colours of a scene mean; None where they are no numbers'."""
    values = _values(scene)
    if values is None or scene.colors is not None or scene.texture is not None:
        return None
    shown = values[np.unique(scene.faces)]
    return ColorScale.of(shown, signed=scene.signed, limits=scene.limits, clip=scene.values is not None)


def _values(scene: Scene) -> Float[np.ndarray, " V"] | None:
    if scene.values is None and scene.vectors is not None:
        return np.linalg.norm(scene.vectors, axis=1)
    return scene.values


def _painted(
    scene: Scene, frame: Frame, eye: Float[np.ndarray, "3"], size: tuple[int, int]
) -> list[PaintedMesh]:
    placed, vectors = frame(scene.vertices), scene.vectors
    colors, material = scene.colors, SOFT
    values, scale = _values(scene), color_scale(scene)
    if values is not None and scale is not None:
        colors = scale(values)
    elif colors is None:
        colors = plain(len(placed))
        material = STRONG if scene.texture is None and not scene.curves else SOFT
    smooth = scene.crease_angle > 0
    faces, copied = scene.faces, np.arange(len(placed))
    if smooth:
        faces, copied = split_at_creases(placed, faces, scene.crease_angle)
    drawn = [PaintedMesh(placed[copied], faces, colors[copied], smooth, material, scene.texture)]
    if vectors is not None:
        count = _count(scene, placed, eye, size) if scene.arrows is None else scene.arrows
        samples = spread_evenly(placed, scene.faces, min(count, len(np.unique(scene.faces))))
        drawn += arrows_at(samples, placed, scene.faces, vectors, eye=eye)
    return drawn + curves_on([frame(curve) for curve in scene.curves])


def _count(
    scene: Scene, placed: Float[np.ndarray, "V 3"], eye: Float[np.ndarray, "3"], size: tuple[int, int]
) -> int:
    """How many arrows leave the distance that they should have in the picture between each other."""
    if scene.curves:
        return 0
    pixels = size[1] / (2 * math.tan(math.radians(FIELD_OF_VIEW) / 2) * float(np.linalg.norm(eye)))
    a, b, c = np.moveaxis(placed[scene.faces], 1, 0)
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2
    return min(round(area * (pixels / max(ARROW_PIXELS, ARROW_SPACING * min(size))) ** 2), MOST_ARROWS)
