"""A vector field on a mesh: colour for its speed, arrows for its direction."""

import os

import numpy as np
from jaxtyping import Float, Int, Integer, UInt8

from ..files import write_whole
from ._arrows import arrows_at
from ._camera import View, fit_camera
from ._checks import checked_count, checked_mesh, checked_size, checked_vectors, png_path
from ._colors import SPEED_MAP, mapped
from ._page import png_of
from ._photo import Frame, Surface, photograph, shown_points
from ._samples import spread_evenly


def render_field(
    path: str | os.PathLike[str],
    vertices: Float[np.ndarray, "V 3"],
    faces: Integer[np.ndarray, "F 3"],
    vectors: Float[np.ndarray, "V 3"],
    *,
    size: tuple[int, int] = (1200, 900),
    view: View | None = None,
    arrows: int = 500,
    smooth: bool = True,
) -> None:
    """Write a picture of a field on a mesh, coloured from 0 (dark) to the largest norm (yellow), with arrows.

    The arrows stand at points spread evenly over the surface, not at the vertices, and their lengths are
    proportional to the norm: the norm of a Killing field is the speed of its flow.

    Args:
        path: the PNG file to write; an older one is replaced.
        vertices: positions, of any size and place.
        faces: vertex indices, counter-clockwise.
        vectors: the field, pointwise, in space; its unit does not matter.
        size: width and height in pixels.
        view: (direction from the mesh to the camera, up); `None` is `Y_UP`.
        arrows: how many at most, on both sides of the object; never more than vertices; 0 for none.
        smooth: shade with vertex normals; `False` shows the facets.

    Raises:
        ValueError: the mesh, the field, the size or the view cannot be drawn.
        FileNotFoundError: the file's folder does not exist.
        ImportError: the extra `jaxkvf[viz]` is not installed.
        RuntimeError: off-screen rendering is not available; the message says what mends it.
    """
    target, size = png_path(path), checked_size(size)
    vertices, faces = checked_mesh(vertices, faces)
    vectors = checked_vectors(vectors, vertices)
    pictures = field_pictures(
        vertices, faces, vectors[None], size=size, view=view, arrows=arrows, smooth=smooth
    )
    write_whole(target, png_of(pictures[0]))


def field_pictures(
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    fields: Float[np.ndarray, "k V 3"],
    *,
    size: tuple[int, int],
    view: View | None,
    arrows: int,
    smooth: bool,
) -> list[UInt8[np.ndarray, "H W 3"]]:
    """A picture of each field: one camera, arrows at the same points, each up to its own largest speed."""
    used = np.unique(faces)
    placed = Frame.around(vertices[used])(vertices)
    samples = spread_evenly(placed, faces, min(checked_count(arrows), len(used)))
    eye = fit_camera(placed[used], size, view).position
    scenes: list[list[Surface]] = []
    for vectors in fields:
        speeds = np.linalg.norm(vectors, axis=1)
        colors = mapped(speeds, (0.0, float(speeds[used].max())), SPEED_MAP)
        mesh = Surface(placed, faces, colors, smooth=smooth)
        scenes.append([mesh, *arrows_at(samples, placed, faces, vectors, eye=eye)])
    camera = fit_camera(shown_points(scenes), size, view)
    return [photograph(scene, camera, size) for scene in scenes]
