"""A mesh and what is shown on it, and how a series of them is drawn: one camera, one scale."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Integer, UInt8

from ._arrows import arrows_at
from ._camera import View, fit_camera
from ._checks import (
    checked_colors,
    checked_count,
    checked_mesh,
    checked_positions,
    checked_texture,
    checked_vectors,
)
from ._colors import SPEED_MAP, mapped, plain
from ._curves import curves_on
from ._material import SOFT, STRONG
from ._photo import Frame, Surface, Texture, photograph, shown_points
from ._samples import spread_evenly


@dataclasses.dataclass(frozen=True)
class Scene:
    """A mesh and what is shown on it: one panel of `render_series`."""

    vertices: Float[np.ndarray, "V 3"]
    """Positions, of any size and place."""
    faces: Integer[np.ndarray, "F 3"]
    """Vertex indices, counter-clockwise."""
    title: str = ""
    """A short caption; mathematics between $ signs is typeset."""
    vectors: Float[np.ndarray, "V 3"] | None = None
    """A field, pointwise, in space: its norm is the colour, dark at 0 and yellow at the largest."""
    arrows: int = 0
    """How many arrows of the field at most; never more than vertices."""
    curves: Sequence[Float[np.ndarray, "_ 3"]] = ()
    """Polylines on the surface, drawn as dark lines with a head where they end."""
    colors: Float[np.ndarray, "V 3"] | None = None
    """sRGB, 0…1, instead of the norm's colours; a mesh with neither is grey."""
    texture: Texture | None = None
    """An image instead of colours at the vertices."""


def pictures_of(
    scenes: Sequence[Scene],
    *,
    size: tuple[int, int],
    view: View | None,
    smooth: bool = True,
    same_scale: bool = True,
) -> list[UInt8[np.ndarray, "H W 3"]]:
    """A picture of each scene: one camera and one scale, or each as large as fits from the same direction.

    Raises:
        ValueError: there is no scene, or one cannot be drawn.
    """
    if not scenes:
        raise ValueError("there is no scene to draw")
    scenes = [_checked(scene) for scene in scenes]
    used = [scene.vertices[np.unique(scene.faces)] for scene in scenes]
    together = Frame.around(np.concatenate(used))
    frames = [together if same_scale else Frame.around(points) for points in used]
    groups = [range(len(scenes))] if same_scale else [[i] for i in range(len(scenes))]
    pictures: list[UInt8[np.ndarray, "H W 3"]] = []
    for group in groups:
        eye = fit_camera(np.concatenate([frames[i](used[i]) for i in group]), size, view).position
        drawn = [_surfaces(scenes[i], frames[i], eye, smooth) for i in group]
        camera = fit_camera(shown_points(drawn), size, view)
        pictures += [photograph(surfaces, camera, size) for surfaces in drawn]
    return pictures


def _surfaces(scene: Scene, frame: Frame, eye: Float[np.ndarray, "3"], smooth: bool) -> list[Surface]:
    placed, faces, vectors = frame(scene.vertices), scene.faces, scene.vectors
    colors, material = scene.colors, SOFT
    if colors is None and vectors is not None:
        speeds = np.linalg.norm(vectors, axis=1)
        colors = mapped(speeds, (0.0, float(speeds[np.unique(faces)].max())), SPEED_MAP)
    elif colors is None:
        colors = plain(len(placed))
        material = STRONG if scene.texture is None and not scene.curves else SOFT
    drawn = [Surface(placed, faces, colors, smooth, material, scene.texture)]
    if vectors is not None and scene.arrows:
        samples = spread_evenly(placed, faces, min(scene.arrows, len(np.unique(faces))))
        drawn += arrows_at(samples, placed, faces, vectors, eye=eye)
    return drawn + curves_on([frame(curve) for curve in scene.curves])


def _checked(scene: Scene) -> Scene:
    """The scene in float64 and int64.

    Raises:
        ValueError: something in it cannot be drawn.
    """
    vertices, faces = checked_mesh(scene.vertices, scene.faces)
    texture = scene.texture
    return dataclasses.replace(
        scene,
        vertices=vertices,
        faces=faces,
        vectors=None if scene.vectors is None else checked_vectors(scene.vectors, vertices),
        colors=None if scene.colors is None else checked_colors(scene.colors, vertices),
        arrows=checked_count(scene.arrows),
        texture=None if texture is None else _checked_texture(texture, faces),
        curves=[checked_positions(curve, f"curves[{i}]") for i, curve in enumerate(scene.curves)],
    )


def _checked_texture(texture: Texture, faces: Integer[np.ndarray, "F 3"]) -> Texture:
    return Texture(*checked_texture(texture.coordinates, texture.corners, texture.image, faces))
