"""A discretization on the intrinsic Delaunay triangulation of the surface instead of the triangulation given."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..eigen import GeneralizedEigenproblem
from ..geometry import IntrinsicDelaunay, intrinsic_delaunay, rotations
from ..mesh import Topology
from ._discretization import AbstractDiscretization


class OnIntrinsicDelaunay(AbstractDiscretization):
    """Flips edges first, then discretizes. Fields come back in the frames of the surface as it was given.

    `"regge-delaunay"` is this for `Regge`, whose fields stiffen (lock) across thin triangles. (`Dec` does so by itself.)
    """

    of: AbstractDiscretization
    flip_capacity: int = eqx.field(static=True, default=1)
    """Room for edge flips, see `intrinsic_delaunay`."""

    def triangulation(self, lengths: Float[Array, " E"], topology: Topology) -> IntrinsicDelaunay:
        """The triangulation that carries the unknowns."""
        return intrinsic_delaunay(lengths, topology, capacity=self.flip_capacity, least_degree=3)

    def eigenproblem(self, lengths: Float[Array, " E"], topology: Topology) -> GeneralizedEigenproblem:
        surface = self.triangulation(lengths, topology)
        return self.of.eigenproblem(surface.lengths, surface.topology)

    def to_vertex_vectors(
        self, coefficients: Float[Array, " n"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, "V 2"]:
        surface = self.triangulation(lengths, topology)
        vectors = self.of.to_vertex_vectors(coefficients, surface.lengths, surface.topology)
        return jnp.einsum("vij,vj->vi", rotations(surface.frame_rotations), vectors)

    def from_vertex_vectors(
        self, vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, " n"]:
        surface = self.triangulation(lengths, topology)
        vectors = jnp.einsum("vji,vj->vi", rotations(surface.frame_rotations), vectors)
        return self.of.from_vertex_vectors(vectors, surface.lengths, surface.topology)

    def energy(
        self, coefficients: Float[Array, " n"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, ""]:
        surface = self.triangulation(lengths, topology)
        return self.of.energy(coefficients, surface.lengths, surface.topology)
