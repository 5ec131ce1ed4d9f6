"""What a discretization of the Killing operator offers to those who do not care which one it is."""

import abc

import equinox as eqx
from jaxtyping import Array, Float

from ..eigen import GeneralizedEigenproblem
from ..mesh import Topology


class AbstractDiscretization(eqx.Module):
    """A choice of unknowns for tangent fields, and of A and B with xᵀAx = ∫‖KU‖² and xᵀBx = ∫|U|².

    Everything is intrinsic: a function of edge lengths and connectivity.
    """

    @abc.abstractmethod
    def eigenproblem(self, lengths: Float[Array, " E"], topology: Topology) -> GeneralizedEigenproblem:
        """A x = λ B x, both integrated (weak). λ scales as length⁻²."""

    @abc.abstractmethod
    def to_vertex_vectors(
        self, coefficients: Float[Array, " n"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, "V 2"]:
        """The field with these coefficients as vectors in the intrinsic polar frames of the vertices."""

    @abc.abstractmethod
    def from_vertex_vectors(
        self, vectors: Float[Array, "V 2"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, " n"]:
        """The coefficients of a field given by vectors in the intrinsic polar frames of the vertices."""

    @abc.abstractmethod
    def energy(
        self, coefficients: Float[Array, " n"], lengths: Float[Array, " E"], topology: Topology
    ) -> Float[Array, ""]:
        """E_K = ∫‖KU‖² of a field. Unit: vector²."""
