"""The main result: approximate Killing vector fields of a mesh, and how far each is from a symmetry."""

from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array, Float, Int

from .eigen import RESULTS, AbstractEigensolver, EigenSolution, cluster_labels, eigsolve
from .geometry import edge_lengths, embed, surface_area, vertex_frames
from .killing import AbstractDiscretization, discretization_named, vector_mass
from .mesh import Topology, TriangleMesh


class KillingFields(eqx.Module):
    """The k tangent fields of smallest Killing energy, ascending: λ = 0 is an exact continuous intrinsic symmetry."""

    eigenvalues: Float[Array, " k"]
    """λ = ∫‖KU‖² / ∫|U|². Unit: length⁻²; λ · area is the dimensionless number to report and compare."""
    vectors: Float[Array, "k V 3"]
    """Tangent vectors in R³ at the vertices, of unit norm ∫|U|² = 1. Unit: length⁻¹."""
    coefficients: Float[Array, "k n"]
    """The discretization's own unknowns, orthonormal in its B."""
    residuals: Float[Array, " k"]
    """‖A x − λ B x‖ / (‖A‖ ‖x‖)."""
    clusters: Int[Array, " k"]
    """Number of the cluster of (nearly) equal eigenvalues each belongs to: equal numbers, equal eigenvalues."""
    area: Float[Array, ""]
    """Surface area. Unit: length²."""
    result: RESULTS
    stats: dict[str, Any]

    @property
    def dimensionless(self) -> Float[Array, " k"]:
        """λ · area, invariant under scaling."""
        return self.eigenvalues * self.area


def killing_fields(
    mesh: TriangleMesh,
    k: int = 6,
    *,
    discretization: str | AbstractDiscretization = "regge",
    solver: AbstractEigensolver | None = None,
    throw: bool = True,
) -> KillingFields:
    """The k approximate Killing vector fields of smallest energy, by K*KU = λU (eq. (7), (11) of the paper).

    Args:
        mesh: the surface, with or without boundary.
        k: number of fields.
        discretization: `"regge"` (vertex vectors, the default) or `"dec"` (the paper's 1-forms; needs a Delaunay mesh).
        solver: eigensolver; by default chosen by size.
        throw: raise if the eigensolver fails; otherwise look at `.result`.

    Raises:
        ValueError: k not an integer between 1 and the number of unknowns; unknown discretization.
        equinox.EquinoxRuntimeError: the eigensolver failed and `throw`.
    """
    return _killing_fields(mesh, k, discretization_named(discretization), solver, throw)


def killing_eigenvalues(
    mesh: TriangleMesh,
    k: int = 6,
    *,
    discretization: str | AbstractDiscretization = "regge",
    solver: AbstractEigensolver | None = None,
    throw: bool = True,
) -> Float[Array, " k"]:
    """The k smallest eigenvalues λ of the Killing operator, ascending. Unit: length⁻².

    Differentiable in forward and reverse mode: `jax.grad(lambda x: killing_eigenvalues(mesh.with_vertices(x), 1)[0])`.
    Inside a cluster differentiate the sum (see `jaxkvf.eigen.eigsolve`). Arguments and errors as for `killing_fields`.
    """
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    return intrinsic_killing_eigenvalues(
        lengths, mesh.topology, k, discretization=discretization, solver=solver, throw=throw
    )


def intrinsic_killing_eigenvalues(
    lengths: Float[Array, " E"],
    topology: Topology,
    k: int = 6,
    *,
    discretization: str | AbstractDiscretization = "regge",
    solver: AbstractEigensolver | None = None,
    throw: bool = True,
) -> Float[Array, " k"]:
    """`killing_eigenvalues` of a surface given by its edge lengths alone, and differentiable with respect to them.

    Raises:
        ValueError: as for `killing_fields`, or not one length an edge.
    """
    if lengths.shape != (topology.n_edges,):
        raise ValueError(f"lengths must have shape [{topology.n_edges}], one an edge, got {list(lengths.shape)}")
    return _solve(lengths, topology, k, discretization_named(discretization), solver, throw).eigenvalues


@eqx.filter_jit
def _solve(
    lengths: Float[Array, " E"],
    topology: Topology,
    k: int,
    discretization: AbstractDiscretization,
    solver: AbstractEigensolver | None,
    throw: bool,
) -> EigenSolution:
    return eigsolve(discretization.eigenproblem(lengths, topology), k, solver, throw=throw)


@eqx.filter_jit
def _killing_fields(
    mesh: TriangleMesh,
    k: int,
    discretization: AbstractDiscretization,
    solver: AbstractEigensolver | None,
    throw: bool,
) -> KillingFields:
    topology = mesh.topology
    lengths = edge_lengths(mesh.vertices, topology)
    solution = _solve(lengths, topology, k, discretization, solver, throw)
    coefficients = solution.eigenvectors.T
    mass = vector_mass(lengths, topology)
    area = surface_area(lengths, topology)

    def unit_field(coefficients: Float[Array, " n"]) -> Float[Array, "V 2"]:
        vectors = discretization.to_vertex_vectors(coefficients, lengths, topology)
        flattened = vectors.ravel()
        return vectors / jax.numpy.sqrt(flattened @ mass.mv(flattened))

    vectors = embed(jax.vmap(unit_field)(coefficients), vertex_frames(mesh.vertices, topology))
    return KillingFields(
        eigenvalues=solution.eigenvalues,
        vectors=vectors,
        coefficients=coefficients,
        residuals=solution.residuals,
        clusters=cluster_labels(solution.eigenvalues, atol=_EXACT / area),
        area=area,
        result=solution.result,
        stats=solution.stats,
    )


_EXACT = 1e-3  # λ·area below which a symmetry counts as exact when eigenvalues are grouped
