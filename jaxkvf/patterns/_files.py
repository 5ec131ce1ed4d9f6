"""Patterns as files that ordinary viewers open: textured GLB and OBJ, vertex-coloured PLY."""

import io
import os
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from ..extras import extra
from ..files import check_can_be_written, write_whole
from ..geometry import vertex_normals
from ..mesh import Attributes, TriangleMesh, write_mesh
from ._pattern import MARGIN, Pattern

BACKGROUND = (0.86, 0.85, 0.83)


def save_textured(
    path: str | os.PathLike[str],
    made: Pattern,
    image: Float[np.ndarray, "H w 3"],
    *,
    mesh: TriangleMesh | None = None,
    background: tuple[float, float, float] = BACKGROUND,
) -> None:
    """Writes a pattern with an image on its disks: `.glb`, one file; or `.obj`, with an `.mtl` and a `.png` beside it.

    Args:
        path: the file; its ending tells the format.
        made: the pattern.
        image: colours 0…1, laid over the square around each disk, right along the field.
        mesh: other positions for the pattern's vertices, such as a relief (`emboss`).
        background: colour of everything outside the disks.

    Raises:
        ValueError: another ending.
        OSError: a file cannot be written.
        ImportError: `pip install "jaxkvf[patterns]"`.
    """
    file = Path(path)
    if file.suffix.lower() not in {".glb", ".obj"}:
        raise ValueError(f"{file}: textured meshes are written as .glb or .obj, not {file.suffix!r}")
    check_can_be_written(file)
    mesh = made.mesh if mesh is None else mesh
    uv, corners = texture_coordinates(made)
    pixels = texture(image, background)
    if file.suffix.lower() == ".glb":
        write_whole(file, _glb(mesh, uv, corners, pixels))
    else:
        write_whole(file.with_suffix(".png"), _png(pixels))
        write_whole(file.with_suffix(".mtl"), _material(file.stem, file.with_suffix(".png").name))
        write_whole(file, _obj(mesh, uv, corners, file.stem))


def texture_coordinates(made: Pattern) -> tuple[Float[np.ndarray, "t 2"], Int[np.ndarray, "G 3"]]:
    """Texture coordinates (0…1, upwards) and which of them each corner of each face has; 0 is the background."""
    faces, copy = np.asarray(made.mesh.faces), made.face_copy
    n = made.coordinates.shape[1]
    textured = copy >= 0
    key = copy[textured, None] * n + faces[textured]
    used, position = np.unique(key, return_inverse=True)
    uv = 0.5 + made.coordinates.reshape(-1, 2)[used] / (2 * MARGIN)
    corners = np.zeros_like(faces)
    corners[textured] = 1 + position.reshape(-1, 3)
    return np.concatenate([[[0.002, 0.002]], uv]), corners


def texture(
    image: Float[np.ndarray, "H w 3"], background: tuple[float, float, float] = BACKGROUND
) -> UInt8[np.ndarray, "T T 3"]:
    """The image inside a disk, on a square of background that reaches to the margin around it."""
    height, width = image.shape[:2]
    size = int(np.ceil(MARGIN * max(height, width)))
    axis = ((np.arange(size) + 0.5) / size * 2 - 1) * MARGIN
    u, v = axis[None, :], -axis[:, None]
    column = np.clip(((u + 1) / 2 * width).astype(int), 0, width - 1)
    row = np.clip(((1 - v) / 2 * height).astype(int), 0, height - 1)
    inside = (u**2 + v**2 <= 1)[..., None]
    colors = np.where(inside, image[row, column], np.asarray(background))
    return np.round(255 * np.clip(colors, 0, 1)).astype(np.uint8)


def save_colored(path: str | os.PathLike[str], mesh: TriangleMesh, colors: Float[np.ndarray, "V 3"]) -> None:
    """Writes a binary PLY with a colour (0…1) at each vertex.

    Raises:
        ValueError: another ending, or not one colour a vertex.
        OSError: the file cannot be written.
    """
    if Path(path).suffix.lower() != ".ply":
        raise ValueError(f"{path}: vertex-coloured meshes are written as .ply, not {Path(path).suffix!r}")
    x, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    if colors.shape != x.shape:
        raise ValueError(f"colors must have shape {list(x.shape)}, one a vertex, got {list(colors.shape)}")
    shades = np.round(255 * np.clip(colors, 0, 1)).astype(np.uint8)
    write_mesh(path, x, faces, Attributes({"color": shades}))


def _glb(
    mesh: TriangleMesh, uv: Float[np.ndarray, "t 2"], corners: Int[np.ndarray, "G 3"], pixels: np.ndarray
) -> bytes:
    """By trimesh: vertices split where texture coordinates differ."""
    trimesh, visual = extra("trimesh"), extra("trimesh.visual")
    faces = np.asarray(mesh.faces)
    pairs, position = np.unique(
        np.stack([faces.ravel(), corners.ravel()], axis=1), axis=0, return_inverse=True
    )
    normals = np.asarray(vertex_normals(mesh.vertices, mesh.topology))
    material = visual.material.PBRMaterial(
        baseColorTexture=extra("PIL.Image").fromarray(pixels), metallicFactor=0.0, roughnessFactor=0.8
    )
    split = trimesh.Trimesh(
        np.asarray(mesh.vertices, np.float64)[pairs[:, 0]],
        position.reshape(-1, 3),
        vertex_normals=normals[pairs[:, 0]],
        visual=visual.TextureVisuals(uv=uv[pairs[:, 1]], material=material),
        process=False,
    )
    return bytes(split.export(file_type="glb"))


def _obj(
    mesh: TriangleMesh, uv: Float[np.ndarray, "t 2"], corners: Int[np.ndarray, "G 3"], name: str
) -> bytes:
    x, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    normals = np.asarray(vertex_normals(mesh.vertices, mesh.topology))
    text = f"mtllib {name}.mtl\nusemtl {name}\n"
    text += "v %r %r %r\n" * len(x) % tuple(x.ravel().tolist())
    text += "vt %.7f %.7f\n" * len(uv) % tuple(uv.ravel().tolist())
    text += "vn %.6f %.6f %.6f\n" * len(x) % tuple(normals.ravel().tolist())
    numbers = np.stack([faces, corners, faces], axis=2) + 1
    text += "f %d/%d/%d %d/%d/%d %d/%d/%d\n" * len(faces) % tuple(numbers.ravel().tolist())
    return text.encode("ascii")


def _material(name: str, image: str) -> bytes:
    return f"newmtl {name}\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {image}\n".encode("ascii")


def _png(pixels: np.ndarray) -> bytes:
    file = io.BytesIO()
    extra("PIL.Image").fromarray(pixels).save(file, format="PNG")
    return file.getvalue()


def read_image(path: str | os.PathLike[str]) -> Float[np.ndarray, "H w 3"]:
    """An image file as colours 0…1.

    Raises:
        OSError: the file cannot be read, or is no image.
    """
    with extra("PIL.Image").open(path) as image:
        return np.asarray(image.convert("RGB"), float) / 255
