"""Which eigensolver: the fast one built for a mesh, and the choice where the caller makes none."""

import weakref
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from .arguments import Integer
from .eigen import (
    LOBPCG,
    AbstractEigensolver,
    AbstractPreconditioner,
    Cholmod,
    DenseEigh,
    GeneralizedEigenproblem,
    ScipyEigsh,
    SuperLU,
    WithFallback,
    cholmod_is_installed,
)
from .geometry import edge_lengths
from .killing import AbstractDiscretization, Dec, Regge, discretization_named, vector_hierarchy
from .mesh import Topology, TriangleMesh
from .preconditioning import AuxiliarySpace, Coarsening, Multigrid
from .sparse import RowSparseOperator, assembled

_DENSE_BELOW = 400  # unknowns
# Vertices from which a first call, compilation included, is faster; `benchmarks/eigensolvers.py` prints it.
_MULTIGRID_FROM = {"SuperLU": 200_000, "CHOLMOD": 400_000}
_MANY_SOLVES_FROM = 4_000  # vertices: smaller meshes are solved often before multigrid is compiled
_COMPILED_MANY_SOLVES_FROM = 2_000  # where compiled programs are kept from run to run
# Bytes an unknown, by `benchmarks/memory.py`: factors, for each doubling of the number of unknowns, as they fill in; LOBPCG
# with its matrices and hierarchy, and each column of its block.
_FILL = {Cholmod: 250, SuperLU: 450}
_LOBPCG, _LOBPCG_COLUMN = 2_300, 130
_CLOSE = 2.0  # distortion: LOBPCG takes a tenth more steps then, twice as many at 6
_KEPT_SHAPES = 2
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


def preconditioner_for_many_solves(mesh: TriangleMesh) -> AbstractPreconditioner | None:
    """For solves on many surfaces near this one, of few pairs each, with `regge`; None where shift-invert is faster.

    From 4,000 vertices on, or 2,000 where JAX keeps compiled programs (`jax_compilation_cache_dir`).
    """
    kept = bool(jax.config.jax_compilation_cache_dir)  # pyright: ignore[reportAttributeAccessIssue]
    least = _COMPILED_MANY_SOLVES_FROM if kept else _MANY_SOLVES_FROM
    return multigrid_preconditioner(mesh) if mesh.topology.n_vertices >= least else None


def chosen_solver(
    lengths: Float[Array, " E"], topology: Topology, discretization: AbstractDiscretization, k: Integer
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
    least = _multigrid_from()
    if n_vertices < least:
        return ScipyEigsh(), f"{shift_invert}: fewer than {least:,} vertices"
    preconditioner = _preconditioner(lengths, topology, discretization)
    lobpcg = LOBPCG(max_steps=200, preconditioner=preconditioner)
    return WithFallback(lobpcg, ScipyEigsh()), f"LOBPCG with multigrid: at least {least:,} vertices"


def working_memory(
    topology: Topology, discretization: AbstractDiscretization, k: Integer, solver: AbstractEigensolver | None
) -> int:
    """Bytes that a solve takes, roughly, assembly included (`benchmarks/memory.py` prints what is measured).

    Args:
        topology: connectivity.
        discretization: has one unknown an edge (`dec`) or two a vertex (all others).
        k: number of pairs.
        solver: None for that of `chosen_solver`. Of one that is not ours nothing is known: 0.
    """
    n = topology.n_edges if isinstance(discretization, Dec) else 2 * topology.n_vertices
    dense = 4 * 8 * n**2
    match solver:
        case None if topology.n_vertices >= _multigrid_from() and k <= _MANY:
            return working_memory(topology, discretization, k, LOBPCG())
        case None:
            return min(dense, working_memory(topology, discretization, k, ScipyEigsh()))
        case DenseEigh():
            return dense
        case WithFallback(first=first):  # the other is for what seldom happens
            return working_memory(topology, discretization, k, first)
        case LOBPCG(guard_vectors=guards):
            columns = k + (4 + k // 5 if guards is None else guards)
            return n * (_LOBPCG + _LOBPCG_COLUMN * columns)
        case ScipyEigsh(factorization=factorization):
            fill = _FILL.get(type(factorization), max(_FILL.values()))
            return int(n * (fill * np.log2(n) + 8 * 4 * k))
        case _:
            return 0


def _multigrid_from() -> int:
    return _MULTIGRID_FROM["CHOLMOD" if cholmod_is_installed() else "SuperLU"]


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


class _Kept(NamedTuple):
    """A hierarchy, and the lengths it was built for."""

    lengths: Float[np.ndarray, " E"]
    hierarchy: tuple[Coarsening, ...]


_hierarchies: dict[int, list[_Kept]] = {}


def _hierarchy(lengths: Float[Array, " E"], topology: Topology) -> tuple[Coarsening, ...]:
    """One built for a shape close to this, kept as long as the `Topology` object lives; two of each object, at most."""
    key, now = id(topology), np.asarray(lengths, np.float64)
    if key not in _hierarchies:
        _hierarchies[key] = []
        weakref.finalize(topology, _hierarchies.pop, key, None)
    kept = _hierarchies[key]
    close = [one for one in kept if _distortion(now, one.lengths) <= _CLOSE]
    if not close:
        close = [_Kept(now, vector_hierarchy(lengths, topology))]
    kept[:] = [*close[:1], *(one for one in kept if one is not close[0])][:_KEPT_SHAPES]
    return close[0].hierarchy


def _distortion(lengths: Float[np.ndarray, " E"], others: Float[np.ndarray, " E"]) -> float:
    """By how much more the most stretched edges are longer than the least stretched ones, but for one in a hundred."""
    least, most = np.quantile(lengths / others, [0.01, 0.99])
    return float(most / least)
