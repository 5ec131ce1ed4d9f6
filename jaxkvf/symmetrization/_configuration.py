"""A surface on its way to symmetry: what objectives and terms look at."""

import equinox as eqx
from jaxtyping import Array, Float

from ..geometry import edge_lengths, mean_edge_length
from ..mesh import Topology, TriangleMesh


class Configuration(eqx.Module):
    """Edge lengths over a connectivity, with vertex positions where there are any."""

    lengths: Float[Array, " E"]
    embedding: Float[Array, "V 3"] | None
    topology: Topology

    @classmethod
    def of(cls, mesh: TriangleMesh) -> "Configuration":
        """The surface of a mesh."""
        return cls(edge_lengths(mesh.vertices, mesh.topology), mesh.vertices, mesh.topology)

    @property
    def vertices(self) -> Float[Array, "V 3"]:
        """Positions.

        Raises:
            ValueError: the surface is given by lengths alone.
        """
        if self.embedding is None:
            raise ValueError(
                "this term needs vertex positions, but it is edge lengths that are optimised: "
                "use terms of the lengths (`LengthFidelity`, `ShapeBarrier`)"
            )
        return self.embedding

    @property
    def unit(self) -> Float[Array, ""]:
        """Mean edge length."""
        return mean_edge_length(self.lengths)
