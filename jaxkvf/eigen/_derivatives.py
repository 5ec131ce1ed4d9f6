"""How eigenpairs change with the problem: rules that may be differentiated again.

Two functions of the problem carry the derivatives: Λ = XᵀAX, block-diagonal in the clusters of equal eigenvalues, and the
basis X of their eigenspaces. Both are held at what a solver found, and change by

    dΛ = XᵀdA X − ½ (SΛ + ΛS)  inside each cluster,  S = XᵀdB X,                            (Hellmann–Feynman)
    dX = XY + Z,  Y = −½ S inside a cluster and ΛY − YΛ = −Xᵀ(dA X − dB X Λ) between clusters,
    (A − λᵢB) zᵢ = −Pᵀ(dA xᵢ − λᵢ dB xᵢ)  away from all of X.

In a cluster this is the derivative in which the basis does not turn inside its space: functions of Λ and X that do not
depend on the choice of basis (the trace of a block, the projector) are then differentiated rightly, to every order. The
rules are written with Λ and X of the same functions, so JAX differentiates them again.

References: R. Nelson, Simplified Calculation of Eigenvector Derivatives (1976); A. Andrew, R. Tan, Computation of
Derivatives of Repeated Eigenvalues and the Corresponding Eigenvectors of Symmetric Matrix Pencils (1998).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..sparse import matmat
from ._clusters import cluster_labels
from ._constraints import basis_of_constraints, restricted
from ._deflated import Solved, deflated_solve
from ._problem import GeneralizedEigenproblem
from ._solution import RESULTS, EigenSolution
from ._solver import AbstractEigensolver


class Eigenspaces(eqx.Module):
    """What a solver found, held fixed: eigenpairs, the clusters they fall into, and how they were found."""

    values: Float[Array, " k"]
    vectors: Float[Array, "n k"]
    labels: Int[Array, " k"]
    """Of the clusters."""
    cut: Bool[Array, " k"]
    """Members of the last cluster, where it goes on beyond the k found."""
    solved: Solved

    @classmethod
    def of(
        cls,
        problem: GeneralizedEigenproblem,
        found: EigenSolution,
        k: int,
        solver: AbstractEigensolver,
        state: PyTree,
    ) -> "Eigenspaces":
        """The first k pairs; one more, where there is one, tells whether the last cluster ends there.

        Eigenvalues count as equal where their gap is below √ε of their size, or near what rounding leaves of zero: single
        derivatives of second order would have no digits left. Where the solve has failed nothing counts as equal.
        """
        values, vectors = found.eigenvalues, found.eigenvectors
        eps = float(jnp.finfo(values.dtype).eps)
        typical = _mean_eigenvalue(problem)
        labels = cluster_labels(values, rtol=64 * eps**0.5, atol=100 * eps * typical)
        known = jnp.isfinite(values).all()
        labels = jnp.where(known, labels, jnp.arange(len(values), dtype=labels.dtype))
        goes_on = labels[k:].max() if len(values) > k else -1
        cut = labels[:k] == goes_on
        constraints = (
            None if solver.constraints is None else basis_of_constraints(problem, solver.constraints)
        )
        solved = Solved(
            problem=problem,
            solver=solver,
            state=state,
            constraints=constraints,
            level=2 * jnp.abs(values).max() + typical,
            successful=found.result == RESULTS.successful,
        )
        return cls(values[:k], vectors[:, :k], labels[:k], cut, solved)

    def unconstrained(self, problem: GeneralizedEigenproblem) -> GeneralizedEigenproblem:
        """The problem, with the solver's constraints in the operator."""
        constraints = self.solved.constraints
        return problem if constraints is None else restricted(problem, constraints, self.solved.level)

    @property
    def same(self) -> Bool[Array, "k k"]:
        """Whether two eigenvalues are in one cluster."""
        return self.labels[:, None] == self.labels[None, :]


def _mean_eigenvalue(problem: GeneralizedEigenproblem) -> Float[Array, ""]:
    """Size of a typical eigenvalue: the Rayleigh quotient of a vector of signs without pattern."""
    golden = 0.6180339887498949 * np.arange(problem.size)
    signs = jnp.asarray(np.where(golden % 1 < 0.5, -1, 1)[:, None], problem.dtype)
    A_signs, B_signs = matmat(problem.A, signs), matmat(problem.B, signs)
    return jnp.abs((signs * A_signs).sum() / (signs * B_signs).sum())


@eqx.filter_custom_jvp
def energies(problem: GeneralizedEigenproblem, found: Eigenspaces) -> Float[Array, "k k"]:
    """Λ = XᵀAX, its derivative confined to the clusters."""
    return jnp.diag(found.values)


@energies.def_jvp
def _(primals, tangents):
    problem, found = primals
    X, same = basis(problem, found), found.same
    dA_X, dB_X = _changed_products(problem, tangents[0], X)
    Lambda = energies(problem, found)
    S = X.T @ dB_X
    S_Lambda = S @ Lambda
    return Lambda, jnp.where(same, X.T @ dA_X - 0.5 * (S_Lambda + S_Lambda.T), 0)


@eqx.filter_custom_jvp
def basis(problem: GeneralizedEigenproblem, found: Eigenspaces) -> Float[Array, "n k"]:
    """X, B-orthonormal eigenvectors; in a cluster, a basis that does not turn inside its space as the problem changes."""
    return found.vectors


@basis.def_jvp
def _(primals, tangents):
    problem, found = primals
    X, Lambda, same = basis(problem, found), energies(problem, found), found.same
    complete = jnp.where(found.cut, 0, 1).astype(X.dtype)[None, :]
    dA_X, dB_X = _changed_products(problem, tangents[0], X)
    F = (dA_X - dB_X @ Lambda) * complete
    S = X.T @ dB_X
    Y = jnp.where(same, -0.5 * S, _between_clusters(found, Lambda, -(X.T @ F)))
    away_from = X * complete
    Y = Y * complete * complete.T
    outside = F - matmat(problem.B, away_from) @ (away_from.T @ F)
    return X, X @ Y - deflated_solve(problem, away_from, Lambda, outside, found.solved)


def _changed_products(
    problem: GeneralizedEigenproblem, d_problem: GeneralizedEigenproblem, X: Float[Array, "n k"]
) -> tuple[Float[Array, "n k"], Float[Array, "n k"]]:
    """dA X and dB X."""

    def products(problem: GeneralizedEigenproblem) -> tuple[Array, Array]:
        return matmat(problem.A, X), matmat(problem.B, X)

    _, changes = eqx.filter_jvp(products, (problem,), (d_problem,))
    # None: does not depend on what is differentiated
    dA_X, dB_X = (jnp.zeros_like(X) if change is None else change for change in changes)
    return dA_X, dB_X


def _between_clusters(
    found: Eigenspaces, Lambda: Float[Array, "k k"], right: Float[Array, "k k"]
) -> Float[Array, "k k"]:
    """Y with ΛY − YΛ = right between clusters and 0 inside."""
    apart = ~found.same
    gaps = jnp.where(apart, found.values[:, None] - found.values[None, :], 1)

    def product(Y: Float[Array, "k k"]) -> Float[Array, "k k"]:
        return jnp.where(apart, Lambda @ Y - Y @ Lambda, Y)

    return jax.lax.custom_linear_solve(
        product, jnp.where(apart, right, 0), lambda _, M: M / gaps, symmetric=True
    )
