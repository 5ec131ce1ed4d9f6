"""What is to become symmetric: the lowest fields, or one that is given. Both as an energy and as a sum of squares."""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..arguments import Integer, check_shape, checked_integer
from ..eigen import RESULTS, AbstractEigensolver, GeneralizedEigenproblem, eigsolve
from ..geometry import project, surface_area, vertex_frames
from ..killing import Regge
from ..mesh import TriangleMesh
from ..sparse import assembled, matmat
from ._configuration import Configuration

BEYOND = 2
"""Fields beyond those of the target that are watched."""
_BEFORE = 2  # of how many earlier surfaces the target's fields are kept


class AbstractTarget(eqx.Module):
    """Fields whose Killing energy is to vanish. The asymmetry to minimise is Σ λ · area, blind to scale."""

    @abc.abstractmethod
    def count(self) -> int:
        """Number of fields."""

    @abc.abstractmethod
    def find(
        self, surface: Configuration, guess: Float[Array, "n g"] | None, solver: AbstractEigensolver | None
    ) -> tuple[Float[Array, "n k"], Bool[Array, ""]]:
        """The fields on a surface, and whether they were found.

        Those of the target first, then `BEYOND` more or none, then what else helps to find the next: the guess there.
        """

    @abc.abstractmethod
    def given(self, mesh: TriangleMesh) -> Float[Array, "n k"] | None:
        """The fields, where they are known from the start."""


def _checked_number(number: Integer) -> int:
    most = "the most independent symmetries of a surface,"
    return checked_integer("the number of fields", number, 1, 3, limit=most)


class LowestFields(AbstractTarget):
    """The fields of smallest energy: 1 for a surface of revolution, 2 for a cylinder, 3 for a sphere.

    Two more are carried along, for the record and as guesses. They are exact at the start only: iterating until they
    converge as well would take longer than all the rest. The target's fields on the last two accepted surfaces are carried
    along too: the next is nearer to the span of all three than to the last.
    """

    number: int = eqx.field(default=1, static=True, converter=_checked_number)

    def count(self) -> int:
        return self.number

    def find(
        self, surface: Configuration, guess: Float[Array, "n g"] | None, solver: AbstractEigensolver | None
    ) -> tuple[Float[Array, "n k"], Bool[Array, ""]]:
        problem, k = _assembled_problem(surface), self.number
        shown = min(k + BEYOND, problem.size)
        if guess is None:
            solution = eigsolve(problem, shown, solver, throw=False)
            fields, solved = solution.eigenvectors, solution.result == RESULTS.successful
            before = jnp.zeros((problem.size, _BEFORE * k), fields.dtype)
            return jnp.concatenate([fields, before], axis=1), solved
        solution = eigsolve(problem, k, solver, guess=guess, throw=False)
        fields, solved = solution.eigenvectors, solution.result == RESULTS.successful
        if guess.shape[1] == k:
            return fields, solved
        fields = _ritz_vectors(problem, jnp.concatenate([fields, guess[:, k:shown]], axis=1))
        last = guess[:, :k] * jnp.sign((guess[:, :k] * fields[:, :k]).sum(axis=0))[None, :]
        return jnp.concatenate([fields, last, guess[:, shown:-k]], axis=1), solved

    def given(self, mesh: TriangleMesh) -> None:
        return None


class ChosenField(AbstractTarget):
    """A tangent field to keep: the mesh is moved until this one is Killing, in the intrinsic frames that move with it."""

    vectors: Float[Array, "V 3"] = eqx.field(converter=jnp.asarray)
    """At the vertices of the input, of any norm but 0; the normal part is dropped."""

    def count(self) -> int:
        return 1

    def find(
        self, surface: Configuration, guess: Float[Array, "n g"] | None, solver: AbstractEigensolver | None
    ) -> tuple[Float[Array, "n k"], Bool[Array, ""]]:
        assert guess is not None  # `given`
        return guess, jnp.isfinite(surface.lengths).all()

    def given(self, mesh: TriangleMesh) -> Float[Array, "n k"]:
        check_shape("vectors", self.vectors, mesh.vertices.shape)
        return project(self.vectors, vertex_frames(mesh.vertices, mesh.topology)).reshape(-1, 1)


def _ritz_vectors(problem: GeneralizedEigenproblem, basis: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """The best approximations of eigenvectors in the span of the basis, ascending, B-orthonormal."""
    factor = jnp.linalg.cholesky(basis.T @ matmat(problem.B, basis))
    basis = jax.scipy.linalg.solve_triangular(factor, basis.T, lower=True).T
    return basis @ jnp.linalg.eigh(basis.T @ matmat(problem.A, basis))[1]


@eqx.filter_jit
def _assembled_problem(surface: Configuration) -> GeneralizedEigenproblem:
    problem = killing_problem(surface)
    return GeneralizedEigenproblem(assembled(problem.A), assembled(problem.B))


def killing_problem(surface: Configuration) -> GeneralizedEigenproblem:
    """Discretization `regge`: the other is not positive semi-definite and cannot be minimised."""
    return Regge().eigenproblem(surface.lengths, surface.topology)


def dimensionless_energies(surface: Configuration, fields: Float[Array, "n k"]) -> Float[Array, " k"]:
    """E_K(U) / ‖U‖² · area of each field. At eigenvectors, λ · area and (fields held fixed) its derivative."""
    problem: Any = killing_problem(surface)
    norms = (fields * matmat(problem.B, fields)).sum(axis=0)
    return problem.A.energies(fields) / norms * surface_area(surface.lengths, surface.topology)


def strains(surface: Configuration, fields: Float[Array, "n m"]) -> Float[Array, " r"]:
    """r with Σ r² = tr (UᵀBU)⁻¹(UᵀAU) · area: Σ λ · area at eigenvectors and more anywhere else. Smooth in U."""
    problem: Any = killing_problem(surface)
    gram = fields.T @ matmat(problem.B, fields)
    orthonormal = jax.scipy.linalg.solve_triangular(jnp.linalg.cholesky(gram), fields.T, lower=True).T
    area = surface_area(surface.lengths, surface.topology)
    return (jnp.sqrt(area) * problem.A.root(orthonormal)).ravel()
