"""What a symmetrization minimises: the asymmetry of a surface, and the price of moving it."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from ..eigen import AbstractEigensolver
from ._surface import Surface
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
    asymmetry: Float[Array, ""]
    """Σ λ · area of the target: it may not rise."""


class SymmetryObjective(eqx.Module):
    """Asymmetry Σ λ · area of the target's fields + Σ terms, as a function of the unknowns θ.

    λ · area, not λ: inflating a surface lowers λ but leaves λ · area alone. Gradients hold the eigenvectors fixed
    (Hellmann–Feynman: eigenvalues are minima of their Rayleigh quotients).
    """

    original: Surface
    unknowns: AbstractUnknowns
    target: AbstractTarget
    terms: tuple[AbstractTerm, ...]
    solver: AbstractEigensolver | None

    def surface(self, theta: PyTree) -> Surface:
        return self.unknowns.surface(theta, self.original)

    def surfaces(self, theta: PyTree) -> tuple[Surface, Surface]:
        """That of θ, and the original."""
        return self.surface(theta), self.original

    def accepted(self, evaluation: Evaluation) -> Accepted:
        """After this accepted step."""
        asymmetry = evaluation.dimensionless[: self.target.count()].sum()
        # The start itself is evaluated once more, and rounding may raise it.
        return Accepted(evaluation.fields, asymmetry * (1 + 1e-9))

    def prices(self, surface: Surface) -> Float[Array, " t"]:
        prices = [term(surface, self.original) for term in self.terms]
        return jnp.stack(prices) if prices else jnp.zeros(0, surface.lengths.dtype)

    def __call__(self, theta: PyTree, accepted: Accepted) -> tuple[Float[Array, ""], Evaluation]:
        """For an optimistix minimiser. Infinite, so that it steps back, where the surface is not valid, the eigensolver
        fails, or the asymmetry is above that of the last accepted step."""
        surface = self.surface(theta)
        fields, solved = self.target.find(jax.lax.stop_gradient(surface), accepted.fields, self.solver)
        found = self.evaluated(surface, fields, solved)
        asymmetry = found.dimensionless[: self.target.count()].sum()
        allowed = solved & self.unknowns.is_valid(surface, self.original) & (asymmetry <= accepted.asymmetry)
        return jnp.where(allowed, asymmetry + found.terms.sum(), jnp.inf), found

    def evaluated(self, surface: Surface, fields: Float[Array, "n g"], solved: Bool[Array, ""]) -> Evaluation:
        """The objective's parts at a surface whose fields are known; derivatives hold these fixed."""
        fields, count = jax.lax.stop_gradient(fields), self.target.count()
        energies = dimensionless_energies(surface, fields[:, :count])
        watched = fields[:, count : count + BEYOND]
        watched = dimensionless_energies(jax.lax.stop_gradient(surface), watched)
        return Evaluation(jnp.concatenate([energies, watched]), self.prices(surface), solved, fields)


class SquaredObjective(eqx.Module):
    """The same as a sum of squares in (θ, fields), for Gauss–Newton methods: at its minimum the fields are eigenvectors."""

    objective: SymmetryObjective

    def surfaces(self, unknowns: tuple[PyTree, Float[Array, "n m"]]) -> tuple[Surface, Surface]:
        return self.objective.surfaces(unknowns[0])

    def accepted(self, evaluation: Evaluation) -> Accepted:
        return self.objective.accepted(evaluation)

    def __call__(
        self, unknowns: tuple[PyTree, Float[Array, "n m"]], accepted: Accepted
    ) -> tuple[Float[Array, " r"], Evaluation]:
        """For an optimistix least-squares solver, with Σ r²/2 as its objective. Infinite where not valid."""
        theta, fields = unknowns
        surface, original = self.objective.surface(theta), self.objective.original
        strain = strains(surface, fields)
        valid = self.objective.unknowns.is_valid(surface, original)
        allowed = valid & ((strain**2).sum() <= accepted.asymmetry)
        residuals = [strain, *(term.residuals(surface, original) for term in self.objective.terms)]
        found = Evaluation(
            dimensionless_energies(surface, fields), self.objective.prices(surface), valid, fields
        )
        return jnp.where(allowed, jnp.concatenate(residuals), jnp.inf), found
