"""Which eigensolver: the fast one built for a mesh, and the choice where the caller makes none."""

import weakref

import jax
from jax.core import Tracer
from jaxtyping import Array, Float

from .eigen import (
    LOBPCG,
    AbstractEigensolver,
    Coarsening,
    DenseEigh,
    Multigrid,
    ScipyEigsh,
    WithFallback,
    cholmod_is_installed,
)
from .geometry import edge_lengths
from .killing import AbstractDiscretization, Regge, vector_hierarchy
from .mesh import Topology, TriangleMesh

_DENSE_BELOW = 400  # unknowns
_MULTIGRID_FROM = {
    "SuperLU": 60_000,
    "CHOLMOD": 200_000,
}  # vertices: from here it pays even for a first call that compiles
_MANY = 40  # eigenpairs: the dense algebra of a block this wide outgrows a factorization's solves


def multigrid_solver(mesh: TriangleMesh, *, rtol: float = 1e-8, max_steps: int = 200) -> AbstractEigensolver:
    """LOBPCG with a multigrid preconditioner for this mesh's connectivity, for discretization `regge`.

    The hierarchy is built on the host, once; the solver then serves the same connectivity at any positions, also inside
    `jit` and in loops. Where it does not converge, `ScipyEigsh` solves.

    Args:
        mesh: reference shape, concrete.
        rtol: residual to reach, relative to ‖A‖; eigenvalues are accurate to its square.
        max_steps: of LOBPCG.
    """
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    return WithFallback(_multigrid(lengths, mesh.topology, rtol, max_steps), ScipyEigsh())


def chosen_solver(
    lengths: Float[Array, " E"], topology: Topology, discretization: AbstractDiscretization, k: int
) -> tuple[AbstractEigensolver, str]:
    """The solver that is likely fastest for one solve, compilation included, and why (by `benchmarks/eigensolvers.py`)."""
    n_vertices, lengths = topology.n_vertices, jax.lax.stop_gradient(lengths)
    if 2 * n_vertices <= max(_DENSE_BELOW, k + 1):
        return DenseEigh(), f"DenseEigh: {n_vertices} vertices are few"
    factorization = "CHOLMOD" if cholmod_is_installed() else "SuperLU"
    shift_invert = f"ScipyEigsh with {factorization}"
    if not isinstance(discretization, Regge):
        return ScipyEigsh(), f"{shift_invert}: the multigrid hierarchy is for `regge`"
    if isinstance(lengths, Tracer) or isinstance(topology.edges, Tracer):
        return (
            ScipyEigsh(),
            f"{shift_invert}: traced; build `multigrid_solver(mesh)` outside of jit to use it inside",
        )
    if k > _MANY:
        return ScipyEigsh(), f"{shift_invert}: k = {k} is many"
    least = _MULTIGRID_FROM[factorization]
    backend = jax.default_backend()
    if backend == "cpu" and n_vertices < least:
        return ScipyEigsh(), f"{shift_invert}: fewer than {least:,} vertices on a CPU"
    where = f"at least {least:,} vertices" if backend == "cpu" else f"a {backend} is there"
    return WithFallback(
        _multigrid(lengths, topology, 1e-8, 200), ScipyEigsh()
    ), f"LOBPCG with multigrid: {where}"


def _multigrid(lengths: Float[Array, " E"], topology: Topology, rtol: float, max_steps: int) -> LOBPCG:
    return LOBPCG(rtol=rtol, max_steps=max_steps, preconditioner=Multigrid(_hierarchy(lengths, topology)))


_hierarchies: dict[int, tuple[Coarsening, ...]] = {}


def _hierarchy(lengths: Float[Array, " E"], topology: Topology) -> tuple[Coarsening, ...]:
    """Built at the first shape seen with this `Topology` object, and kept as long as the object lives."""
    key = id(topology)
    if key not in _hierarchies:
        _hierarchies[key] = vector_hierarchy(lengths, topology)
        weakref.finalize(topology, _hierarchies.pop, key, None)
    return _hierarchies[key]
