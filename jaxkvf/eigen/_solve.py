"""The entry to all eigensolvers, and the derivative of eigenvalues."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..sparse import assembled, matmat
from ._dense import DenseEigh
from ._problem import GeneralizedEigenproblem
from ._scipy import ScipyEigsh
from ._solution import RESULTS, EigenSolution
from ._solver import AbstractEigensolver

_DENSE_IS_FASTER = 400  # unknowns


def eigsolve(
    problem: GeneralizedEigenproblem,
    k: int,
    solver: AbstractEigensolver | None = None,
    *,
    guess: Float[Array, "n g"] | None = None,
    throw: bool = True,
) -> EigenSolution:
    """The k smallest eigenpairs of A x = λ B x.

    Eigenvalues are differentiable with respect to the arrays of A and B, forward and reverse, by Hellmann–Feynman:
    dλ = xᵀ(dA − λ dB)x. Inside a cluster of equal eigenvalues only symmetric functions of them (their sum) have a
    derivative; the individual ones are then those of an arbitrary basis of the eigenspace.

    Args:
        problem: the eigenproblem of size n.
        k: number of pairs, 1 ≤ k ≤ n.
        solver: `DenseEigh()`, `ScipyEigsh()`; by default by size.
        guess: approximate eigenvectors to start from.
        throw: raise if the solve fails; otherwise look at `solution.result`.

    Raises:
        ValueError: k is not an integer in 1…n; a guess of the wrong shape.
        equinox.EquinoxRuntimeError: the solve failed and `throw`; the message says why and what to do.
    """
    check_count(k, problem.size)
    if guess is not None and (guess.ndim != 2 or guess.shape[0] != problem.size):
        raise ValueError(f"guess must have shape [{problem.size}, any], got {list(guess.shape)}")
    if solver is None:
        solver = DenseEigh() if problem.size <= max(_DENSE_IS_FASTER, k) else ScipyEigsh()

    held = jax.lax.stop_gradient(GeneralizedEigenproblem(assembled(problem.A), assembled(problem.B)))
    solution = solver.compute(held, k, None if guess is None else jax.lax.stop_gradient(guess))
    if throw:
        solution = solution.result.error_if(solution, solution.result != RESULTS.successful)
    vectors = jax.lax.stop_gradient(solution.eigenvectors)
    values = _hellmann_feynman(problem, jax.lax.stop_gradient(solution.eigenvalues), vectors)
    return eqx.tree_at(lambda s: (s.eigenvalues, s.eigenvectors), solution, (values, vectors))


def check_count(k: int, size: int) -> None:
    """Whether a problem of this size has k eigenpairs.

    Raises:
        ValueError: k is not an integer in 1…size.
    """
    if isinstance(k, bool) or not isinstance(k, int) or not 1 <= k <= size:
        raise ValueError(f"k must be an integer between 1 and the number of unknowns {size}, got {k!r}")


@eqx.filter_custom_jvp
def _hellmann_feynman(
    problem: GeneralizedEigenproblem, eigenvalues: Float[Array, " k"], eigenvectors: Float[Array, "n k"]
) -> Float[Array, " k"]:
    """The eigenvalues themselves, with the derivative that they have as functions of the problem."""
    return eigenvalues


@_hellmann_feynman.def_jvp
def _(primals, tangents):
    problem, eigenvalues, x = primals
    d_problem, _, _ = tangents

    def products(problem: GeneralizedEigenproblem) -> tuple[Array, Array]:
        return matmat(problem.A, x), matmat(problem.B, x)

    _, (dA_x, dB_x) = eqx.filter_jvp(products, (problem,), (d_problem,))
    derivative = jnp.zeros_like(eigenvalues)
    if dA_x is not None:  # None: does not depend on what is differentiated
        derivative = derivative + (x * dA_x).sum(axis=0)
    if dB_x is not None:
        derivative = derivative - eigenvalues * (x * dB_x).sum(axis=0)
    return eigenvalues, derivative


def cluster_labels(
    eigenvalues: Float[Array, " k"], *, rtol: float = 1e-2, atol: float | Float[Array, ""] = 0.0
) -> Array:
    """Number of the cluster each of the ascending eigenvalues belongs to, from 0.

    Neighbours belong together while their gap is at most `atol + rtol · |λ|` of the larger in absolute value.
    """
    larger = jnp.maximum(jnp.abs(eigenvalues[1:]), jnp.abs(eigenvalues[:-1]))
    apart = jnp.diff(eigenvalues) > atol + rtol * larger
    return jnp.concatenate([jnp.zeros(1, jnp.int32), jnp.cumsum(apart, dtype=jnp.int32)])


def cluster_sums(eigenvalues: Float[Array, " k"], labels: Array) -> Float[Array, " k"]:
    """For each eigenvalue the sum over its cluster: differentiable where single members of a cluster are not."""
    together = (labels[:, None] == labels[None, :]).astype(eigenvalues.dtype)
    return together @ eigenvalues
