"""Which eigensolver: the fast one built for a mesh, and the choice where the caller makes none."""

import weakref

import equinox as eqx
import jax
from jax.core import Tracer
from jaxtyping import Array, Float

from .eigen import (
    LOBPCG,
    AbstractEigensolver,
    AbstractPreconditioner,
    DenseEigh,
    GeneralizedEigenproblem,
    ScipyEigsh,
    WithFallback,
    cholmod_is_installed,
)
from .geometry import edge_lengths
from .killing import AbstractDiscretization, Dec, Regge, discretization_named, vector_hierarchy
from .mesh import Topology, TriangleMesh
from .preconditioning import AuxiliarySpace, Coarsening, Multigrid
from .sparse import RowSparseOperator, assembled

_DENSE_BELOW = 400  # unknowns
_MULTIGRID_FROM = {
    "SuperLU": 200_000,
    "CHOLMOD": 400_000,
}  # vertices: where a first call, compilation included, is faster, on a GPU as on a CPU
_MANY = 40  # eigenpairs: the dense algebra of a block this wide outgrows a factorization's solves


def multigrid_solver(
    mesh: TriangleMesh,
    *,
    discretization: str | AbstractDiscretization = "regge",
    rtol: float = 1e-8,
    max_steps: int = 200,
) -> AbstractEigensolver:
    """LOBPCG with a multigrid preconditioner for this mesh's connectivity.

    The hierarchy is built on the host, once; the solver then serves the same connectivity at any positions, also inside
    `jit` and in loops. For `dec`, which is preconditioned through `regge`, it serves shapes close to this one, as its
    preconditioner is that of this shape. Where it does not converge, `ScipyEigsh` solves.

    Args:
        mesh: reference shape, concrete.
        discretization: `"regge"` or `"dec"`.
        rtol: residual to reach, relative to ‖A‖; eigenvalues are accurate to its square.
        max_steps: of LOBPCG.

    Raises:
        ValueError: unknown discretization, or one with no multigrid.
    """
    preconditioner = multigrid_preconditioner(mesh, discretization=discretization)
    return WithFallback(LOBPCG(rtol=rtol, max_steps=max_steps, preconditioner=preconditioner), ScipyEigsh())


def multigrid_preconditioner(
    mesh: TriangleMesh, *, discretization: str | AbstractDiscretization = "regge"
) -> AbstractPreconditioner:
    """That of `multigrid_solver`, for a `LOBPCG` with options of its own.

    Args:
        mesh: reference shape, concrete.
        discretization: `"regge"` or `"dec"`.

    Raises:
        ValueError: unknown discretization, or one with no multigrid.
    """
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    return _preconditioner(lengths, mesh.topology, discretization_named(discretization))


def chosen_solver(
    lengths: Float[Array, " E"], topology: Topology, discretization: AbstractDiscretization, k: int
) -> tuple[AbstractEigensolver, str]:
    """The solver that is likely fastest for one solve, compilation included, and why (by `benchmarks/eigensolvers.py`)."""
    n_vertices, lengths = topology.n_vertices, jax.lax.stop_gradient(lengths)
    if 2 * n_vertices <= max(_DENSE_BELOW, k + 1):
        return DenseEigh(), f"DenseEigh: {n_vertices} vertices are few"
    factorization = "CHOLMOD" if cholmod_is_installed() else "SuperLU"
    shift_invert = f"ScipyEigsh with {factorization}"
    if not isinstance(discretization, Regge | Dec):
        return ScipyEigsh(), f"{shift_invert}: no multigrid for {type(discretization).__name__}"
    if isinstance(lengths, Tracer) or isinstance(topology.edges, Tracer):
        return (
            ScipyEigsh(),
            f"{shift_invert}: traced; build `multigrid_solver(mesh)` outside of jit to use it inside",
        )
    if k > _MANY:
        return ScipyEigsh(), f"{shift_invert}: k = {k} is many"
    least = _MULTIGRID_FROM[factorization]
    if n_vertices < least:
        return ScipyEigsh(), f"{shift_invert}: fewer than {least:,} vertices"
    preconditioner = _preconditioner(lengths, topology, discretization)
    lobpcg = LOBPCG(max_steps=200, preconditioner=preconditioner)
    return WithFallback(lobpcg, ScipyEigsh()), f"LOBPCG with multigrid: at least {least:,} vertices"


def _preconditioner(
    lengths: Float[Array, " E"], topology: Topology, discretization: AbstractDiscretization
) -> AbstractPreconditioner:
    multigrid = Multigrid(_hierarchy(lengths, topology))
    match discretization:
        case Regge():
            return multigrid
        case Dec():
            related, transfer = _vector_problem(lengths, topology, discretization)
            return AuxiliarySpace(related, transfer, multigrid)
        case _:
            raise ValueError(f"no multigrid for {type(discretization).__name__}: use `ScipyEigsh`")


@eqx.filter_jit
def _vector_problem(
    lengths: Float[Array, " E"], topology: Topology, discretization: Dec
) -> tuple[GeneralizedEigenproblem, RowSparseOperator]:
    """The problem in vertex vectors, and the operator that makes them one-forms."""
    problem = Regge().eigenproblem(lengths, topology)
    problem = GeneralizedEigenproblem(assembled(problem.A), assembled(problem.B))
    return problem, discretization.vertex_vector_operator(lengths, topology)


_hierarchies: dict[int, tuple[Coarsening, ...]] = {}


def _hierarchy(lengths: Float[Array, " E"], topology: Topology) -> tuple[Coarsening, ...]:
    """Built at the first shape seen with this `Topology` object, and kept as long as the object lives."""
    key = id(topology)
    if key not in _hierarchies:
        _hierarchies[key] = vector_hierarchy(lengths, topology)
        weakref.finalize(topology, _hierarchies.pop, key, None)
    return _hierarchies[key]
