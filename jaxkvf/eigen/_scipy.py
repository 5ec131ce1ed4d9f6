"""SciPy's ARPACK in shift-invert mode: the fallback, and the yardstick."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax.core import Tracer
from jaxtyping import Array, DTypeLike, Float
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh
from threadpoolctl import threadpool_limits

from ..sparse import to_scipy
from ._factorization import AbstractFactorization, Solve, default_factorization
from ._problem import GeneralizedEigenproblem
from ._solution import RESULTS, EigenSolution
from ._solver import AbstractEigensolver


class ScipyEigsh(AbstractEigensolver):
    """Lanczos on (A + sB)⁻¹B with a direct factorization, on the host; callable inside `jit` (through a callback).

    The shift s is placed below the spectrum and moved further down until A + sB is positive definite, so that the pairs
    nearest to −s are the smallest ones and none is missed. Under `vmap` the problems are solved one after another.
    """

    factorization: AbstractFactorization = eqx.field(default_factory=default_factorization)
    rtol: float = eqx.field(default=1e-12, static=True)
    """Relative to ‖A‖₂, as for LOBPCG: converged where ‖A x − λ B x‖₂ ≤ (rtol ‖A‖₂ + atol) ‖x‖₂."""
    atol: float = eqx.field(default=0.0, static=True)
    max_steps: int = eqx.field(default=300, static=True)
    """Restarts of ARPACK."""
    seed: int = eqx.field(default=0, static=True)
    """Of the random starting vector where there is no guess."""

    def compute(
        self, problem: GeneralizedEigenproblem, k: int, guess: Float[Array, "n g"] | None
    ) -> EigenSolution:
        if k >= problem.size:
            raise ValueError(
                f"ScipyEigsh finds at most n − 1 = {problem.size - 1} pairs, got k = {k}; use DenseEigh"
            )
        arrays, structure = eqx.partition((problem, guess), eqx.is_array)

        def on_host(arrays: Any) -> _Found:
            problem, guess = eqx.combine(arrays, structure)
            return self._solve(problem, guess, k)

        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arrays)):
            shapes = jax.tree.map(
                lambda a: jax.ShapeDtypeStruct(a.shape, a.dtype), _Found.empty(problem.size, k, problem.dtype)
            )
            found = jax.pure_callback(on_host, shapes, arrays, vmap_method="sequential")
        else:  # called outside of jit: no need to compile a callback, and errors arrive undisguised
            found = jax.tree.map(jnp.asarray, on_host(arrays))
        result = RESULTS.successful
        for number, failure in enumerate(_FAILURES, start=1):
            result = RESULTS.where(found.outcome == number, failure, result)
        stats = {"solves": found.solves, "factorizations": found.factorizations}
        return EigenSolution(found.eigenvalues, found.eigenvectors, found.residuals, result, stats)

    def _solve(self, problem: GeneralizedEigenproblem, guess: Array | None, k: int) -> "_Found":
        A, B = (sp.csc_array(to_scipy(operator), dtype=np.float64) for operator in (problem.A, problem.B))
        n, dtype = problem.size, np.dtype(problem.dtype)
        if not (np.isfinite(A.data).all() and np.isfinite(B.data).all()):
            return _Found.empty(n, k, dtype, _number(RESULTS.nonfinite_input))
        with threadpool_limits(
            1, user_api="blas"
        ):  # ARPACK's products are small: threads only get in the way
            placed = _shifted_inverse(A, B, self.factorization)
            if placed is None:
                return _Found.empty(n, k, dtype, _number(RESULTS.indefinite_mass))
            shift, solve, factorizations = placed
            solves = 0

            def counted_solve(x: np.ndarray) -> np.ndarray:
                nonlocal solves
                solves += 1
                return solve(x)

            random = np.random.default_rng(self.seed).standard_normal(n)
            start = random
            if guess is not None:  # never alone: Lanczos breaks down on an exactly invariant subspace
                near = np.asarray(guess, np.float64).sum(axis=1)
                start = near + 1e-6 * np.linalg.norm(near) / np.sqrt(n) * random
            inverse = LinearOperator((n, n), matvec=counted_solve, dtype=np.float64)  # pyright: ignore[reportCallIssue]
            outcome = 0
            try:
                values, vectors = eigsh(
                    A,
                    k,
                    M=B,
                    sigma=-shift,
                    which="LM",
                    v0=start,
                    tol=0.1 * self.rtol,  # pyright: ignore[reportArgumentType]
                    maxiter=self.max_steps,
                    OPinv=inverse,
                )
            except ArpackNoConvergence as stopped:
                outcome = _number(RESULTS.max_steps_reached)
                values = np.full(k, np.nan)
                vectors = np.full((n, k), np.nan)
                count = len(stopped.eigenvalues)
                values[:count], vectors[:, :count] = stopped.eigenvalues, stopped.eigenvectors
        order = np.argsort(values)
        values, vectors = values[order], vectors[:, order]
        norm = _spectral_norm(A)
        residuals = np.linalg.norm(A @ vectors - (B @ vectors) * values, axis=0)
        residuals /= norm * np.linalg.norm(vectors, axis=0)
        return _Found(
            values.astype(dtype),
            vectors.astype(dtype),
            residuals.astype(dtype),
            np.asarray(outcome, np.int32),
            np.asarray(solves, np.int32),
            np.asarray(factorizations, np.int32),
        )


_FAILURES = (RESULTS.max_steps_reached, RESULTS.nonfinite_input, RESULTS.indefinite_mass)
_MOST_SHIFTS = 24


def _number(result: RESULTS) -> int:
    """A failure as a number, since enumerations do not cross callbacks."""
    return 1 + _FAILURES.index(result)


class _Found(NamedTuple):
    """What crosses the callback."""

    eigenvalues: Array | np.ndarray
    eigenvectors: Array | np.ndarray
    residuals: Array | np.ndarray
    outcome: Array | np.ndarray
    """0 for success, i for `_FAILURES[i − 1]`."""
    solves: Array | np.ndarray
    factorizations: Array | np.ndarray

    @classmethod
    def empty(cls, n: int, k: int, dtype: DTypeLike, outcome: int = 0) -> "_Found":
        """Nothing found."""
        zero = np.zeros((), np.int32)
        nothing = np.full(k, np.nan, dtype)
        return cls(
            nothing, np.full((n, k), np.nan, dtype), nothing, zero + np.asarray(outcome, np.int32), zero, zero
        )


def _spectral_norm(A: sp.csc_array) -> float:
    """‖A‖₂ of a symmetric matrix, from below and within a few per cent."""
    if not A.data.any():
        return 0.0
    start = np.random.default_rng(0).standard_normal(len(A.diagonal()))
    found = eigsh(A, 1, v0=start, tol=0.01, return_eigenvectors=False)  # pyright: ignore[reportArgumentType]
    return float(np.abs(found).max())


def _shifted_inverse(
    A: sp.csc_array, B: sp.csc_array, factorization: AbstractFactorization
) -> tuple[float, Solve, int] | None:
    """A shift s > 0 with A + sB positive definite, the solve with it, and how many shifts were tried.

    The first is the typical spacing of the spectrum, (median of A_ii / B_ii) / n: far below it the factorization loses
    digits to a near-kernel, far above it Lanczos is slow. None where B is not positive definite.
    """
    if not (B.diagonal() > 0).all():
        return None
    shift = float(np.median(np.abs(A.diagonal()) / B.diagonal())) / len(A.diagonal())
    shift = shift if shift > 0 else 1.0
    for tried in range(1, _MOST_SHIFTS + 1):
        solve = factorization.factorize(sp.csc_array(A + shift * B))
        if solve is not None:
            return shift, solve, tried
        shift *= 8.0
    return None
