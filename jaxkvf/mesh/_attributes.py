"""What a mesh file holds beside positions and triangles: colours, scalars, texture coordinates."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

COLOR = "color"
_COLORED = (".obj", ".off")  # besides PLY, which holds everything


@dataclass(frozen=True)
class Attributes:
    """Values at the vertices, faces and corners of a mesh, as NumPy arrays; on the host, no part of any computation."""

    vertex: Mapping[str, np.ndarray] = field(default_factory=dict)
    """By name, a value a vertex: `"color"`, uint8 `[V, 3]` or, with opacity, `[V, 4]`; every other name a scalar `[V]`."""
    face: Mapping[str, np.ndarray] = field(default_factory=dict)
    """The same for faces: `[F, 3]`, `[F, 4]` or `[F]`."""
    texture: Float[np.ndarray, "F 3 2"] | None = None
    """Texture coordinates at the three corners of each face, upwards; where they differ at a vertex there is a seam."""

    def __bool__(self) -> bool:
        return bool(self.vertex or self.face or self.texture is not None)

    def check(self, n_vertices: int, n_faces: int) -> None:
        """Every array has its length, a colour is uint8.

        Raises:
            ValueError: one is not; the message names it.
        """
        for what, values, n in (("vertex", self.vertex, n_vertices), ("face", self.face, n_faces)):
            for name, array in values.items():
                shapes = [(n, 3), (n, 4)] if name == COLOR else [(n,)]
                if array.shape not in shapes or (name == COLOR and array.dtype != np.uint8):
                    wanted = f"uint8 [{n}, 3] or [{n}, 4]" if name == COLOR else f"[{n}]"
                    raise ValueError(
                        f"{what} attribute '{name}' must be {wanted}, got {array.dtype} {list(array.shape)}"
                    )
        if self.texture is not None and self.texture.shape != (n_faces, 3, 2):
            raise ValueError(f"texture must be [{n_faces}, 3, 2], got {list(self.texture.shape)}")

    def held_by(self, suffix: str) -> tuple["Attributes", tuple[str, ...]]:
        """What a file with this ending (`".obj"`) holds of them, and the names of what it does not."""
        if suffix == ".ply":
            return self, ()
        vertex = {
            name: values for name, values in self.vertex.items() if name == COLOR and suffix in _COLORED
        }
        face = {name: values for name, values in self.face.items() if name == COLOR and suffix == ".off"}
        texture = self.texture if suffix == ".obj" else None
        lost = [f"{_worded(name)} at vertices" for name in self.vertex if name not in vertex]
        lost += [f"{_worded(name)} at faces" for name in self.face if name not in face]
        if suffix == ".obj" and vertex and vertex[COLOR].shape[1] > 3:
            vertex = {COLOR: vertex[COLOR][:, :3]}
            lost.append("opacity")
        if self.texture is not None and texture is None:
            lost.append("texture coordinates")
        return Attributes(vertex, face, texture), tuple(lost)


def _worded(name: str) -> str:
    return "colours" if name == COLOR else f"'{name}'"


def color_from(channels: np.ndarray) -> np.ndarray:
    """Colours as uint8 from numbers 0…255, or 0…1 where they are not integers or none is above 1."""
    values = channels.astype(np.float64)
    unit = np.nan_to_num(values).max(initial=0.0) <= 1 or (values != np.rint(values)).any()
    return np.rint(np.clip(np.nan_to_num(values * (255 if unit else 1)), 0, 255)).astype(np.uint8)


NO_ATTRIBUTES = Attributes()
