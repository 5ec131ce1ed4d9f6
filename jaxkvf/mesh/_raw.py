"""What a mesh is given as: arrays, or what stands in a file, before anything is known about it."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ._attributes import Attributes
from ._errors import MeshError
from ._polygons import Polygons


class RawAttributes(NamedTuple):
    """Values at vertices, faces and corners as they were given; faces may be polygons."""

    vertex: Mapping[str, np.ndarray] = {}
    face: Mapping[str, np.ndarray] = {}
    texture: Float[np.ndarray, "C 2"] | None = None
    """Texture coordinates of all corners, one face after the other."""

    def gather(
        self,
        vertices: Int[np.ndarray, " V"],
        faces: Int[np.ndarray, " F"],
        corners: Int[np.ndarray, "F 3"],
    ) -> Attributes:
        """Those of a mesh of triangles whose parts come from these vertices, faces and corners."""
        return Attributes(
            {name: values[vertices] for name, values in self.vertex.items()},
            {name: values[faces] for name, values in self.face.items()},
            None if self.texture is None else self.texture[corners],
        )


def _no_attributes() -> RawAttributes:
    return RawAttributes()


def _face_number(face: int) -> str:
    return f"face {face} (counted from 0) has"


class RawMesh(NamedTuple):
    vertices: Float[np.ndarray, "V 3"]
    polygons: Polygons
    subject: Callable[[int], str] = _face_number
    """How a message about the number of a face's corners begins."""
    attributes: Callable[[], RawAttributes] = _no_attributes
    """Reads them, which takes as long as reading the mesh."""
    notes: tuple[str, ...] = ()
    """What reading did to the content."""

    @property
    def triangles(self) -> Int[np.ndarray, "F 3"]:
        """The faces.

        Raises:
            MeshError: one has not three corners; the message names it and the remedy.
        """
        sizes = self.polygons.sizes
        bad = np.flatnonzero(sizes != 3)
        if not bad.size:
            return self.polygons.corners.reshape(-1, 3)
        first = bad[0]
        steps = {"drop_degenerate": (sizes < 3).any(), "triangulate": (sizes > 3).any()}
        named = ", ".join(f"{step}=True" for step, needed in steps.items() if needed)
        does = "drops" if not steps["triangulate"] else "triangulates"
        raise MeshError(
            f"{self.subject(int(first))} {sizes[first]} corners; only triangles are read, and {bad.size} of the "
            f"{len(sizes)} faces are none; repair(…, {named}) {does} them"
        )
