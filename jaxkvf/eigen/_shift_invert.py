"""Lanczos on (A + sB)⁻¹B, and what it needs, in NumPy and SciPy."""

from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackError, ArpackNoConvergence, LinearOperator, cg, eigsh

from ._conjugate_gradients import MOST_STEPS
from ._factorization import AbstractFactorization
from ._kept_factors import Factor

_MOST_SHIFTS = 24
_RESTARTS = 30  # of ARPACK, which needs a few; where it needs more, the kernel is wider than its basis
_GUARDS = 8


class Pairs(NamedTuple):
    values: np.ndarray
    vectors: np.ndarray
    residuals: np.ndarray
    converged: bool
    solves: int


def lowest_pairs(
    A: sp.csc_array,
    B: sp.csc_array,
    k: int,
    factor: Factor,
    *,
    guess: np.ndarray | None,
    tolerance: float,
    max_steps: int,
    seed: int,
    norm: float,
) -> Pairs:
    """The k pairs of smallest λ, to residuals relative to ‖A‖ of at most `tolerance`.

    By ARPACK; where it does not get there, for multiple eigenvalues wider than its basis or rounding, by iterations of a
    block, for which neither is hard.
    """
    n, solves = len(A.diagonal()), 0

    def solve(x: np.ndarray) -> np.ndarray:
        nonlocal solves
        solves += 1
        return factor.solve(x)

    def measured(values: np.ndarray, vectors: np.ndarray) -> Pairs:
        order = np.argsort(values)[:k]
        values, vectors = values[order], vectors[:, order]
        errors = np.linalg.norm(A @ vectors - (B @ vectors) * values, axis=0)
        residuals = errors / ((norm or 1.0) * np.linalg.norm(vectors, axis=0))
        return Pairs(values, vectors, residuals, bool((residuals <= tolerance).all()), solves)

    if k >= n - 1:  # no room for Lanczos
        return measured(*scipy.linalg.eigh(A.toarray(), B.toarray()))
    random = np.random.default_rng(seed)
    start = random.standard_normal(n)
    near = None if guess is None else _combined(guess, random)
    if near is not None:  # never alone: Lanczos breaks down on an exactly invariant subspace
        start = near + 1e-6 * np.linalg.norm(near) / np.sqrt(n) * start
    inverse = LinearOperator((n, n), matvec=solve, dtype=np.float64)  # pyright: ignore[reportCallIssue]
    try:
        values, X = eigsh(
            A,
            k,
            M=B,
            sigma=-factor.shift,
            which="LM",
            v0=start,
            tol=0.1 * tolerance,  # pyright: ignore[reportArgumentType]
            maxiter=max(1, min(_RESTARTS, max_steps)),
            OPinv=inverse,
        )
        found = measured(values, X)
    except ArpackNoConvergence as stopped:
        X = stopped.eigenvectors
        found = measured(np.full(k, np.nan), np.full((n, k), np.nan))
    except ArpackError:  # breakdowns on starting vectors without a part in what is sought
        X = np.zeros((n, 0))
        found = measured(np.full(k, np.nan), np.full((n, k), np.nan))

    X = np.concatenate([X, random.standard_normal((n, min(k + _GUARDS, n) - X.shape[1]))], axis=1)
    for _ in range(max_steps - _RESTARTS):
        if found.converged:
            break
        X = np.stack([solve(x) for x in (B @ X).T], axis=1)
        X, _ = np.linalg.qr(X)
        values, C = scipy.linalg.eigh(X.T @ (A @ X), X.T @ (B @ X))
        X = X @ C
        found = measured(values, X)
    return found


def _combined(guess: np.ndarray, random: np.random.Generator) -> np.ndarray | None:
    """One vector with a part in each column of the guess."""
    guess = np.asarray(guess, np.float64)
    sizes = np.abs(guess).max(axis=0)
    usable = guess[:, np.isfinite(sizes) & (sizes > 0)]
    usable = usable / np.abs(usable).max(axis=0)
    near = usable @ random.uniform(0.5, 1.5, usable.shape[1])
    return near if np.linalg.norm(near) > 0 else None


def spectral_norm(A: sp.csc_array) -> float:
    """‖A‖₂ of a symmetric matrix, from below and within a few per cent."""
    if not A.data.any():
        return 0.0
    n = len(A.diagonal())
    if n < 3:
        return float(np.linalg.norm(A.toarray(), 2))
    start = np.random.default_rng(0).standard_normal(n)
    found = eigsh(A, 1, v0=start, tol=0.01, return_eigenvectors=False)  # pyright: ignore[reportArgumentType]
    return float(np.abs(found).max())


def shifted_factor(A: sp.csc_array, B: sp.csc_array, factorization: AbstractFactorization) -> Factor | None:
    """A + sB in factors, with a shift s > 0 that makes it positive definite.

    The first is the typical spacing of the spectrum, (median of A_ii / B_ii) / n: far below it the factorization loses
    digits to a near-kernel, far above it Lanczos is slow. None where B is not positive definite.
    """
    if not (B.diagonal() > 0).all():
        return None
    n = len(A.diagonal())
    shift = float(np.median(np.abs(A.diagonal()) / B.diagonal())) / n
    shift = shift if shift > 0 else 1.0
    for tried in range(1, _MOST_SHIFTS + 1):
        solve = factorization.factorize(sp.csc_array(A + shift * B))
        if solve is not None:
            return Factor(shift, solve, tried, n)
        shift *= 8.0
    return None


def deflated_solution(
    A: sp.csc_array, B: sp.csc_array, factor: Factor, of: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> np.ndarray:
    """That of `AbstractEigensolver.deflated_solve` of X, values and right side: conjugate gradients with the factors."""
    X, values, F = of
    Z, BX = np.full_like(F, np.nan), B @ X

    def precondition(r: np.ndarray) -> np.ndarray:
        z = factor.solve(r - BX @ (X.T @ r))
        return z - X @ (BX.T @ z) + X @ (X.T @ r)

    M = LinearOperator(A.shape, matvec=precondition, dtype=np.float64)  # pyright: ignore[reportCallIssue]
    for i, value in enumerate(values):

        def product(z: np.ndarray, value: float = value) -> np.ndarray:
            along = BX.T @ z
            y = z - X @ along
            y = A @ y - value * (B @ y)
            return y - BX @ (X.T @ y) + BX @ along

        K = LinearOperator(A.shape, matvec=product, dtype=np.float64)  # pyright: ignore[reportCallIssue]
        Z[:, i], _ = cg(K, F[:, i], rtol=1e-11, maxiter=MOST_STEPS, M=M)
    return Z
