"""LOBPCG: smallest eigenpairs by a block of preconditioned, locally optimal search directions.

Each step minimises the trace of A over the span of the approximations X, the preconditioned residuals W and the previous
search directions P, and is kept from breaking down where that basis is nearly dependent.

References: A. Knyazev, Toward the Optimal Preconditioned Eigensolver (2001); J. Duersch, M. Shao, C. Yang, M. Gu, A Robust
and Efficient Implementation of LOBPCG (2018).
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, DTypeLike, Float, Int

from ..sparse import BlockProduct, block_product, cheap_diagonal, spectral_norm
from ._conjugate_gradients import conjugate_gradients
from ._preconditioner import AbstractApproximateInverse, AbstractPreconditioner
from ._problem import GeneralizedEigenproblem
from ._residual import all_finite, check_tolerances, least_rtol, lost_positivity, relative_residuals
from ._solution import RESULTS, EigenSolution
from ._solver import AbstractEigensolver
from .subspace import (
    combined,
    conjugate_directions,
    inverse_roots,
    negative_energies,
    orthonormalised,
    ritz_pairs,
    rounding,
    scaled,
    whitening,
)

_REFRESH = 100  # steps between true products, which keep rounding from adding up
_PATIENCE = 50  # steps without progress
_FILLS = 3  # approximations that many times without full rank, random ones added each time: B is to blame


class LOBPCG(AbstractEigensolver):
    """Locally optimal block preconditioned conjugate gradients, for any symmetric A and positive definite B.

    Fully in JAX: runs under `jit` and `vmap` on any backend, at one product with A and two with B a step. How many steps it
    takes is up to the preconditioner: tens with one close to A⁻¹, thousands without. Converged when the first k pairs have
    ‖A x − λ B x‖₂ ≤ (rtol ‖A‖₂ + atol) ‖x‖₂; the error of eigenvalues goes with the square of that. For more than a third of
    all pairs, or a few hundred unknowns, `DenseEigh` is faster.
    """

    rtol: float = eqx.field(default=1e-8, static=True)
    """Relative to ‖A‖₂. Less than 16 rounding units (3.6e-15, or 1.9e-6 in float32) counts as that."""
    atol: float = eqx.field(default=0.0, static=True)
    max_steps: int = eqx.field(default=1000, static=True)
    guard_vectors: int | None = eqx.field(default=None, static=True)
    """Pairs carried beyond the k wanted, which they speed up and keep complete.

    By default 1 and a fifth of k, rounded up to a block of a whole four.
    """
    preconditioner: AbstractPreconditioner | None = None
    constraints: Float[Array, "n c"] | None = None  # pyright: ignore[reportIncompatibleMethodOverride]
    """Columns to stay B-orthogonal to, eigenvectors already known say; residuals are taken orthogonally to them."""
    seed: int = eqx.field(default=0, static=True)
    """Of the random starting vectors."""

    def __check_init__(self) -> None:
        check_tolerances(self.rtol, self.atol, self.max_steps)
        if self.guard_vectors is not None and self.guard_vectors < 0:
            raise ValueError(f"guard_vectors must not be negative, got {self.guard_vectors}")

    @eqx.filter_jit
    def compute(
        self, problem: GeneralizedEigenproblem, k: int, guess: Float[Array, "n g"] | None
    ) -> tuple[EigenSolution, AbstractApproximateInverse | None]:
        n, dtype = problem.size, problem.dtype
        block_size = self._block_size(n, k)
        A, B = block_product(problem.A), block_product(problem.B)
        norm = spectral_norm(A, n, dtype)
        eps = float(jnp.finfo(dtype).eps)
        rtol = least_rtol(self.rtol, dtype)
        inverse = None if self.preconditioner is None else self.preconditioner.prepare(problem)
        iteration = _Iteration(
            A=A,
            B=B,
            inverse=inverse,
            constraints=None if self.constraints is None else orthonormalised(B, self.constraints)[:2],
            tolerance=rtol * norm + self.atol,
            separation=min(max(100 * eps / rtol, eps**0.4), 0.5),
            key=jax.random.key(self.seed),
            k=k,
            max_steps=self.max_steps,
        )
        final = iteration.run(iteration.starting_vectors(n, block_size, guess, dtype))

        X, values = final.V[:, :k], final.values[:k]
        AX = final.AV[:, :k] if iteration.constraints is None else final.R[:, :k] + B(X) * values[None, :]
        residuals = relative_residuals(AX, B(X), X, values, norm)
        converged = final.errors[:k] <= iteration.tolerance

        finite = jnp.isfinite(values).all() & all_finite(problem)
        mass = cheap_diagonal(problem.B)
        indefinite = final.indefinite if mass is None else final.indefinite | (mass <= 0).any()
        result = RESULTS.where(final.steps >= self.max_steps, RESULTS.max_steps_reached, RESULTS.stagnated)
        result = RESULTS.where(converged.all(), RESULTS.successful, result)
        result = RESULTS.where(lost_positivity(problem, values, X, norm), RESULTS.negative_energy, result)
        result = RESULTS.where(indefinite, RESULTS.indefinite_mass, result)
        result = RESULTS.where(finite, result, RESULTS.nonfinite_input)
        stats = {"steps": final.steps, "products": final.products, "converged": converged.sum()}
        return EigenSolution(values, X, residuals, result, dict(stats)), inverse

    def deflated_solve(
        self,
        state: AbstractApproximateInverse | None,
        problem: GeneralizedEigenproblem,
        X: Float[Array, "n m"],
        values: Float[Array, " k"],
        right: Float[Array, "n k"],
    ) -> Float[Array, "n k"]:
        """Conjugate gradients, preconditioned as the eigensolver is; by the diagonal of A where it is not."""
        return conjugate_gradients(problem, X, values, right, state)

    def _block_size(self, n: int, k: int) -> int:
        constraints = 0
        if self.constraints is not None:
            if self.constraints.shape[0] != n:
                raise ValueError(
                    f"constraints must have shape [{n}, any], got {list(self.constraints.shape)}"
                )
            constraints = self.constraints.shape[1]
        if k > n - constraints:
            raise ValueError(
                f"{constraints} constraints leave {n - constraints} dimensions, too few for k = {k}"
            )
        wanted = -(-(k + 1 + k // 5) // 4) * 4 if self.guard_vectors is None else k + self.guard_vectors
        return min(wanted, n - constraints)


class _State(eqx.Module):
    """Where the iteration stands, with m approximations. X and P are B-orthonormal and B-orthogonal to each other."""

    V: Float[Array, "n w"]
    """w = 2m columns: X, the Ritz vectors, then P, the search directions that led there, zero where not kept."""
    AV: Float[Array, "n w"]
    values: Float[Array, " m"]
    """Ritz values, ascending: XᵀAX. XᵀAP = 0."""
    P_energy: Float[Array, "m m"]
    """PᵀAP."""
    P_kept: Bool[Array, " m"]
    R: Float[Array, "n m"]
    """Residuals AX − BX diag(values), orthogonally to the constraints."""
    errors: Float[Array, " m"]
    """‖r‖ / ‖x‖."""
    indefinite: Bool[Array, ""]
    """Whether a vector with xᵀBx < 0 was met."""
    steps: Int[Array, ""]
    since_refresh: Int[Array, ""]
    fills: Int[Array, ""]
    """Times that the approximations had not full rank."""
    products: Int[Array, ""]
    """Vectors multiplied by A."""
    least_error: Float[Array, ""]
    least_trace: Float[Array, ""]
    idle: Int[Array, ""]
    """Steps since either fell."""


class _Iteration(eqx.Module):
    """What stays the same from step to step."""

    A: BlockProduct
    B: BlockProduct
    inverse: AbstractApproximateInverse | None
    constraints: tuple[Float[Array, "n c"], Float[Array, "n c"]] | None
    """Y, B-orthonormal, and BY."""
    tolerance: Float[Array, ""]
    """For the errors."""
    separation: float = eqx.field(static=True)
    """Least eigenvalue of a scaled Gram matrix that may be whitened in the coefficients alone.

    The basis is then orthonormal up to ε over this, which should not be seen in the residuals.
    """
    key: Array
    k: int = eqx.field(static=True)
    max_steps: int = eqx.field(static=True)

    def starting_vectors(
        self, n: int, m: int, guess: Float[Array, "n g"] | None, dtype: DTypeLike
    ) -> Float[Array, "n m"]:
        """The guess, what the preconditioner proposes where the guess is too small, then random ones."""
        parts = []
        if guess is not None:
            guess = jnp.where(jnp.isfinite(guess).all(axis=0, keepdims=True), guess, 0).astype(dtype)
            parts.append(guess if guess.shape[1] <= m else self._ritz_vectors(guess)[0])
        if self.inverse is not None and (guess is None or guess.shape[1] < self.k):
            proposed = self.inverse.starting_vectors(m)
            parts += [] if proposed is None else [proposed.astype(dtype)]
        missing = m - sum(part.shape[1] for part in parts)
        if missing > 0:
            parts.append(self._random(n, missing, dtype, 0))
        return jnp.concatenate(parts, axis=1)[:, :m]

    def _random(self, n: int, count: int, dtype: DTypeLike, stream: int | Array) -> Float[Array, "n count"]:
        key = jax.random.fold_in(self.key, stream)
        return jax.random.uniform(key, (n, count), jnp.float32, -1, 1).astype(dtype)  # fewer bits to draw

    def run(self, X: Float[Array, "n m"]) -> _State:
        (n, m), dtype = X.shape, X.dtype
        zero, infinity = jnp.int32(0), jnp.array(jnp.inf, dtype)
        unknown = _State(
            V=jnp.concatenate([X, jnp.zeros_like(X)], axis=1),
            AV=jnp.zeros((n, 2 * m), dtype),
            values=jnp.zeros(m, dtype),
            P_energy=jnp.zeros((m, m), dtype),
            P_kept=jnp.zeros(m, bool),
            R=jnp.zeros((n, m), dtype),
            errors=jnp.full(m, jnp.inf, dtype),
            indefinite=jnp.bool_(False),
            steps=zero,
            since_refresh=jnp.int32(1),
            fills=zero,
            products=zero,
            least_error=infinity,
            least_trace=infinity,
            idle=zero,
        )

        def going(state: _State) -> Bool[Array, ""]:
            wanted = state.errors[: self.k]
            open_ = ~(wanted <= self.tolerance).all() & jnp.isfinite(wanted).all() & ~state.indefinite
            return open_ & (state.idle < _PATIENCE) & (state.steps < self.max_steps)

        def sweep(state: _State) -> _State:
            return jax.lax.while_loop(
                lambda state: going(state) & (state.since_refresh < _REFRESH),
                lambda state: self.step(state),  # noqa: PLW0108  (a bound method of a module has no hash)
                self.refreshed(state),
            )

        # The last sweep takes no step: by true products it finds that all is well, or hopeless.
        return jax.lax.while_loop(lambda state: state.since_refresh > 0, sweep, unknown)

    def refreshed(self, state: _State) -> _State:
        """The Ritz vectors of the space X by true products, without P.

        Where X has not full rank, random vectors stand for what is missing, and this must be done again.
        """
        n, m = state.R.shape
        X, AX, BX, values, kept, negative = self._ritz_vectors(state.V[:, :m])
        complete = kept.all()
        fills = state.fills + jnp.where(complete, 0, 1)
        X = jax.lax.cond(
            complete, lambda: X, lambda: jnp.where(kept[None, :], X, self._random(n, m, X.dtype, fills))
        )
        R, errors = self._residuals(X, AX, BX, values)
        nothing = jnp.zeros_like(X)
        indefinite = state.indefinite | negative | (fills >= _FILLS)
        return dataclasses.replace(
            state,
            V=jnp.concatenate([X, nothing], axis=1),
            AV=jnp.concatenate([AX, nothing], axis=1),
            values=values,
            P_energy=jnp.zeros((m, m), X.dtype),
            P_kept=jnp.zeros(m, bool),
            R=R,
            errors=errors,
            indefinite=indefinite,
            since_refresh=jnp.where(complete | indefinite, 0, _REFRESH).astype(jnp.int32),
            fills=fills,
            products=state.products + m,
        )

    def step(self, state: _State) -> _State:
        V, m = state.V, len(state.values)
        W, overlap, gram, negative = self._search_directions(state)
        AW = self.A(W)

        # [X P W] Z is B-orthonormal …
        scale = inverse_roots(gram.diagonal())
        C, W_kept, _ = whitening(scaled(gram - overlap @ overlap.T, scale), self.separation)
        C = scale[:, None] * C
        Z = jnp.block([[jnp.eye(2 * m, dtype=V.dtype), -overlap.T @ C], [jnp.zeros((m, 2 * m), V.dtype), C]])
        # … and H is A in this basis.
        AW_on_V = AW.T @ V
        energy = jax.scipy.linalg.block_diag(jnp.diag(state.values), state.P_energy, AW.T @ W)
        energy = energy.at[: 2 * m, 2 * m :].set(AW_on_V.T).at[2 * m :, : 2 * m].set(AW_on_V)
        H = Z.T @ energy @ Z
        values, C = ritz_pairs(H, jnp.concatenate([jnp.ones(m, bool), state.P_kept, W_kept]))
        C_P, P_kept = conjugate_directions(C, m)
        K = Z @ jnp.concatenate([C[:, :m], C_P], axis=1)

        V = combined(V, K[: 2 * m], W, K[2 * m :])
        AV = combined(state.AV, K[: 2 * m], AW, K[2 * m :])
        R, errors = self._residuals(V[:, :m], AV[:, :m], self.B(V[:, :m]), values[:m])

        worst, trace = errors[: self.k].max(), values[: self.k].sum()
        noise = 100 * jnp.finfo(V.dtype).eps * jnp.abs(values).max()
        better = (worst < 0.95 * state.least_error) | (trace < state.least_trace - noise)
        idle = jnp.where(W_kept.any(), jnp.where(better, 0, state.idle + 1), _PATIENCE)
        return _State(
            V=V,
            AV=AV,
            values=values[:m],
            P_energy=C_P.T @ H @ C_P,
            P_kept=P_kept,
            R=R,
            errors=errors,
            indefinite=state.indefinite | negative,
            steps=state.steps + 1,
            since_refresh=state.since_refresh + 1,
            fills=state.fills,
            products=state.products + m,
            least_error=jnp.where(better, jnp.minimum(worst, state.least_error), state.least_error),
            least_trace=jnp.where(better, jnp.minimum(trace, state.least_trace), state.least_trace),
            idle=idle.astype(jnp.int32),
        )

    def _search_directions(self, state: _State) -> tuple[Array, Array, Array, Array]:
        """W; WᵀBV; WᵀBW; whether this shows B to be indefinite.

        W are the preconditioned residuals of the pairs that have not converged, zero for the others (soft locking). Where
        they nearly depend on each other or on V, or are not finite, W is a roughly orthonormal basis of them outside span V.
        """
        V = state.V
        active = state.errors > self.tolerance
        W = state.R * jnp.where(active, inverse_roots((state.R**2).sum(axis=0)), 0)[None, :]
        W = self._constrained(W if self.inverse is None else self.inverse.apply(W))
        BW = self.B(W)
        overlap, gram = BW.T @ V, BW.T @ W
        finite = jnp.isfinite(gram.diagonal())
        overlap = jnp.where(finite[:, None], overlap, 0)
        gram = jnp.where(finite[:, None] & finite[None, :], gram, 0)
        scale = inverse_roots(gram.diagonal())
        outside = scaled(gram - overlap @ overlap.T, scale)
        least = jnp.linalg.eigvalsh(outside + jnp.diag((scale == 0).astype(V.dtype)))[0]

        def separated() -> tuple[Array, Array, Array, Array]:
            C = scale[:, None] * whitening(outside, rounding(V, len(scale)))[0]
            directions = combined(V, -overlap.T @ C, jnp.where(finite[None, :], W, 0), C)
            directions = self._constrained(directions)
            B_directions = self.B(directions)
            negative = negative_energies(gram.diagonal(), W, BW)
            return directions, B_directions.T @ V, B_directions.T @ directions, negative

        doubtful = (least < self.separation) | ~finite.all() | (gram.diagonal() < 0).any()
        return jax.lax.cond(doubtful, separated, lambda: (W, overlap, gram, jnp.bool_(False)))

    def _residuals(
        self,
        X: Float[Array, "n m"],
        AX: Float[Array, "n m"],
        BX: Float[Array, "n m"],
        values: Float[Array, " m"],
    ) -> tuple[Float[Array, "n m"], Float[Array, " m"]]:
        R = AX - BX * values[None, :]
        if self.constraints is not None:
            Y, BY = self.constraints
            R = R - BY @ (Y.T @ R)
        return R, jnp.linalg.norm(R, axis=0) / jnp.linalg.norm(X, axis=0)

    def _constrained(self, block: Float[Array, "n w"]) -> Float[Array, "n w"]:
        """Its B-orthogonal projection off the constraints."""
        if self.constraints is None:
            return block
        Y, BY = self.constraints
        return block - Y @ (BY.T @ block)

    def _ritz_vectors(self, S: Float[Array, "n w"]) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Ritz vectors V of span S, B-orthonormal; AV; BV; Ritz values; which of V are kept; was B seen to be indefinite?"""
        S, BS, kept, negative = orthonormalised(self.B, S, self._constrained)
        AS = self.A(S)
        values, C = ritz_pairs(S.T @ AS, kept)
        return S @ C, AS @ C, BS @ C, values, jnp.arange(len(kept)) < kept.sum(), negative
