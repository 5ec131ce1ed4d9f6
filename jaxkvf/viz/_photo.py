"""Painted meshes, photographed by polyscope: the only file that draws in three dimensions."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from ._camera import FIELD_OF_VIEW, Camera
from ._material import SOFT, linear_light
from ._scene import Texture
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
class PaintedMesh:
    """A triangle mesh with a colour (sRGB, 0 … 1) at each vertex, or a texture, in coordinates of order one."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    colors: Float[np.ndarray, "V 3"]
    smooth: bool = True
    material: str = SOFT
    texture: Texture | None = None


def shown_points(pictures: Sequence[Sequence[PaintedMesh]]) -> Float[np.ndarray, "N 3"]:
    """Every point that some face of some mesh uses: what a camera for all the pictures must see."""
    return np.concatenate([mesh.vertices[np.unique(mesh.faces)] for picture in pictures for mesh in picture])


def photograph(
    meshes: Sequence[PaintedMesh], camera: Camera, size: tuple[int, int]
) -> UInt8[np.ndarray, "H W 3"]:
    """The picture of some meshes on white. Every setting that shows in it is set here, each time."""
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
        for i, mesh in enumerate(meshes):
            shown = ps.register_surface_mesh(f"surface {i}", mesh.vertices, mesh.faces)
            shown.set_smooth_shade(mesh.smooth)
            shown.set_material(mesh.material)
            shown.set_back_face_policy("identical")
            if mesh.texture is None:
                shown.add_color_quantity("color", linear_light(mesh.colors), enabled=True)
            else:
                _lay_on(shown, mesh.texture)
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
