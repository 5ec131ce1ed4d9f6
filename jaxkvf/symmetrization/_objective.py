"""What a symmetrization minimises: the asymmetry of a surface, and the price of moving it."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from ..eigen import AbstractEigensolver
from ._configuration import Configuration
from ._targets import BEYOND, AbstractTarget, dimensionless_energies, strains
from ._terms import AbstractTerm
from ._unknowns import AbstractUnknowns


class Evaluation(eqx.Module):
    """The objective at one surface, taken apart."""

    dimensionless: Float[Array, " k"]
    """λ · area of the target's fields, and about that of the next two."""
    terms: Float[Array, " t"]
    """Price of each term."""
    solved: Bool[Array, ""]
    """Whether the eigensolver converged."""
    fields: Float[Array, "n g"]
    """These fields first, then earlier ones: where the eigensolver may start at a surface nearby."""


class Accepted(eqx.Module):
    """What an evaluation knows of the last accepted step."""

    fields: Float[Array, "n g"] | None
    """Approximate eigenvectors: they save time but do not change the result."""
    bound: Float[Array, ""]
    """Σ λ · area of the target may not rise above it."""


def least_meaning(dtype: Any) -> float:
    """|λ · area| below which a value that should be positive may be negative by rounding alone."""
    return float(jnp.finfo(dtype).eps) ** 0.5


class SymmetryObjective(eqx.Module):
    """Asymmetry Σ λ · area of the target's fields + Σ terms, as a function of the unknowns θ.

    λ · area, not λ: inflating a surface lowers λ but leaves λ · area alone. Gradients hold the eigenvectors fixed
    (Hellmann–Feynman: eigenvalues are minima of their Rayleigh quotients).
    """

    original: Configuration
    unknowns: AbstractUnknowns
    target: AbstractTarget
    terms: tuple[AbstractTerm, ...]
    solver: AbstractEigensolver | None

    def surface(self, theta: PyTree) -> Configuration:
        return self.unknowns.surface(theta, self.original)

    def surfaces(self, theta: PyTree) -> tuple[Configuration, Configuration]:
        """That of θ, and the original."""
        return self.surface(theta), self.original

    def asymmetry(self, evaluation: Evaluation) -> Float[Array, ""]:
        """Σ λ · area of the target's fields."""
        return evaluation.dimensionless[: self.target.count()].sum()

    def is_allowed(
        self, surface: Configuration, asymmetry: Float[Array, ""], bound: Float[Array, ""]
    ) -> Bool[Array, ""]:
        """Whether a minimiser may go there."""
        valid = self.unknowns.is_valid(surface, self.original)
        return valid & (asymmetry <= bound) & (asymmetry >= -least_meaning(asymmetry.dtype))

    def prices(self, surface: Configuration) -> Float[Array, " t"]:
        prices = [term(surface, self.original) for term in self.terms]
        return jnp.stack(prices) if prices else jnp.zeros(0, surface.lengths.dtype)

    def __call__(self, theta: PyTree, accepted: Accepted) -> tuple[Float[Array, ""], Evaluation]:
        """For an optimistix minimiser. Infinite, so that it steps back, where the surface is not valid, the eigensolver
        fails, or the asymmetry is above the bound, or below zero."""
        surface = self.surface(theta)
        fields, solved = self.target.find(jax.lax.stop_gradient(surface), accepted.fields, self.solver)
        found = self.evaluated(surface, fields, solved)
        asymmetry = self.asymmetry(found)
        allowed = solved & self.is_allowed(surface, asymmetry, accepted.bound)
        return jnp.where(allowed, asymmetry + found.terms.sum(), jnp.inf).astype(float), found

    def evaluated(
        self, surface: Configuration, fields: Float[Array, "n g"], solved: Bool[Array, ""]
    ) -> Evaluation:
        """The objective's parts at a surface whose fields are known; derivatives hold these fixed."""
        fields, count = jax.lax.stop_gradient(fields), self.target.count()
        energies = dimensionless_energies(surface, fields[:, :count])
        watched = fields[:, count : count + BEYOND]
        watched = dimensionless_energies(jax.lax.stop_gradient(surface), watched)
        return Evaluation(jnp.concatenate([energies, watched]), self.prices(surface), solved, fields)


class SquaredObjective(eqx.Module):
    """The same as a sum of squares in (θ, fields), for Gauss–Newton methods: at its minimum the fields are eigenvectors."""

    objective: SymmetryObjective

    def surfaces(self, unknowns: tuple[PyTree, Float[Array, "n m"]]) -> tuple[Configuration, Configuration]:
        return self.objective.surfaces(unknowns[0])

    def __call__(
        self, unknowns: tuple[PyTree, Float[Array, "n m"]], accepted: Accepted
    ) -> tuple[Float[Array, " r"], Evaluation]:
        """For an optimistix least-squares solver, with Σ r²/2 as its objective. Infinite where not valid."""
        theta, fields = unknowns[0], unknowns[1].astype(self.objective.original.lengths.dtype)
        surface, original = self.objective.surface(theta), self.objective.original
        strain = strains(surface, fields)
        allowed = self.objective.is_allowed(surface, (strain**2).sum(), accepted.bound)
        residuals = [strain, *(term.residuals(surface, original) for term in self.objective.terms)]
        found = Evaluation(
            dimensionless_energies(surface, fields), self.objective.prices(surface), allowed, fields
        )
        return jnp.where(allowed, jnp.concatenate(residuals), jnp.inf).astype(float), found
