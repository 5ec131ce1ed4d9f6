"""SciPy's ARPACK in shift-invert mode: the fallback, and the yardstick."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import scipy.sparse as sp
from jax.core import Tracer
from jaxtyping import Array, DTypeLike, Float, UInt32

from ..sparse import to_scipy
from ._factorization import AbstractFactorization, default_factorization
from ._kept_factors import NAME_WORDS, Factor, keep_for_a_while, keep_while_alive, kept, name_of
from ._problem import GeneralizedEigenproblem
from ._residual import NEGATIVE, ROUNDINGS, check_tolerances
from ._shift_invert import deflated_solution, lowest_pairs, shifted_factor, spectral_norm
from ._solution import RESULTS, EigenSolution
from ._solver import AbstractEigensolver
from ._threads import one_blas_thread


class ScipyEigsh(AbstractEigensolver):
    """Lanczos on (A + sB)⁻¹B with a direct factorization, on the host; callable inside `jit` (through a callback).

    The shift s is placed below the spectrum and moved further down until A + sB is positive definite, so that the pairs
    nearest to −s are the smallest ones and none is missed. Under `vmap` the problems are solved one after another.

    Derivatives of eigenvectors use the factorization again. Outside of `jit` it lives as long as the derivative that may ask
    for it; compiled programs cannot tell, and leave the latest behind on the host, of 100,000 unknowns together at most.
    """

    factorization: AbstractFactorization = eqx.field(default_factory=default_factorization)
    rtol: float = eqx.field(default=1e-12, static=True)
    """Relative to ‖A‖₂, as for `LOBPCG`: converged where ‖A x − λ B x‖₂ ≤ (rtol ‖A‖₂ + atol) ‖x‖₂.

    Less than 16 rounding units of float64, in which all is computed, counts as that.
    """
    atol: float = eqx.field(default=0.0, static=True)
    max_steps: int = eqx.field(default=300, static=True)
    """Restarts of ARPACK, and steps of the block iteration where it needs help."""
    seed: int = eqx.field(default=0, static=True)
    """Of the random starting vector where there is no guess."""

    def __check_init__(self) -> None:
        check_tolerances(self.rtol, self.atol, self.max_steps)

    @property
    def constraints(self) -> None:
        """None: `LOBPCG` takes constraints."""

    def compute(
        self, problem: GeneralizedEigenproblem, k: int, guess: Float[Array, "n g"] | None
    ) -> tuple[EigenSolution, UInt32[Array, "4"]]:
        arrays, structure = eqx.partition((problem, guess), eqx.is_array)

        def on_host(arrays: Any) -> tuple[_Found, Factor | None]:
            problem, guess = eqx.combine(arrays, structure)
            return self._solve(problem, guess, k)

        def called_back(arrays: Any) -> _Found:
            found, factor = on_host(arrays)
            if factor is not None:
                keep_for_a_while(np.asarray(found.name), factor)
            return found

        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arrays)):
            shapes = jax.tree.map(
                lambda a: jax.ShapeDtypeStruct(a.shape, a.dtype), _Found.empty(problem.size, k, problem.dtype)
            )
            found = jax.pure_callback(called_back, shapes, arrays, vmap_method="sequential")
            name = found.name
        else:  # called outside of jit: no need to compile a callback, and errors arrive undisguised
            found, factor = on_host(arrays)
            name = (
                jnp.asarray(found.name)
                if factor is None
                else keep_while_alive(np.asarray(found.name), factor)
            )
            found = jax.tree.map(jnp.asarray, found._replace(name=()))
        result = RESULTS.successful
        for number, failure in enumerate(_FAILURES, start=1):
            result = RESULTS.where(found.outcome == number, failure, result)
        stats = {"solves": found.solves, "factorizations": found.factorizations}
        solution = EigenSolution(found.eigenvalues, found.eigenvectors, found.residuals, result, dict(stats))
        return solution, name

    def _solve(
        self, problem: GeneralizedEigenproblem, guess: Array | None, k: int
    ) -> tuple["_Found", Factor | None]:
        A, B = _matrices(problem)
        n, dtype = problem.size, np.dtype(problem.dtype)
        if not (np.isfinite(A.data).all() and np.isfinite(B.data).all()):
            return _Found.empty(n, k, dtype, _number(RESULTS.nonfinite_input)), None
        with one_blas_thread():
            factor = shifted_factor(A, B, self.factorization)
            if factor is None:
                return _Found.empty(n, k, dtype, _number(RESULTS.indefinite_mass)), None
            norm, eps = spectral_norm(A), float(np.finfo(np.float64).eps)
            atol = self.atol / norm if norm > 0 else self.atol
            found = lowest_pairs(
                A,
                B,
                k,
                factor,
                guess=None if guess is None else np.asarray(guess),
                tolerance=max(self.rtol, ROUNDINGS * eps) + atol,
                max_steps=self.max_steps,
                seed=self.seed,
                norm=norm,
            )
        outcome = 0 if found.converged else _number(RESULTS.max_steps_reached)
        noise = NEGATIVE * np.finfo(dtype).eps * norm * (found.vectors**2).sum(axis=0)
        if lx.is_positive_semidefinite(problem.A) and (found.values < -noise).any():
            outcome = _number(RESULTS.negative_energy)
        return _Found(
            found.values.astype(dtype),
            found.vectors.astype(dtype),
            found.residuals.astype(dtype),
            np.asarray(outcome, np.int32),
            np.asarray(found.solves, np.int32),
            np.asarray(factor.tried, np.int32),
            name_of(A, B, repr(self.factorization)),
        ), factor

    def deflated_solve(
        self,
        state: UInt32[Array, "4"],
        problem: GeneralizedEigenproblem,
        X: Float[Array, "n m"],
        values: Float[Array, " k"],
        right: Float[Array, "n k"],
    ) -> Float[Array, "n k"]:
        """SciPy's conjugate gradients on the host, preconditioned by the factorization of A + sB."""
        arrays, structure = eqx.partition((state, problem, X, values, right), eqx.is_array)

        def on_host(arrays: Any) -> np.ndarray:
            name, problem, *others = eqx.combine(arrays, structure)
            A, B = _matrices(problem)
            with one_blas_thread():
                factor = kept(np.asarray(name)) or shifted_factor(A, B, self.factorization)
                if factor is None:  # where no eigensolve can have succeeded
                    return np.full(right.shape, np.nan, right.dtype)
                X, values, F = (np.asarray(array, np.float64) for array in others)
                return deflated_solution(A, B, factor, (X, values, F)).astype(problem.dtype)

        return jax.pure_callback(
            on_host, jax.ShapeDtypeStruct(right.shape, right.dtype), arrays, vmap_method="sequential"
        )


_FAILURES = (
    RESULTS.max_steps_reached,
    RESULTS.nonfinite_input,
    RESULTS.indefinite_mass,
    RESULTS.negative_energy,
)


def _number(result: RESULTS) -> int:
    """A failure as a number, since enumerations do not cross callbacks."""
    return 1 + _FAILURES.index(result)


def _matrices(problem: GeneralizedEigenproblem) -> tuple[sp.csc_array, sp.csc_array]:
    A, B = (sp.csc_array(to_scipy(operator), dtype=np.float64) for operator in (problem.A, problem.B))
    return A, B


class _Found(NamedTuple):
    """What crosses the callback."""

    eigenvalues: Array | np.ndarray
    eigenvectors: Array | np.ndarray
    residuals: Array | np.ndarray
    outcome: Array | np.ndarray
    """0 for success, i for `_FAILURES[i − 1]`."""
    solves: Array | np.ndarray
    factorizations: Array | np.ndarray
    name: Array | np.ndarray | tuple[()]
    """Of the factorization."""

    @classmethod
    def empty(cls, n: int, k: int, dtype: DTypeLike, outcome: int = 0) -> "_Found":
        """Nothing found."""
        zero, nothing = np.zeros((), np.int32), np.full(k, np.nan, dtype)
        failure, name = zero + np.asarray(outcome, np.int32), np.zeros(NAME_WORDS, np.uint32)
        return cls(nothing, np.full((n, k), np.nan, dtype), nothing, failure, zero, zero, name)
