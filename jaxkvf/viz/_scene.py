"""A mesh and what is shown on it."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, Integer, UInt8

from ..arguments import checked_integer
from ._checks import (
    checked_angle,
    checked_colors,
    checked_limits,
    checked_mesh,
    checked_positions,
    checked_texture,
    checked_values,
    checked_vectors,
)

MOST_ARROWS = 20_000
"""Far more than a picture can show."""
CREASE_ANGLE = 40.0
"""Degrees between the normals of faces from which on their edge is drawn as one."""


@dataclasses.dataclass(frozen=True)
class Texture:
    """An image on a mesh, such as a pattern's: `Texture(*patterns.texture_coordinates(made), patterns.texture(image))`."""

    coordinates: Float[np.ndarray, "t 2"]
    """In the image, 0…1, to the right and upwards."""
    corners: Int[np.ndarray, "F 3"]
    """Which of the coordinates each corner of each face has."""
    image: Float[np.ndarray, "H W 3"] | UInt8[np.ndarray, "H W 3"]
    """sRGB, 0…1, or bytes 0…255; the first row is the uppermost."""


@dataclasses.dataclass(frozen=True)
class Scene:
    """A surface and what is shown on it: colours, arrows, curves, an image. `render` draws one, or several side by side.

    `Scene(x, faces)` is a bare mesh, grey; `Scene(x, faces, "λ₀·area = 1e-7", vectors=u)` a field with its caption.
    """

    vertices: Float[np.ndarray, "V 3"]
    """Positions, of any size and place."""
    faces: Integer[np.ndarray, "F 3"]
    """Vertex indices, counter-clockwise."""
    title: str = ""
    """A short caption; mathematics between $ signs is typeset."""
    vectors: Float[np.ndarray, "V 3"] | None = None
    """A field, pointwise, in space; its unit does not matter. Its norm, of a Killing field the speed of its flow, is the
    colour, dark at 0 and yellow at the largest, and the length of its arrows."""
    arrows: int | None = None
    """How many arrows of the field at most, spread evenly over all sides of the surface, never more than vertices. By
    default as many as can be told apart at the picture's size; where curves are shown, none."""
    curves: Sequence[Float[np.ndarray, "_ 3"]] = ()
    """Polylines on the surface, such as `integral_curves(…).polylines()`: dark lines with a head where they end."""
    values: Float[np.ndarray, " V"] | None = None
    """Numbers whose colours are shown instead of the norm's."""
    signed: bool = False
    """Whether values lie about 0: blue below, red above, white at 0. Otherwise from 0, dark, to the largest, yellow."""
    limits: tuple[float, float] | None = None
    """Values of the first and the last colour. By default 0 or −m to m, with m the largest size of a value that is shown; of
    `values` the uppermost half per cent is left out, and shown in the last colour."""
    color_bar: str = ""
    """What the colours mean, with the unit: a colour bar with this label stands to the right of the mesh. None without."""
    colors: Float[np.ndarray, "V 3"] | None = None
    """sRGB, 0…1, instead of colours of numbers."""
    texture: Texture | None = None
    """An image instead of colours at the vertices."""
    crease_angle: float = CREASE_ANGLE
    """Faces whose normals differ by more degrees meet in an edge that is seen; 0 shows every facet, 180 none."""

    def checked(self) -> "Scene":
        """The scene in float64 and int64.

        Raises:
            ValueError: something in it cannot be drawn.
        """
        vertices, faces = checked_mesh(self.vertices, self.faces)
        given = self.texture
        texture = given and Texture(*checked_texture(given.coordinates, given.corners, given.image, faces))
        return dataclasses.replace(
            self,
            vertices=vertices,
            faces=faces,
            vectors=None if self.vectors is None else checked_vectors(self.vectors, vertices),
            values=None if self.values is None else checked_values(self.values, vertices),
            limits=checked_limits(self.limits),
            colors=None if self.colors is None else checked_colors(self.colors, vertices),
            arrows=None if self.arrows is None else checked_integer("arrows", self.arrows, 0, MOST_ARROWS),
            texture=texture,
            curves=[checked_positions(curve, f"curves[{i}]") for i, curve in enumerate(self.curves)],
            crease_angle=checked_angle(self.crease_angle),
        )
