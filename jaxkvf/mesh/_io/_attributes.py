"""What a mesh file holds beside positions and triangles: colours, scalars, texture coordinates."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

COLOR = "color"


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

    def rows(self, vertices: Int[np.ndarray, " v"], faces: Int[np.ndarray, " f"]) -> "Attributes":
        """Those of some vertices and faces, in this order."""
        return Attributes(
            {name: values[vertices] for name, values in self.vertex.items()},
            {name: values[faces] for name, values in self.face.items()},
            None if self.texture is None else self.texture[faces],
        )


NO_ATTRIBUTES = Attributes()
