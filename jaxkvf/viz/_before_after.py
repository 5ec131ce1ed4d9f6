"""A mesh before and after its vertices moved, coloured by how far they moved."""

import os
from typing import Literal

import numpy as np
from jaxtyping import Float, Integer

from ..files import write_whole
from ._camera import View
from ._checks import checked_mesh, checked_positions, checked_size, checked_unit, png_path
from ._colors import SIGNED_MAP, SPEED_MAP, mapped
from ._displacement import color_limits, displacement, mean_edge_length
from ._page import ColorBar, Panel, png_of_page, text_height
from ._scene import Scene, pictures_of


def render_before_after(
    path: str | os.PathLike[str],
    before: Float[np.ndarray, "V 3"],
    after: Float[np.ndarray, "V 3"],
    faces: Integer[np.ndarray, "F 3"],
    *,
    quantity: Literal["normal", "size"] = "normal",
    unit: float | None = None,
    unit_name: str = "mean edge length",
    vectors_before: Float[np.ndarray, "V 3"] | None = None,
    vectors_after: Float[np.ndarray, "V 3"] | None = None,
    titles: tuple[str, str] = ("before", "after"),
    size: tuple[int, int] = (1600, 800),
    view: View | None = None,
    arrows: int = 300,
    smooth: bool = True,
) -> None:
    """Write two meshes side by side, from one camera: the second coloured by displacement.

    The first is coloured by its field's norm, dark to yellow from 0 to the largest, or grey where it has no field.

    Args:
        path: the PNG file to write; an older one is replaced.
        before: positions, of any size and place.
        after: positions of the same vertices later.
        faces: vertex indices, counter-clockwise.
        quantity: "normal", the displacement along the first mesh's outward vertex normal, signed, blue inward
            and red outward; or "size", its length.
        unit: the length in which the colour bar counts; `None` is the mean edge length of the first mesh.
        unit_name: what the colour bar calls the unit.
        vectors_before: a field on the first mesh, drawn as arrows over its norm.
        vectors_after: a field on the second; each field's longest arrow has the same length.
        titles: captions of the two.
        size: width and height of the whole picture in pixels.
        view: (direction from the mesh to the camera, up); `None` is `Y_UP`.
        arrows: how many at most on each; never more than vertices.
        smooth: shade with vertex normals; `False` shows the facets.

    Raises:
        ValueError: a mesh, a field, the quantity, the unit, the size or the view cannot be drawn.
        FileNotFoundError: the file's folder does not exist.
        ImportError: the extra `jaxkvf[viz]` is not installed.
        RuntimeError: off-screen rendering is not available; the message says what mends it.
    """
    if quantity not in {"normal", "size"}:
        raise ValueError(f"quantity must be 'normal' or 'size'; got {quantity!r}")
    target, (width, height) = png_path(path), checked_size(size)
    before, faces = checked_mesh(before, faces)
    after = checked_positions(after, "after")
    if len(after) != len(before):
        raise ValueError(f"after must have the {len(before)} vertices of before; got {len(after)}")
    unit = mean_edge_length(before, faces) if unit is None else checked_unit(unit)
    values = displacement(before, after, faces, quantity) / unit
    used = np.unique(faces)
    limits, clipped = color_limits(values[used], signed=quantity == "normal")
    map_name = SIGNED_MAP if quantity == "normal" else SPEED_MAP

    text = text_height(height)
    top, right = 2 * text, 6 * text
    panel = checked_size(((width - right) // 2, height - top))
    scenes = [
        Scene(before, faces, vectors=vectors_before, arrows=arrows),
        Scene(after, faces, vectors=vectors_after, arrows=arrows, colors=mapped(values, limits, map_name)),
    ]
    panels = [
        Panel(pixels, i * panel[0], top, titles[i])
        for i, pixels in enumerate(pictures_of(scenes, size=panel, view=view, smooth=smooth))
    ]
    name = "normal displacement" if quantity == "normal" else "displacement"
    box = (2 * panel[0] + 0.6 * text, top + 0.12 * panel[1], 0.7 * text, 0.76 * panel[1])
    bar = ColorBar(box, limits, map_name, f"{name} / {unit_name}", clipped)
    write_whole(target, png_of_page((width, height), panels, bar))
