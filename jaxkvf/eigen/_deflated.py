"""(A − λᵢB) zᵢ = fᵢ away from known eigenvectors: the linear solve in the derivative of eigenvectors."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float
from scipy.sparse.linalg import LinearOperator, cg

from ..sparse import assembled, cheap_diagonal, matmat, to_scipy
from ._dense import DenseEigh
from ._fallback import WithFallback
from ._lobpcg import LOBPCG
from ._problem import GeneralizedEigenproblem
from ._scipy import ScipyEigsh, _shifted_inverse
from ._solver import AbstractEigensolver

_MOST_STEPS = 2000
_ACCEPTED = 1e-6  # residual relative to the right-hand side, in float64


def deflated_solve(
    problem: GeneralizedEigenproblem,
    X: Float[Array, "n k"],
    energies: Float[Array, "k k"],
    right: Float[Array, "n k"],
    solver: AbstractEigensolver,
) -> Float[Array, "n k"]:
    """Z with Pᵀ(A P Z − B P Z Λ) + BX XᵀB Z = F, P = 1 − X XᵀB the B-orthogonal projection off the columns of X.

    For F orthogonal to X this is (A − λᵢB) zᵢ = fᵢ with Z B-orthogonal to X. Positive definite where X holds all
    eigenvectors up to the largest of the λᵢ. Differentiable in everything but the solver, to any order.

    Args:
        problem: A and B.
        X: B-orthonormal eigenvectors to stay away from; columns of zeros do nothing.
        energies: Λ, diagonal in value (its derivative need not be).
        right: F.
        solver: of the eigenproblem, whose preconditioner or factorization serves here too.
    """

    def product(Z: Float[Array, "n k"]) -> Float[Array, "n k"]:
        return deflated_product(problem, X, energies, Z)

    held = jax.lax.stop_gradient(GeneralizedEigenproblem(assembled(problem.A), assembled(problem.B)))
    X_held, values = jax.lax.stop_gradient((X, energies.diagonal()))

    def solve(_: object, F: Float[Array, "n k"]) -> Float[Array, "n k"]:
        return _checked_solve(solver, held, X_held, values, F)

    return jax.lax.custom_linear_solve(product, right, solve, symmetric=True)


def deflated_product(
    problem: GeneralizedEigenproblem,
    X: Float[Array, "n k"],
    energies: Float[Array, "k k"],
    Z: Float[Array, "n k"],
) -> Float[Array, "n k"]:
    """The left-hand side of `deflated_solve`."""
    along = X.T @ matmat(problem.B, Z)
    PZ = Z - X @ along
    Y = matmat(problem.A, PZ) - matmat(problem.B, PZ) @ energies
    BX = matmat(problem.B, X)
    return Y - BX @ (X.T @ Y) + BX @ along


@eqx.filter_jit
def _checked_solve(
    solver: AbstractEigensolver,
    problem: GeneralizedEigenproblem,
    X: Float[Array, "n k"],
    values: Float[Array, " k"],
    F: Float[Array, "n k"],
) -> Float[Array, "n k"]:
    Z = _solve(solver, problem, X, values, F)
    residual = deflated_product(problem, X, jnp.diag(values), Z) - F
    accepted = max(_ACCEPTED, jnp.finfo(F.dtype).eps ** 0.5 * 10)
    failed = ~(jnp.linalg.norm(residual) <= accepted * jnp.linalg.norm(F))
    return eqx.error_if(
        Z,
        failed,
        "The linear solve for the derivative of eigenvectors did not converge. An eigenvalue beyond those asked for may be "
        "too near: ask for more eigenpairs, or pass a solver with a better preconditioner (`multigrid_solver`, ScipyEigsh).",
    )


@functools.singledispatch
def _solve(
    solver: AbstractEigensolver,
    problem: GeneralizedEigenproblem,
    X: Float[Array, "n k"],
    values: Float[Array, " k"],
    F: Float[Array, "n k"],
) -> Float[Array, "n k"]:
    """Conjugate gradients, preconditioned as the eigensolver is; by the diagonal of A where it is not."""
    preconditioner = solver.preconditioner if isinstance(solver, LOBPCG) else None
    inverse = None if preconditioner is None else preconditioner.prepare(problem)
    diagonal = cheap_diagonal(problem.A)
    BX = matmat(problem.B, X)

    def approximate_inverse(R: Float[Array, "n k"]) -> Float[Array, "n k"]:
        if inverse is not None:
            return inverse.apply(R)
        if diagonal is None:
            return R
        return R / jnp.where(diagonal > 0, diagonal, jnp.abs(diagonal).mean())[:, None]

    def precondition(R: Float[Array, "n k"]) -> Float[Array, "n k"]:
        Z = approximate_inverse(R - BX @ (X.T @ R))
        return Z - X @ (BX.T @ Z) + X @ (X.T @ R)

    tolerance = 1e-4 * max(_ACCEPTED, float(jnp.finfo(F.dtype).eps ** 0.5) * 10)
    Z, _ = jax.scipy.sparse.linalg.cg(
        lambda Z: deflated_product(problem, X, jnp.diag(values), Z),
        F,
        tol=tolerance,
        maxiter=_MOST_STEPS,
        M=precondition,
    )
    return Z


@_solve.register
def _(solver: WithFallback, problem, X, values, F):
    return _solve(solver.first, problem, X, values, F)


@_solve.register
def _(solver: DenseEigh, problem, X, values, F):
    """Directly, one column after another."""
    n = problem.size
    A, B = problem.A.as_matrix(), problem.B.as_matrix()
    BX = B @ X
    P = jnp.eye(n, dtype=X.dtype) - X @ BX.T

    def column(of: tuple[Array, Array]) -> Float[Array, " n"]:
        value, f = of
        return jnp.linalg.solve(P.T @ (A - value * B) @ P + BX @ BX.T, f)

    return jax.lax.map(column, (values, F.T)).T


@_solve.register
def _(solver: ScipyEigsh, problem, X, values, F):
    """SciPy's conjugate gradients on the host, preconditioned by the factorization of A + sB."""
    arrays, structure = eqx.partition((problem, X, values, F), eqx.is_array)

    def on_host(arrays: Any) -> np.ndarray:
        problem, X, values, F = eqx.combine(arrays, structure)
        A, B = (sp.csc_array(to_scipy(operator), dtype=np.float64) for operator in (problem.A, problem.B))
        X, values, F = (np.asarray(array, np.float64) for array in (X, values, F))
        Z, BX = np.full_like(F, np.nan), B @ X
        placed = _shifted_inverse(A, B, solver.factorization)
        if placed is None:  # where no eigensolve can have succeeded
            return Z.astype(problem.dtype)
        _, inverse, _ = placed

        def precondition(r: np.ndarray) -> np.ndarray:
            z = inverse(r - BX @ (X.T @ r))
            return z - X @ (BX.T @ z) + X @ (X.T @ r)

        M = LinearOperator(A.shape, matvec=precondition, dtype=np.float64)  # pyright: ignore[reportCallIssue]
        for i, value in enumerate(values):

            def product(z: np.ndarray, value: float = value) -> np.ndarray:
                along = BX.T @ z
                y = z - X @ along
                y = A @ y - value * (B @ y)
                return y - BX @ (X.T @ y) + BX @ along

            K = LinearOperator(A.shape, matvec=product, dtype=np.float64)  # pyright: ignore[reportCallIssue]
            Z[:, i], _ = cg(K, F[:, i], rtol=1e-11, maxiter=_MOST_STEPS, M=M)
        return Z.astype(problem.dtype)

    return jax.pure_callback(
        on_host, jax.ShapeDtypeStruct(F.shape, F.dtype), arrays, vmap_method="sequential"
    )
