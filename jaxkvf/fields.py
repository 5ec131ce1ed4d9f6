"""The main result: approximate Killing vector fields of a mesh, and how far each is from a symmetry."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .arguments import Integer, check_shape, checked_integer
from .eigen import (
    RESULTS,
    AbstractEigensolver,
    GeneralizedEigenproblem,
    cluster_labels,
    eigenvalues,
    eigsolve,
    spectral_sum,
)
from .geometry import barycentric_vertex_areas, edge_lengths, embed, length_unit, surface_area, vertex_frames
from .killing import AbstractDiscretization, discretization_named, vector_mass
from .mesh import Topology, TriangleMesh, check_fits, name_first
from .solvers import chosen_solver, working_memory
from .trust import trusted

EXACT = 1e-3
"""λ · area below which a symmetry counts as exact up to discretization. Dimensionless."""


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
    trusted: Bool[Array, " k"]
    """Whether the mesh is fine enough for what was found: False where a small λ · area would not stay small on a finer mesh.

    Such a field is not the sign of a symmetry: the mesh is too coarse to tell (see `jaxkvf.trust`).
    """
    result: RESULTS
    stats: dict[str, Array | int | float]
    """Counts of work done, by name; what is counted depends on the solver."""
    solver: str = eqx.field(static=True)
    """Which eigensolver solved, and why this one."""

    @property
    def dimensionless(self) -> Float[Array, " k"]:
        """λ · area, invariant under scaling."""
        return self.eigenvalues * self.area


def killing_fields(
    mesh: TriangleMesh,
    k: Integer = 6,
    *,
    discretization: str | AbstractDiscretization = "regge",
    region: object = None,
    solver: AbstractEigensolver | None = None,
    guess: KillingFields | Float[Array, "g n"] | None = None,
    degenerate: str = "error",
    throw: bool = True,
) -> KillingFields:
    """The k approximate Killing vector fields of smallest energy, by K*KU = λU (eq. (7), (11) of the paper).

    Args:
        mesh: the surface, with or without boundary.
        k: number of fields.
        discretization: `"regge"` (vertex vectors, the default), `"dec"` (the paper's 1-forms, on the intrinsic Delaunay
            triangulation), or `"regge-delaunay"` (`regge` on it: for meshes with thin triangles).
        region: faces of the piece to look at alone, with free boundary, as a mask `[F]` or as numbers; by default all. The
            vectors are then 0 outside of it, everything else is the piece's own. A component can be solved apart so.
        solver: eigensolver; by default chosen by size and k: `.solver` says which, and why.
        guess: fields of a surface nearby, or their `coefficients`, to start from: a warm start in a training loop. Taken as
            they are: no derivative passes through them.
        degenerate: what differentiating inside a cluster of equal eigenvalues does, see `jaxkvf.eigen.eigsolve`.
        throw: raise if the eigensolver fails; otherwise look at `.result`.

    Raises:
        ValueError: k not an integer between 1 and the number of unknowns; unknown discretization; not a region, or one
            that touches itself in a vertex, where a field has a vector on either side.
        MeshTooLargeError: memory will not hold the solve.
        equinox.EquinoxRuntimeError: the eigensolver failed and `throw`.
    """
    if region is not None:
        piece, origins = mesh.submesh(region)
        _check_unpinched(origins)
        found = killing_fields(
            piece,
            k,
            discretization=discretization,
            solver=solver,
            guess=guess,
            degenerate=degenerate,
            throw=throw,
        )
        vectors = jnp.zeros((k, *mesh.vertices.shape), found.vectors.dtype).at[:, origins].set(found.vectors)
        return eqx.tree_at(lambda f: f.vectors, found, vectors)
    chosen = discretization_named(discretization)
    # On the surface scaled to edges of about 1: solvers then meet the same numbers at any scale.
    unit = length_unit(edge_lengths(mesh.vertices, mesh.topology))
    scaled = mesh.with_vertices(mesh.vertices / unit)
    lengths = edge_lengths(scaled.vertices, mesh.topology)
    problem, solver, reason = _posed(chosen, lengths, mesh.topology, k, solver)
    start = _starting_vectors(guess, problem)
    solution = eigsolve(problem, k, solver, guess=start, degenerate=degenerate, throw=throw)
    vectors, coefficients, area = _unit_vectors(chosen, scaled, solution.eigenvectors.T, unit)
    return KillingFields(
        eigenvalues=solution.eigenvalues / unit**2,
        vectors=vectors,
        coefficients=coefficients,
        residuals=solution.residuals,
        clusters=cluster_labels(solution.eigenvalues, atol=EXACT / area),
        area=area * unit**2,
        trusted=jnp.asarray(trusted(chosen, lengths, mesh.topology, solution.eigenvalues)),
        result=solution.result,
        stats=solution.stats,
        solver=reason,
    )


def killing_eigenvalues(
    mesh: TriangleMesh,
    k: Integer = 6,
    *,
    discretization: str | AbstractDiscretization = "regge",
    solver: AbstractEigensolver | None = None,
    guess: KillingFields | Float[Array, "g n"] | None = None,
    degenerate: str = "error",
    throw: bool = True,
) -> Float[Array, " k"]:
    """The k smallest eigenvalues λ of the Killing operator, ascending. Unit: length⁻².

    Differentiable to any order, in forward and reverse mode:
    `jax.grad(lambda x: killing_eigenvalues(mesh.with_vertices(x), 1)[0])`. Inside a cluster of equal eigenvalues
    differentiate their sum; the gradient of a single one is an error that names the cluster, or with `degenerate="mean"`
    that of the cluster's mean (see `jaxkvf.eigen.eigsolve`). Other arguments and errors as for `killing_fields`.
    """
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    return intrinsic_killing_eigenvalues(
        lengths,
        mesh.topology,
        k,
        discretization=discretization,
        solver=solver,
        guess=guess,
        degenerate=degenerate,
        throw=throw,
    )


def killing_spectral_sum(
    mesh: TriangleMesh,
    function: Callable[[Float[Array, ""]], Float[Array, ""]],
    k: int = 6,
    *,
    discretization: str | AbstractDiscretization = "regge",
    solver: AbstractEigensolver | None = None,
    guess: KillingFields | Float[Array, "g n"] | None = None,
    throw: bool = True,
) -> Float[Array, ""]:
    """Σ f(λᵢ) over the k smallest eigenvalues λ, differentiable through clusters, where single eigenvalues are not.

    A trace of heat kernels, say: `killing_spectral_sum(mesh, lambda value: jnp.exp(-time * value), 10)`.

    Args:
        mesh: the surface, like the others as for `killing_fields`.
        function: f, of one eigenvalue (unit: length⁻²), twice differentiable by JAX.
        k: number of eigenvalues; a k that cuts a cluster is an error when differentiated.
    """
    chosen = discretization_named(discretization)
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    problem, solver, _ = _posed(chosen, lengths, mesh.topology, k, solver)
    start = _starting_vectors(guess, problem)
    return spectral_sum(function, problem, k, solver, guess=start, throw=throw)


def intrinsic_killing_eigenvalues(
    lengths: Float[Array, " E"],
    topology: Topology,
    k: Integer = 6,
    *,
    discretization: str | AbstractDiscretization = "regge",
    solver: AbstractEigensolver | None = None,
    guess: KillingFields | Float[Array, "g n"] | None = None,
    degenerate: str = "error",
    throw: bool = True,
) -> Float[Array, " k"]:
    """`killing_eigenvalues` of a surface given by its edge lengths alone, and differentiable with respect to them.

    Raises:
        ValueError: as for `killing_fields`, or not one length an edge.
    """
    check_shape("lengths", lengths, (topology.n_edges,), "one an edge")
    chosen = discretization_named(discretization)
    unit = length_unit(lengths)
    problem, solver, _ = _posed(chosen, lengths / unit, topology, k, solver)
    start = _starting_vectors(guess, problem)
    return eigenvalues(problem, k, solver, guess=start, degenerate=degenerate, throw=throw) / unit**2


def _starting_vectors(
    guess: KillingFields | Float[Array, "g n"] | None, problem: GeneralizedEigenproblem
) -> Float[Array, "n g"] | None:
    if guess is None:
        return None
    coefficients = guess.coefficients if isinstance(guess, KillingFields) else jnp.asarray(guess)
    if coefficients.ndim != 2 or coefficients.shape[1] != problem.size:
        raise ValueError(
            f"guess must have coefficients [any, {problem.size}], got {list(coefficients.shape)}: pass fields of a mesh "
            "with the same connectivity, in the same discretization"
        )
    return jax.lax.stop_gradient(coefficients).T


def _check_unpinched(origins: Int[np.ndarray, " n"]) -> None:
    vertices, copies = np.unique(origins, return_counts=True)
    pinched = vertices[copies > 1]
    if pinched.size:
        raise ValueError(
            f"the region touches itself in {name_first('vertex', pinched)}, where a field would have several vectors: add "
            "the faces between, or solve on the mesh that `mesh.submesh(region)` returns, which has a copy for each side"
        )


def component_shares(mesh: TriangleMesh, fields: KillingFields) -> Float[np.ndarray, "k C"]:
    """Share of ∫|U|² of each field on each component of the mesh (numbered as by `mesh.topology.components`).

    1 where a field lives on one component alone; fields of equal eigenvalues on several may come mixed.
    """
    count, component = mesh.topology.components()
    areas = barycentric_vertex_areas(edge_lengths(mesh.vertices, mesh.topology), mesh.topology)
    density = np.asarray(areas) * (np.asarray(fields.vectors) ** 2).sum(axis=2)
    shares = np.stack([density[:, component == c].sum(axis=1) for c in range(count)], axis=1)
    return shares / shares.sum(axis=1, keepdims=True)


def _posed(
    discretization: AbstractDiscretization,
    lengths: Float[Array, " E"],
    topology: Topology,
    k: Integer,
    solver: AbstractEigensolver | None,
) -> tuple[GeneralizedEigenproblem, AbstractEigensolver, str]:
    """The problem, a solver for it, and why this one."""
    if lengths.dtype not in (jnp.float32, jnp.float64):
        raise ValueError(f"positions or lengths must be of float32 or float64, got {lengths.dtype}")
    needed = working_memory(topology, discretization, k, solver)
    check_fits(needed, f"solving on {topology.n_vertices} vertices")
    problem = _assemble(discretization, lengths, topology)
    # Before a solver is chosen and built for it.
    k = checked_integer("k", k, 1, problem.size, limit="the number of unknowns")
    if solver is not None:
        return problem, solver, "the caller's"
    return problem, *chosen_solver(lengths, topology, discretization, k)


# Assembly and finish are jitted, the solve between them is not: a solver on the host then needs no callback, and compiled
# code without callbacks can be kept on disk by JAX's compilation cache.
@eqx.filter_jit
def _assemble(
    discretization: AbstractDiscretization, lengths: Float[Array, " E"], topology: Topology
) -> GeneralizedEigenproblem:
    return discretization.eigenproblem(lengths, topology)


@eqx.filter_jit
def _unit_vectors(
    discretization: AbstractDiscretization,
    mesh: TriangleMesh,
    coefficients: Float[Array, "k n"],
    unit: Float[Array, ""],
) -> tuple[Float[Array, "k V 3"], Float[Array, "k n"], Float[Array, ""]]:
    """Fields in R³, each scaled to ∫|U|² = 1, and coefficients, both on the mesh times `unit`; the area of the mesh."""
    topology = mesh.topology
    lengths = edge_lengths(mesh.vertices, topology)
    mass = vector_mass(lengths, topology)

    def vectors_of(coefficients: Float[Array, " n"]) -> Float[Array, "V 2"]:
        return discretization.to_vertex_vectors(coefficients, lengths, topology)

    def unit_field(coefficients: Float[Array, " n"]) -> Float[Array, "V 2"]:
        vectors = vectors_of(coefficients)
        return vectors / (unit * jnp.sqrt(vectors.ravel() @ mass.mv(vectors.ravel())))

    # What coefficients stand for, vectors or vectors times a length, shows in how they scale.
    held = jax.lax.stop_gradient(coefficients[0])
    scaled = discretization.to_vertex_vectors(held, jax.lax.stop_gradient(unit * lengths), topology)
    change = jax.lax.stop_gradient(jnp.abs(vectors_of(held)).max()) / jnp.abs(scaled).max()
    vectors = embed(jax.vmap(unit_field)(coefficients), vertex_frames(mesh.vertices, topology))
    return vectors, coefficients * (change / unit), surface_area(lengths, topology)
