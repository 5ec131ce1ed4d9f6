"""Coloured surfaces, photographed by polyscope: the only file that draws in three dimensions."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from ._camera import FIELD_OF_VIEW, Camera
from ._material import SOFT, linear_light
from ._session import SAMPLES_PER_PIXEL_SIDE, polyscope


@dataclasses.dataclass(frozen=True)
class Frame:
    """Coordinates of order one for the renderer, which works in float32: (x − centre) / size."""

    center: Float[np.ndarray, "3"]
    size: float

    @classmethod
    def around(cls, points: Float[np.ndarray, "N 3"]) -> "Frame":
        """The frame in which the points' bounding box has its centre at 0 and a diagonal of 1."""
        low, high = points.min(axis=0), points.max(axis=0)
        return cls(low + (high - low) / 2, float(np.linalg.norm(high - low)))

    def __call__(self, points: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "N 3"]:
        return (points - self.center) / self.size


@dataclasses.dataclass(frozen=True)
class Texture:
    """An image on a mesh, such as a pattern's: `Texture(*patterns.texture_coordinates(made), image)`."""

    coordinates: Float[np.ndarray, "t 2"]
    """In the image, 0…1, to the right and upwards."""
    corners: Int[np.ndarray, "F 3"]
    """Which of the coordinates each corner of each face has."""
    image: Float[np.ndarray, "H W 3"] | UInt8[np.ndarray, "H W 3"]
    """sRGB, 0…1, or bytes 0…255; the first row is the uppermost."""


@dataclasses.dataclass(frozen=True)
class Surface:
    """A triangle mesh with a colour (sRGB, 0 … 1) at each vertex, or a texture, in coordinates of order one."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    colors: Float[np.ndarray, "V 3"]
    smooth: bool = True
    material: str = SOFT
    texture: Texture | None = None


def shown_points(scenes: Sequence[Sequence[Surface]]) -> Float[np.ndarray, "N 3"]:
    """Every point that some face of some surface uses: what a camera for all the scenes must see."""
    return np.concatenate(
        [surface.vertices[np.unique(surface.faces)] for scene in scenes for surface in scene]
    )


def photograph(
    surfaces: Sequence[Surface], camera: Camera, size: tuple[int, int]
) -> UInt8[np.ndarray, "H W 3"]:
    """The picture of some surfaces on white. Every setting that shows in it is set here, each time."""
    ps = polyscope()
    ps.remove_all_structures()
    try:
        ps.set_window_size(*size)
        ps.set_SSAA_factor(SAMPLES_PER_PIXEL_SIDE)
        ps.set_background_color((1.0, 1.0, 1.0))
        ps.set_ground_plane_mode("none")
        ps.set_automatically_compute_scene_extents(False)
        ps.set_length_scale(1.0)
        ps.set_bounding_box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
        ps.set_view_projection_mode("perspective")
        ps.set_vertical_fov_degrees(FIELD_OF_VIEW)
        for i, surface in enumerate(surfaces):
            mesh = ps.register_surface_mesh(f"surface {i}", surface.vertices, surface.faces)
            mesh.set_smooth_shade(surface.smooth)
            mesh.set_material(surface.material)
            mesh.set_back_face_policy("identical")
            if surface.texture is None:
                mesh.add_color_quantity("color", linear_light(surface.colors), enabled=True)
            else:
                _lay_on(mesh, surface.texture)
        ps.look_at_dir(camera.position, camera.target, camera.up)
        pixels = ps.screenshot_to_buffer(transparent_bg=False)[:, :, :3].copy()
    finally:
        ps.remove_all_structures()
    if pixels.shape[:2] != (size[1], size[0]):
        raise RuntimeError(
            f"polyscope made a picture of {pixels.shape[1::-1]} pixels where {size} was asked for"
        )
    return pixels


def _lay_on(mesh: Any, texture: Texture) -> None:
    coordinates = texture.coordinates[texture.corners.ravel()]
    mesh.add_parameterization_quantity("place", coordinates, defined_on="corners")
    image = linear_light(texture.image).astype(np.float32)
    mesh.add_color_quantity(
        "image", image, defined_on="texture", param_name="place", filter_mode="linear", enabled=True
    )
