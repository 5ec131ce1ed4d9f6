"""A triangle mesh: vertex positions over a fixed connectivity."""

import os

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._attributes import NO_ATTRIBUTES, Attributes
from ._defects import Gluing
from ._io import read_mesh, write_mesh
from ._topology import Topology
from ._validation import check_areas_positive, checked_vertices


class TriangleMesh(eqx.Module):
    """An oriented manifold triangle mesh in R³: differentiable positions over a fixed `Topology`.

    A pytree: pass it through `jit`, differentiate with respect to `vertices` by `with_vertices`.
    """

    vertices: Float[Array, "V 3"]
    """Positions, in the user's unit of length."""
    topology: Topology

    @classmethod
    def from_arrays(cls, vertices: object, faces: object) -> "TriangleMesh":
        """The mesh with these positions `[V, 3]` and counter-clockwise faces `[F, 3]` (indices from 0).

        The floating dtype of `vertices` is kept as far as JAX is allowed it: float64 needs `jax_enable_x64`.

        Raises:
            MeshError: not an oriented manifold triangle mesh with finite positions and positive areas; the message names
                the first offending faces or vertices and the remedy. Nothing is repaired.
        """
        checked = checked_vertices(vertices)
        positions = jnp.asarray(checked)
        topology = Topology.from_faces(faces, checked.shape[0])
        check_areas_positive(np.asarray(positions), np.asarray(topology.faces))
        return cls(positions, topology)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "TriangleMesh":
        """The mesh in an OBJ, PLY, OFF or STL file, its vertices in the file's order (texture seams do not split them).

        Colours and texture coordinates are no part of a mesh: `read_attributes(path)` reads them, `save` writes them.

        Raises:
            OSError: the file cannot be read.
            MeshError: its content is not an oriented manifold triangle mesh with positive areas.
        """
        return cls.from_arrays(*read_mesh(path))

    def save(self, path: str | os.PathLike[str], attributes: Attributes = NO_ATTRIBUTES) -> None:
        """Writes the mesh to `path` (OBJ, PLY, OFF or STL by its ending) under a temporary name, then renames it.

        Args:
            path: the file.
            attributes: colours, scalars and texture coordinates beside it, such as `read_attributes` found in another file.

        Raises:
            OSError: the file cannot be written; nothing is left behind.
            ValueError: unknown ending, or attributes that do not fit or that the format does not hold.
            MeshError: STL, whose float32 would merge vertices or flatten faces.
        """
        write_mesh(path, np.asarray(self.vertices, np.float64), np.asarray(self.faces), attributes)

    @property
    def area(self) -> Float[Array, ""]:
        """Area of the surface, in the square of the unit of length."""
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        unit = jax.lax.stop_gradient(jnp.abs(b - a).max())
        across = jnp.cross((b - a) / unit, (c - a) / unit)
        return unit * unit * (jnp.sqrt((across * across).sum(axis=1)).sum() / 2)

    @property
    def faces(self) -> Int[Array, "F 3"]:
        return self.topology.faces

    def submesh(self, region: object) -> tuple["TriangleMesh", Int[np.ndarray, " n"]]:
        """The piece made of some faces, and the vertex of this mesh that each of its vertices is. On the host.

        Where faces of the piece touch in a vertex only, each fan gets a copy of it.

        Args:
            region: the faces, as a mask `[F]` or as their numbers.

        Raises:
            ValueError: a mask of another length, numbers out of range or repeated, or no face at all.
        """
        chosen = _chosen_faces(np.asarray(region), self.topology.n_faces)
        faces = np.asarray(self.faces)[chosen].astype(np.int64)
        fan, owner = Gluing.of(faces, self.topology.n_vertices).fans()
        return TriangleMesh(self.vertices[owner], Topology.from_faces(fan.reshape(-1, 3), len(owner))), owner

    def with_vertices(self, vertices: Float[Array, "V 3"]) -> "TriangleMesh":
        """The same connectivity at other positions: the entry for `grad`, `jit` and `vmap`. Values are not checked.

        Raises:
            ValueError: another shape than `[V, 3]`.
        """
        vertices = jnp.asarray(vertices)
        if vertices.shape != (self.topology.n_vertices, 3):
            raise ValueError(
                f"with_vertices needs shape [{self.topology.n_vertices}, 3], got {list(vertices.shape)}"
            )
        return TriangleMesh(vertices, self.topology)


def _chosen_faces(region: np.ndarray, n_faces: int) -> Int[np.ndarray, " n"]:
    if region.dtype == bool:
        if region.shape != (n_faces,):
            raise ValueError(
                f"a region given as a mask must have shape [{n_faces}], one a face, got {list(region.shape)}"
            )
        region = np.flatnonzero(region)
    if region.ndim != 1 or not np.issubdtype(region.dtype, np.integer):
        raise ValueError(
            f"a region must be a mask or numbers of faces, got {region.dtype} of shape {list(region.shape)}"
        )
    if not region.size:
        raise ValueError("the region has no face")
    if region.min() < 0 or region.max() >= n_faces or len(np.unique(region)) < len(region):
        raise ValueError(f"a region must name faces 0…{n_faces - 1}, each once")
    return region.astype(np.int64)
