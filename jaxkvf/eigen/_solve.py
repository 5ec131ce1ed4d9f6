"""The entries to all eigensolvers: eigenpairs, eigenvalues alone, and spectral functions, all differentiable."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..arguments import Integer, check_shape, checked_choice, checked_integer
from ..sparse import assembled
from ._clusters import averaged, cluster_means, individual, whole, without_gauge
from ._deflated import held
from ._dense import DenseEigh
from ._derivatives import Eigenspaces, basis, energies
from ._problem import GeneralizedEigenproblem
from ._scipy import ScipyEigsh
from ._solution import RESULTS, EigenSolution
from ._solver import AbstractEigensolver

_DENSE_IS_FASTER = 400  # unknowns

_POLICIES = ("error", "mean")


def eigsolve(
    problem: GeneralizedEigenproblem,
    k: Integer,
    solver: AbstractEigensolver | None = None,
    *,
    guess: Float[Array, "n g"] | None = None,
    degenerate: str = "error",
    throw: bool = True,
) -> EigenSolution:
    """The k smallest eigenpairs of A x = λ B x, differentiable with respect to the arrays of A and B.

    Forward and reverse mode, to any order, under `jit` and `vmap`, with every solver. Eigenvalues by Hellmann–Feynman,
    dλ = xᵀ(dA − λ dB)x; eigenvectors by a deflated linear solve that uses the solver's preconditioner or factorization
    (where only eigenvalues are differentiated, `eigenvalues` saves it in forward mode). When differentiated, k + 1 pairs are
    computed, to know where the last cluster ends.

    *Clusters.* Inside a cluster of equal eigenvalues (gap below 64 √ε λ) only symmetric functions of them are
    differentiable. Reverse mode raises an error that names the cluster where anything else is asked for: a sum of the
    eigenvalues, or a projector made of the eigenvectors, passes. Forward mode cannot see what will be asked; it gives each
    eigenvalue of a cluster the derivative of their mean, and eigenvectors that of a basis that does not turn inside the
    eigenspace, so that symmetric functions come out right; NaN where the cluster goes on beyond the k asked for.

    Args:
        problem: the eigenproblem of size n.
        k: number of pairs, 1 ≤ k ≤ n.
        solver: `DenseEigh()`, `ScipyEigsh()`, `LOBPCG(…)`; by default by size.
        guess: approximate eigenvectors to start from.
        degenerate: `"mean"` makes reverse mode do as forward mode does instead of raising. For second derivatives of
            eigenvectors' functions in clusters, where the check of the first would see too much.
        throw: raise if the solve fails; otherwise look at `solution.result`.

    Raises:
        ValueError: k is not an integer in 1…n; a guess of the wrong shape; `degenerate` is not one of the two.
        equinox.EquinoxRuntimeError: the solve failed and `throw`; or a derivative was asked for that does not exist. The
            message says why and what to do.
    """
    found = _find(problem, k, solver, guess=guess, degenerate=degenerate, throw=throw, vectors=True)
    vectors = found.solution.eigenvectors
    if degenerate == "error":
        vectors = without_gauge(vectors, found.labels, found.cut)
    return eqx.tree_at(
        lambda s: (s.eigenvalues, s.eigenvectors), found.solution, (_values(found, degenerate), vectors)
    )


def eigenvalues(
    problem: GeneralizedEigenproblem,
    k: Integer,
    solver: AbstractEigensolver | None = None,
    *,
    guess: Float[Array, "n g"] | None = None,
    degenerate: str = "error",
    throw: bool = True,
) -> Float[Array, " k"]:
    """The eigenvalues of `eigsolve` alone, whose first derivatives never need those of eigenvectors; all else as there."""
    return _values(
        _find(problem, k, solver, guess=guess, degenerate=degenerate, throw=throw, vectors=False), degenerate
    )


def spectral_sum(
    function: Callable[[Float[Array, ""]], Float[Array, ""]],
    problem: GeneralizedEigenproblem,
    k: Integer,
    solver: AbstractEigensolver | None = None,
    *,
    guess: Float[Array, "n g"] | None = None,
    throw: bool = True,
) -> Float[Array, ""]:
    """Σ f(λᵢ) over the k smallest eigenvalues, differentiable to second order through clusters, and beyond outside of them.

    The trace of f of an operator has derivatives where single eigenvalues have none. Inside a cluster of mean μ it is
    expanded as Σ f(μ) + ½ f″(μ) tr (Λ − μ)². The k must not cut a cluster: differentiating is an error then.

    Args:
        function: f, scalar to scalar, twice differentiable by JAX.
        problem: as for `eigsolve`, like k, solver, guess and throw.
    """
    found = _find(problem, k, solver, guess=guess, degenerate="mean", throw=throw, vectors=False)
    energies = whole(found.energies, found.labels, found.cut)
    means = cluster_means(energies.diagonal(), found.labels)
    deviation = energies - jnp.diag(means)
    curvature = jax.vmap(jax.grad(jax.grad(function)))(means)
    return (jax.vmap(function)(means) + 0.5 * curvature * (deviation * deviation.T).sum(axis=1)).sum()


class _Found(eqx.Module):
    """Eigenpairs whose derivatives are right as those of eigenspaces: for functions that are symmetric in each cluster."""

    solution: EigenSolution
    energies: Float[Array, "k k"]
    """Λ: the eigenvalues on the diagonal."""
    labels: Int[Array, " k"]
    cut: Bool[Array, " k"]


def _values(found: _Found, degenerate: str) -> Float[Array, " k"]:
    change = individual if degenerate == "error" else averaged
    return change(found.energies, found.labels, found.cut).diagonal()


def _find(
    problem: GeneralizedEigenproblem,
    k: Integer,
    solver: AbstractEigensolver | None,
    *,
    guess: Float[Array, "n g"] | None,
    degenerate: str,
    throw: bool,
    vectors: bool,
) -> _Found:
    k = checked_integer("k", k, 1, problem.size, limit="the number of unknowns")
    if guess is not None:
        check_shape("guess", guess, (problem.size, "any"))
    checked_choice("degenerate", degenerate, _POLICIES)
    if solver is None:
        solver = DenseEigh() if problem.size <= max(_DENSE_IS_FASTER, k) else ScipyEigsh()
    found = _differentiable(problem, jax.lax.stop_gradient(guess), solver, k, vectors)
    if throw:
        found = found.solution.result.error_if(found, found.solution.result != RESULTS.successful)
    return found


@eqx.filter_custom_jvp
def _differentiable(
    problem: GeneralizedEigenproblem,
    guess: Float[Array, "n g"] | None,
    solver: AbstractEigensolver,
    k: int,
    vectors: bool,
) -> _Found:
    solution, _ = _compute(problem, guess, solver, k)
    # Clusters matter to derivatives only, and are found there with one more pair.
    alone = jnp.arange(k, dtype=jnp.int32)
    return _Found(solution, jnp.diag(solution.eigenvalues), alone, jnp.zeros(k, bool))


@_differentiable.def_jvp
def _(primals, tangents):
    problem, guess, solver, k, vectors = primals
    wide, state = _compute(problem, guess, solver, min(k + 1, _room(problem, solver)))
    spaces = Eigenspaces.of(_held_assembled(problem), wide, k, solver, state)

    def of_problem(problem: GeneralizedEigenproblem) -> tuple[Array, Array | None]:
        problem = spaces.unconstrained(problem)
        return energies(problem, spaces), basis(problem, spaces) if vectors else None

    (Lambda, X), (d_Lambda, d_X) = eqx.filter_jvp(of_problem, (problem,), (tangents[0],))
    X = spaces.vectors if X is None else X
    solution = EigenSolution(Lambda.diagonal(), X, wide.residuals[:k], wide.result, wide.stats)
    found = _Found(solution, Lambda, spaces.labels, spaces.cut)
    nothing = jax.tree.map(lambda leaf: None, found)
    changed = eqx.tree_at(
        lambda f: (f.solution.eigenvalues, f.solution.eigenvectors, f.energies),
        nothing,
        (d_Lambda.diagonal(), d_X, d_Lambda),
        is_leaf=lambda leaf: leaf is None,
    )
    return found, changed


def _compute(
    problem: GeneralizedEigenproblem, guess: Float[Array, "n g"] | None, solver: AbstractEigensolver, k: int
) -> tuple[EigenSolution, PyTree]:
    solution, state = solver.compute(_held_assembled(problem), k, guess)
    # What a solver on the host returns would otherwise be a constant of the tangents' program. One array at a time: under
    # `vmap` JAX puts several at once only where they have the batch in the same place.
    return jax.tree.map(jax.device_put, held(solution)), state


def _held_assembled(problem: GeneralizedEigenproblem) -> GeneralizedEigenproblem:
    return held(GeneralizedEigenproblem(assembled(problem.A), assembled(problem.B)))


def _room(problem: GeneralizedEigenproblem, solver: AbstractEigensolver) -> int:
    """How many eigenpairs there are."""
    if solver.constraints is None:
        return problem.size
    n, c = solver.constraints.shape
    if n != problem.size:
        raise ValueError(f"constraints must have shape [{problem.size}, any], got {[n, c]}")
    return n - c
