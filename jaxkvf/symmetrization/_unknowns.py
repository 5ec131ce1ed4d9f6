"""What is varied: vertex displacements, edge lengths, or the parameters of any surface x(θ)."""

import abc
from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, PyTree

from ..arguments import check_shape, checked_not_negative
from ..geometry import barycentric_vertex_areas, cotan_weights, edge_lengths, face_areas, face_normals
from ..mesh import Topology, TriangleMesh
from ._configuration import Configuration


class AbstractUnknowns(eqx.Module):
    """A parametrization θ ↦ surface of the surfaces among which a symmetric one is looked for."""

    @abc.abstractmethod
    def start(self, mesh: TriangleMesh) -> PyTree[Float[Array, "..."]]:
        """θ to begin with, in JAX's default precision, which minimisers work in, whatever the mesh's."""

    @abc.abstractmethod
    def surface(self, theta: Any, original: Configuration) -> Configuration:
        """The surface of θ, differentiable."""

    def is_valid(self, moved: Configuration, original: Configuration) -> Bool[Array, ""]:
        """Whether a minimiser may go there."""
        return (face_areas(moved.lengths, moved.topology) > 0).all()


def _as_mask(fixed: ArrayLike | None) -> Bool[Array, " V"] | None:
    return None if fixed is None else jnp.asarray(fixed)


class Displacements(AbstractUnknowns):
    """Vertex displacements, in mean edge lengths of the input. No face may turn by a right angle or more.

    `smoothing` is a length in mean edges: gradients are then those in a Sobolev metric, waves shorter than it are moved
    last. Written as the change of variables x = (1 + s²Δ)⁻¹ θ, with which every minimiser works, and which leaves the minima
    as they are. For smooth asymmetries (bends, dents); noise is short waves and goes faster without.

    Reference: J. Neuberger, Sobolev Gradients and Differential Equations (1997).
    """

    fixed: Bool[Array, " V"] | None = eqx.field(default=None, converter=_as_mask)
    """Vertices that stay where they are."""
    smoothing: float = eqx.field(
        default=0.0, static=True, converter=partial(checked_not_negative, "smoothing")
    )

    def start(self, mesh: TriangleMesh) -> Float[Array, "V 3"]:
        if self.fixed is not None:
            check_shape("fixed", self.fixed, mesh.vertices.shape[:1], "one a vertex")
        return jnp.zeros(mesh.vertices.shape, float)

    def surface(self, theta: Float[Array, "V 3"], original: Configuration) -> Configuration:
        theta = theta.astype(original.lengths.dtype)
        if self.smoothing:
            theta = _smoothed(theta, original, self.smoothing)
        if self.fixed is not None:
            theta = jnp.where(self.fixed[:, None], 0, theta)
        return Configuration.of(TriangleMesh(original.vertices + original.unit * theta, original.topology))

    def is_valid(self, moved: Configuration, original: Configuration) -> Bool[Array, ""]:
        before, after = (face_normals(s.vertices, s.topology) for s in (original, moved))
        return ((before * after).sum(axis=1) > 0).all()


class EdgeLengths(AbstractUnknowns):
    """Logarithms of the ratios of the edge lengths to the input's: intrinsic, free of any embedding.

    The result has `lengths` but no mesh in R³; which positions have these lengths is another question.
    """

    def start(self, mesh: TriangleMesh) -> Float[Array, " E"]:
        return jnp.zeros(mesh.topology.n_edges, float)

    def surface(self, theta: Float[Array, " E"], original: Configuration) -> Configuration:
        return Configuration(
            original.lengths * jnp.exp(theta.astype(original.lengths.dtype)), None, original.topology
        )


class Parameters(AbstractUnknowns):
    """Any differentiable x(θ): the meridian of a surface of revolution, a height field, a decoder's latent vector."""

    vertices: Callable[[Any], Float[Array, "V 3"]] = eqx.field(static=True)
    """Positions over the input's connectivity, from θ."""
    initial: PyTree[Float[Array, "..."]]
    """θ to begin with, arrays of any structure."""

    def start(self, mesh: TriangleMesh) -> PyTree[Float[Array, "..."]]:
        given = jax.eval_shape(self.vertices, self.initial)
        if given.shape != mesh.vertices.shape:
            raise ValueError(
                f"the positions of the parameters have shape {list(given.shape)}, "
                f"the mesh's {list(mesh.vertices.shape)}"
            )
        return self.initial

    def surface(self, theta: Any, original: Configuration) -> Configuration:
        vertices = self.vertices(theta).astype(original.lengths.dtype)
        return Configuration(edge_lengths(vertices, original.topology), vertices, original.topology)


def _smoothed(field: Float[Array, "V 3"], original: Configuration, length: float) -> Float[Array, "V 3"]:
    """(M + s²L)⁻¹ M field, s in mean edges, M and L the lumped mass and the cotangent Laplacian of the original."""
    topology: Topology = original.topology
    mass = barycentric_vertex_areas(original.lengths, topology)[:, None]
    weights = (length * original.unit) ** 2 * cotan_weights(original.lengths, topology)[:, None]
    tail, head = topology.edges.T

    def product(x: Float[Array, "V 3"]) -> Float[Array, "V 3"]:
        flux = weights * (x[tail] - x[head])
        spread = jnp.zeros_like(x).at[tail].add(flux).at[head].add(-flux)
        return mass * x + spread

    diagonal = mass.at[tail].add(weights).at[head].add(weights)
    smooth, _ = jax.scipy.sparse.linalg.cg(
        product, mass * field, tol=1e-10, maxiter=500, M=lambda r: r / diagonal
    )
    return smooth
