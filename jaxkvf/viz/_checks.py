"""What may be drawn: checked before anything reaches the renderer, which would crash or draw nonsense."""

import math
import os
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


def checked_size(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of a picture in pixels.

    Raises:
        ValueError: a side is shorter than 64 or longer than 8192 pixels.
    """
    width, height = size
    if not (64 <= width <= 8192 and 64 <= height <= 8192):
        raise ValueError(f"size must be (width, height) within 64 … 8192 pixels; got {size}")
    return int(width), int(height)


def checked_unit(unit: float) -> float:
    """A length to measure with.

    Raises:
        ValueError: it is not positive and finite.
    """
    if not (math.isfinite(unit) and unit > 0):
        raise ValueError(f"unit must be a positive length; got {unit}")
    return float(unit)


def checked_count(arrows: int) -> int:
    """How many arrows to draw.

    Raises:
        ValueError: fewer than none, or more than 20,000: far past what a picture can show.
    """
    if not 0 <= arrows <= 20_000:
        raise ValueError(f"arrows must be within 0 … 20000; got {arrows}")
    return arrows


def checked_fields(
    vectors: Float[np.ndarray, "k V 3"], vertices: Float[np.ndarray, "V 3"]
) -> Float[np.ndarray, "k V 3"]:
    """The fields as one float64 array, each a finite vector for each vertex.

    Raises:
        ValueError: they are not, or there is none.
    """
    vectors = np.asarray(vectors, dtype=np.float64)
    if vectors.ndim != 3 or len(vectors) == 0:
        raise ValueError(f"vectors must be [k, V, 3], k ≥ 1; got {list(vectors.shape)}")
    return np.stack([checked_vectors(field, vertices, f"vectors[{i}]") for i, field in enumerate(vectors)])


def png_path(path: str | os.PathLike[str]) -> Path:
    """The path of a picture that can be written; asked before the picture is made.

    Raises:
        ValueError: the name does not end in .png.
        OSError: the file could not be written; see `jaxkvf.files.check_can_be_written`.
    """
    if Path(path).suffix.lower() != ".png":
        raise ValueError(f"pictures are PNG files: the name {Path(path).name!r} must end in .png")
    return check_can_be_written(path)
