"""What may be drawn: checked before anything reaches the renderer, which would crash or draw nonsense."""

import math
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Integer

from ..files import check_can_be_written


def checked_mesh(
    vertices: Float[np.ndarray, "V 3"], faces: Integer[np.ndarray, "F 3"]
) -> tuple[Float[np.ndarray, "V 3"], Integer[np.ndarray, "F 3"]]:
    """The mesh as float64 and int64 arrays.

    Raises:
        ValueError: wrong shapes, no face, an index out of range, coordinates not finite, no face with area.
    """
    vertices, faces = checked_positions(vertices, "vertices"), np.asarray(faces)
    if (
        faces.ndim != 2
        or faces.shape[1] != 3
        or len(faces) == 0
        or not np.issubdtype(faces.dtype, np.integer)
    ):
        raise ValueError(f"faces must be integers [F, 3], F ≥ 1; got {faces.dtype} {list(faces.shape)}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(
            f"faces refer to vertices {faces.min()} … {faces.max()}, but there are {len(vertices)} vertices"
        )
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    if not np.cross(b - a, c - a).any():
        raise ValueError("every face has area 0: there is nothing to draw")
    return vertices, faces.astype(np.int64)


def checked_positions(values: Float[np.ndarray, "V 3"], name: str) -> Float[np.ndarray, "V 3"]:
    """The array as float64 [V, 3], finite.

    Raises:
        ValueError: it is not; the message names the first row at fault.
    """
    values = np.asarray(values, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != 3:
        raise ValueError(f"{name} must be [V, 3]; got {list(values.shape)}")
    bad = ~np.isfinite(values).all(axis=1)
    if bad.any():
        raise ValueError(
            f"{name} must be finite; row {int(np.argmax(bad))} is not ({int(bad.sum())} such rows)"
        )
    return values


def checked_vectors(
    vectors: Float[np.ndarray, "V 3"], vertices: Float[np.ndarray, "V 3"], name: str = "vectors"
) -> Float[np.ndarray, "V 3"]:
    """The field as float64, one finite vector for each vertex.

    Raises:
        ValueError: it is not.
    """
    vectors = checked_positions(vectors, name)
    if len(vectors) != len(vertices):
        raise ValueError(f"{name} must have one row per vertex: {len(vertices)}; got {len(vectors)}")
    return vectors


def checked_colors(
    colors: Float[np.ndarray, "V 3"], vertices: Float[np.ndarray, "V 3"]
) -> Float[np.ndarray, "V 3"]:
    """The colours as float64, one for each vertex.

    Raises:
        ValueError: they are not, or lie outside of 0…1.
    """
    colors = checked_vectors(colors, vertices, "colors")
    if colors.min() < 0 or colors.max() > 1:
        raise ValueError(f"colors must be within 0…1; got {colors.min():g} … {colors.max():g}")
    return colors


def checked_size(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of a picture in pixels.

    Raises:
        ValueError: a side is shorter than 64 or longer than 8192 pixels.
    """
    width, height = size
    if not (64 <= width <= 8192 and 64 <= height <= 8192):
        raise ValueError(f"size must be (width, height) within 64 … 8192 pixels; got {size}")
    return int(width), int(height)


def checked_angle(degrees: float) -> float:
    """An angle between faces.

    Raises:
        ValueError: it is not within 0 … 180.
    """
    if not 0 <= degrees <= 180:
        raise ValueError(f"crease_angle must be within 0 … 180 degrees; got {degrees}")
    return float(degrees)


def checked_values(
    values: Float[np.ndarray, "_"], vertices: Float[np.ndarray, "V 3"]
) -> Float[np.ndarray, " V"]:
    """The numbers as float64, one for each vertex.

    Raises:
        ValueError: they are not, or one is not finite.
    """
    values = np.asarray(values, np.float64)
    if values.shape != (len(vertices),) or not np.isfinite(values).all():
        raise ValueError(
            f"values must be {len(vertices)} finite numbers, one per vertex; got {list(values.shape)}"
        )
    return values


def checked_limits(limits: tuple[float, float] | None) -> tuple[float, float] | None:
    """The ends of a colour bar, or None.

    Raises:
        ValueError: they are not finite, or the second is not above the first.
    """
    if limits is None:
        return None
    low, high = float(limits[0]), float(limits[1])
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ValueError(f"limits must be two finite numbers, the lower first; got {limits}")
    return low, high


def checked_texture(
    coordinates: Float[np.ndarray, "t 2"],
    corners: Integer[np.ndarray, "G 3"],
    image: np.ndarray,
    faces: Integer[np.ndarray, "F 3"],
) -> tuple[Float[np.ndarray, "t 2"], Integer[np.ndarray, "F 3"], Float[np.ndarray, "H W 3"]]:
    """Texture coordinates, which of them each corner has, and the image as float64 within 0…1.

    Raises:
        ValueError: wrong shapes, an index out of range, coordinates not finite, colours out of range.
    """
    coordinates, corners, image = np.asarray(coordinates, np.float64), np.asarray(corners), np.asarray(image)
    if coordinates.ndim != 2 or coordinates.shape[1] != 2 or not np.isfinite(coordinates).all():
        raise ValueError(f"coordinates must be finite [t, 2]; got {list(coordinates.shape)}")
    if corners.shape != faces.shape or not np.issubdtype(corners.dtype, np.integer):
        raise ValueError(f"corners must be integers {list(faces.shape)}, as faces; got {list(corners.shape)}")
    if corners.min() < 0 or corners.max() >= len(coordinates):
        raise ValueError(
            f"corners refer to coordinates {corners.min()} … {corners.max()}, but there are {len(coordinates)}"
        )
    image = image / 255 if image.dtype == np.uint8 else image.astype(np.float64)
    if (
        image.ndim != 3
        or image.shape[2] != 3
        or image.size == 0
        or not (0 <= image.min() <= image.max() <= 1)
    ):
        raise ValueError("image must be [H, W, 3], sRGB within 0…1 or bytes")
    return coordinates, corners.astype(np.int64), image


def checked_series(
    series: Mapping[str, object], most: int, *, length: int | None = None
) -> dict[str, Float[np.ndarray, "_"]]:
    """The curves of a plot as float64.

    Raises:
        ValueError: none, or more than `most`; one is empty, not finite, no vector, or not of this length.
    """
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in series.items()}
    if not 1 <= len(arrays) <= most:
        raise ValueError(f"a plot shows 1 … {most} curves that can be told apart; got {len(arrays)}")
    for name, values in arrays.items():
        if values.ndim != 1 or len(values) == 0 or not np.isfinite(values).all():
            raise ValueError(f"{name!r} must be a finite vector; got shape {list(values.shape)}")
        if length is not None and len(values) != length:
            raise ValueError(f"{name!r} must have {length} values; got {len(values)}")
    return arrays


def checked_point_data(
    point_data: Mapping[str, object], vertices: Float[np.ndarray, "V 3"]
) -> dict[str, np.ndarray]:
    """The arrays, each with one row for each vertex.

    Raises:
        ValueError: one has another length.
    """
    arrays = {name: np.asarray(values) for name, values in point_data.items()}
    for name, values in arrays.items():
        if values.shape[:1] != (len(vertices),):
            raise ValueError(
                f"{name!r} must have one row per vertex: {len(vertices)}; got shape {list(values.shape)}"
            )
    return arrays


def png_path(path: str | os.PathLike[str]) -> Path:
    """The path of a picture that can be written; asked before the picture is made.

    Raises:
        ValueError: the name does not end in .png.
        OSError: the file could not be written; see `jaxkvf.files.check_can_be_written`.
    """
    if Path(path).suffix.lower() != ".png":
        raise ValueError(f"pictures are PNG files: the name {Path(path).name!r} must end in .png")
    return check_can_be_written(path)
