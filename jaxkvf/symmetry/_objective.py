"""What symmetrization minimises: the asymmetry of the mesh, and the price of moving it."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..eigen import RESULTS, AbstractEigensolver, eigsolve
from ..geometry import corner_cotangents, edge_lengths, face_areas, mean_edge_length, surface_area
from ..killing import AbstractDiscretization
from ..mesh import TriangleMesh


class AbstractTerm(eqx.Module):
    """A smooth dimensionless price of moving `original` to `moved`, 0 for not moving at all."""

    @abc.abstractmethod
    def __call__(self, moved: TriangleMesh, original: TriangleMesh) -> Float[Array, ""]:
        """The price, its weight included."""


class PositionFidelity(AbstractTerm):
    """Weight × mean squared displacement of the vertices, in mean edge lengths of the original."""

    weight: float = eqx.field(default=1e-4, static=True)

    def __call__(self, moved: TriangleMesh, original: TriangleMesh) -> Float[Array, ""]:
        unit = mean_edge_length(edge_lengths(original.vertices, original.topology))
        displacement = (moved.vertices - original.vertices) / unit
        return self.weight * (displacement**2).sum(axis=1).mean()


class ShapeBarrier(AbstractTerm):
    """Weight × mean symmetric Dirichlet energy of the triangles: infinite for slivers, indifferent to bending.

    Of the affine map from each triangle's original shape to its moved one, ½ (|J|² + |J⁻¹|²) − 2 ≥ 0 with 0 for rotations:
    it keeps angles and areas, and grows like area⁻² as a triangle collapses, so no needle or sliver pays.

    Reference: J. Smith, S. Schaefer, Bijective Parameterization with Free Boundaries (2015).
    """

    weight: float = eqx.field(default=1e-4, static=True)

    def __call__(self, moved: TriangleMesh, original: TriangleMesh) -> Float[Array, ""]:
        topology = original.topology
        rest = edge_lengths(original.vertices, topology)
        lengths = edge_lengths(moved.vertices, topology)
        rest_area, area = face_areas(rest, topology), face_areas(lengths, topology)
        # |J|² = Σ cot(opposite) ℓ² / (2 rest area) over the sides, cotangents at rest; corner s + 2 faces side s.
        cot = corner_cotangents(rest, topology)[:, [2, 0, 1]]
        squared_norm = (cot * lengths[topology.face_edges] ** 2).sum(axis=1) / (2 * rest_area)
        determinant = area / rest_area
        energy = 0.5 * squared_norm * (1 + determinant**-2) - 2
        return self.weight * (rest_area * energy).sum() / rest_area.sum()


class Evaluation(eqx.Module):
    """The objective at one mesh, taken apart."""

    dimensionless: Float[Array, " k"]
    """λ · area of the first few fields."""
    terms: Float[Array, " t"]
    """Price of each term."""
    solved: Bool[Array, ""]
    """Whether the eigensolver converged."""
    eigenvectors: Float[Array, "n k"]
    """Of the first few fields: where the eigensolver may start at a mesh nearby."""


class SymmetryObjective(eqx.Module):
    """Σ_{i<count} λ_i · area + Σ terms, as a function of the vertices' displacement in mean edge lengths.

    λ · area, not λ: inflating the mesh lowers λ but leaves λ · area alone.
    """

    original: TriangleMesh
    terms: tuple[AbstractTerm, ...]
    count: int = eqx.field(static=True)
    discretization: AbstractDiscretization
    solver: AbstractEigensolver | None

    @property
    def unit(self) -> Float[Array, ""]:
        """Mean edge length of the original."""
        return mean_edge_length(edge_lengths(self.original.vertices, self.original.topology))

    def moved(self, displacement: Float[Array, "V 3"]) -> TriangleMesh:
        return self.original.with_vertices(self.original.vertices + self.unit * displacement)

    def __call__(
        self, displacement: Float[Array, "V 3"], guess: Float[Array, "n k"] | None
    ) -> tuple[Float[Array, ""], Evaluation]:
        """The objective, infinite where the eigensolver fails so that a minimiser steps back; for optimistix.

        `guess` are approximate eigenvectors, which save steps but do not change the result.
        """
        mesh = self.moved(displacement)
        lengths = edge_lengths(mesh.vertices, mesh.topology)
        problem = self.discretization.eigenproblem(lengths, mesh.topology)
        k = min(self.count + 2, problem.size)
        solution = eigsolve(problem, k, self.solver, guess=guess, throw=False)
        dimensionless = solution.eigenvalues * surface_area(lengths, mesh.topology)
        prices = jnp.stack([term(mesh, self.original) for term in self.terms]) if self.terms else jnp.zeros(0)
        solved = solution.result == RESULTS.successful
        total = dimensionless[: self.count].sum() + prices.sum()
        return jnp.where(solved, total, jnp.inf), Evaluation(
            dimensionless, prices, solved, solution.eigenvectors
        )
