"""LOBPCG: smallest eigenpairs by a block of preconditioned, locally optimal search directions.

Each step minimises the trace of A over the span of the approximations X, the preconditioned residuals W and the previous
search directions P, and is kept from breaking down where that basis is nearly dependent.

References: A. Knyazev, Toward the Optimal Preconditioned Eigensolver (2001); U. Hetmaniuk, R. Lehoucq, Basis selection in
LOBPCG (2006) for P; A. Stathopoulos, K. Wu, A block orthogonalization procedure with constant synchronization requirements
(2002) for the SVQB orthonormalisation; J. Duersch, M. Shao, C. Yang, M. Gu, A Robust and Efficient Implementation of LOBPCG
(2018).
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, DTypeLike, Float, Int

from ._ell import BlockProduct, block_product
from ._jacobi import cheap_diagonal
from ._preconditioner import AbstractApproximateInverse, AbstractPreconditioner
from ._problem import GeneralizedEigenproblem
from ._residual import relative_residuals, spectral_norm
from ._solution import RESULTS, EigenSolution
from ._solver import AbstractEigensolver

_ROUNDINGS = 16  # a residual of this many rounding units is converged: nothing smaller can be asked for
_REFRESH = 40  # steps between true products, which keep rounding from adding up
_PATIENCE = 50  # steps without progress


class LOBPCG(AbstractEigensolver):
    """Locally optimal block preconditioned conjugate gradients, for any symmetric A and positive definite B.

    Fully in JAX: runs under `jit` and `vmap` on any backend, one product with A and three with B a step. How many steps it
    takes is up to the preconditioner: tens with one close to A⁻¹, thousands without. Converged when the first k pairs have
    ‖A x − λ B x‖₂ ≤ (rtol ‖A‖₂ + atol) ‖x‖₂; eigenvalues are then accurate to the square of that. For more than a third
    of all eigenpairs `DenseEigh` is faster.
    """

    rtol: float = eqx.field(default=1e-8, static=True)
    """Relative to ‖A‖₂. Less than 16 rounding units (3.6e-15, or 1.9e-6 in float32) counts as that."""
    atol: float = eqx.field(default=0.0, static=True)
    max_steps: int = eqx.field(default=1000, static=True)
    guard_vectors: int | None = eqx.field(default=None, static=True)
    """Pairs carried beyond the k wanted, which they speed up and keep complete; by default 1 and a fifth of k, rounded to a whole four."""
    preconditioner: AbstractPreconditioner | None = None
    constraints: Float[Array, "n c"] | None = None
    """Vectors to stay B-orthogonal to (known eigenvectors, say), in columns; the residuals are taken orthogonally to them."""
    seed: int = eqx.field(default=0, static=True)
    """Of the random starting vectors."""

    def __check_init__(self) -> None:
        if not (self.rtol >= 0 and self.atol >= 0):
            raise ValueError(f"rtol and atol must not be negative, got {self.rtol} and {self.atol}")
        if self.max_steps < 0 or (self.guard_vectors is not None and self.guard_vectors < 0):
            raise ValueError(
                f"max_steps and guard_vectors must not be negative, got {self.max_steps} and {self.guard_vectors}"
            )

    @eqx.filter_jit
    def compute(
        self, problem: GeneralizedEigenproblem, k: int, guess: Float[Array, "n g"] | None
    ) -> EigenSolution:
        n, dtype = problem.size, problem.dtype
        free = n - (0 if self.constraints is None else self.constraints.shape[1])
        if self.constraints is not None and self.constraints.shape[0] != n:
            raise ValueError(f"constraints must have shape [{n}, any], got {list(self.constraints.shape)}")
        if k > free:
            raise ValueError(f"{free} dimensions are left by the constraints, too few for k = {k} pairs")
        m = min(-(-(k + 1 + k // 5) // 4) * 4 if self.guard_vectors is None else k + self.guard_vectors, free)

        A, B = block_product(problem.A), block_product(problem.B)
        norm = spectral_norm(A, n, dtype)
        iteration = _Iteration(
            A=A,
            B=B,
            inverse=None if self.preconditioner is None else self.preconditioner.prepare(problem),
            constraints=None if self.constraints is None else _orthonormalised(B, lambda Y: Y, self.constraints)[:2],
            tolerance=max(self.rtol, _ROUNDINGS * float(jnp.finfo(dtype).eps)) * norm + self.atol,
            k=k,
            max_steps=self.max_steps,
        )
        start = iteration.starting_basis(n, m, guess, jax.random.key(self.seed), dtype)
        final = iteration.run(start)

        X, AX = final.V[:, :k], final.AV[:, :k]
        if iteration.constraints is not None:
            Y, BY = iteration.constraints
            AX = AX - BY @ (Y.T @ AX)
        values = final.values[:k]
        residuals = relative_residuals(AX, B(X), X, values, norm)
        converged = final.errors <= iteration.tolerance

        finite = jnp.isfinite(final.values).all()
        for leaf in jax.tree.leaves(eqx.filter(problem, eqx.is_inexact_array)):
            finite &= jnp.isfinite(leaf).all()
        mass = cheap_diagonal(problem.B)
        indefinite = final.indefinite if mass is None else final.indefinite | (mass <= 0).any()
        result = RESULTS.where(final.steps >= self.max_steps, RESULTS.max_steps_reached, RESULTS.stagnated)
        result = RESULTS.where(converged[:k].all(), RESULTS.successful, result)
        result = RESULTS.where(indefinite, RESULTS.indefinite_mass, result)
        result = RESULTS.where(finite, result, RESULTS.nonfinite_input)
        stats = {"steps": final.steps, "products": final.products, "converged": converged[:k].sum()}
        return EigenSolution(values, X, residuals, result, stats)


class _State(eqx.Module):
    """Where the iteration stands. X and P are B-orthonormal and B-orthogonal to each other."""

    V: Float[Array, "n w"]
    """X, the Ritz vectors, then P, the search directions that led there; columns of P that are not kept are zero."""
    AV: Float[Array, "n w"]
    values: Float[Array, " m"]
    """Ritz values, ascending: XᵀAX. XᵀAP = 0."""
    P_energy: Float[Array, "m m"]
    """PᵀAP."""
    P_kept: Bool[Array, " m"]
    R: Float[Array, "n m"]
    """Residuals AX − BX diag(values)."""
    errors: Float[Array, " m"]
    """‖r‖ / ‖x‖."""
    indefinite: Bool[Array, ""]
    """Whether a vector with xᵀBx < 0 was met."""
    steps: Int[Array, ""]
    since_refresh: Int[Array, ""]
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
    k: int = eqx.field(static=True)
    max_steps: int = eqx.field(static=True)

    def starting_basis(
        self, n: int, m: int, guess: Float[Array, "n g"] | None, key: Array, dtype: DTypeLike
    ) -> Float[Array, "n w"]:
        """Guess, then the preconditioner's proposals where the guess is too small, then random vectors.

        At least half of the columns are random or proposed, so that a guess without full rank does no harm.
        """
        parts = []
        if guess is not None:
            guess = jnp.where(jnp.isfinite(guess).all(axis=0, keepdims=True), guess, 0)
            parts.append(guess if guess.shape[1] <= m else self._ritz_vectors(guess)[0][:, :m])
        if self.inverse is not None and (guess is None or guess.shape[1] < self.k):
            proposed = self.inverse.starting_vectors(m)
            parts += [] if proposed is None else [proposed]
        rest = 2 * m - sum(part.shape[1] for part in parts)
        return jnp.concatenate([*parts, jax.random.normal(key, (n, rest), dtype)], axis=1)

    def run(self, basis: Float[Array, "n w"]) -> _State:
        n, m = basis.shape[0], basis.shape[1] // 2
        zero, dtype = jnp.int32(0), basis.dtype
        unknown = _State(
            V=basis,
            AV=jnp.zeros((n, 2 * m), dtype),
            values=jnp.zeros(m, dtype),
            P_energy=jnp.zeros((m, m), dtype),
            P_kept=jnp.zeros(m, bool),
            R=jnp.zeros((n, m), dtype),
            errors=jnp.full(m, jnp.inf, dtype),
            indefinite=jnp.bool_(False),
            steps=zero,
            since_refresh=jnp.int32(1),
            products=zero,
            least_error=jnp.array(jnp.inf, dtype),
            least_trace=jnp.array(jnp.inf, dtype),
            idle=zero,
        )

        def going(state: _State) -> Array:
            wanted = state.errors[: self.k]
            unfinished = ~(wanted <= self.tolerance).all() & jnp.isfinite(wanted).all() & ~state.indefinite
            return unfinished & (state.idle < _PATIENCE) & (state.steps < self.max_steps)

        def sweep(state: _State) -> _State:
            return jax.lax.while_loop(
                lambda state: going(state) & (state.since_refresh < _REFRESH),
                lambda state: self.step(state),
                self.refreshed(state),
            )

        # The last sweep takes no step: it finds that all is well, or hopeless, by true products.
        return jax.lax.while_loop(lambda state: state.since_refresh > 0, sweep, unknown)

    def refreshed(self, state: _State) -> _State:
        """The same spaces X and P by true products; X the lowest Ritz vectors of both together."""
        m = state.values.shape[0]
        V, AV, BV, ritz_values, kept, negative = self._ritz_vectors(state.V)
        return eqx.tree_at(
            lambda s: (s.P_energy, s.P_kept, s.indefinite, s.since_refresh, s.products),
            self._with_pairs(state, V, AV, BV[:, :m], ritz_values[:m]),
            (
                jnp.diag(jnp.where(kept[m:], ritz_values[m:], 0)),
                kept[m:],
                state.indefinite | negative | ~kept[:m].all(),
                jnp.int32(0),
                state.products + 2 * m,
            ),
        )

    def step(self, state: _State) -> _State:
        V, m = state.V, state.values.shape[0]
        W, BW, overlap, gram, negative = self._search_directions(state)
        AW = self.A(W)
        scale = _inverse_roots(gram.diagonal())
        C, W_kept, _ = _whitening(_scaled(gram - overlap @ overlap.T, scale), _nearly_dependent(V))
        C = scale[:, None] * C
        Z = jnp.block([[jnp.eye(2 * m, dtype=V.dtype), -overlap.T @ C], [jnp.zeros((m, 2 * m), V.dtype), C]])

        # Rayleigh–Ritz in [X P W] Z.
        AW_V = AW.T @ V
        energy = jax.scipy.linalg.block_diag(jnp.diag(state.values), state.P_energy, AW.T @ W)
        energy = energy.at[: 2 * m, 2 * m :].set(AW_V.T).at[2 * m :, : 2 * m].set(AW_V)
        kept = jnp.concatenate([jnp.ones(m, bool), state.P_kept, W_kept])
        H = jnp.where(kept[:, None] & kept[None, :], Z.T @ energy @ Z, 0)
        ritz_values, C = _ritz(H, kept)
        C_P, P_kept = _conjugate_directions(C)
        K = Z @ jnp.concatenate([C[:, :m], C_P], axis=1)
        V = V @ K[: 2 * m] + W @ K[2 * m :]
        AV = state.AV @ K[: 2 * m] + AW @ K[2 * m :]
        moved = self._with_pairs(state, V, AV, self.B(V[:, :m]), ritz_values[:m])

        worst, trace = moved.errors[: self.k].max(), moved.values[: self.k].sum()
        noise = 100 * jnp.finfo(V.dtype).eps * jnp.abs(ritz_values).max()
        better = worst < 0.95 * state.least_error
        better |= trace < state.least_trace - 1e-4 * jnp.abs(state.least_trace) - noise
        idle = jnp.where(better, 0, state.idle + 1)
        return eqx.tree_at(
            lambda s: (
                *(s.P_energy, s.P_kept, s.indefinite, s.steps, s.since_refresh, s.products),
                *(s.least_error, s.least_trace, s.idle),
            ),
            moved,
            (
                C_P.T @ H @ C_P,
                P_kept,
                state.indefinite | negative,
                state.steps + 1,
                state.since_refresh + 1,
                state.products + m,
                jnp.where(better, jnp.minimum(worst, state.least_error), state.least_error),
                jnp.where(better, jnp.minimum(trace, state.least_trace), state.least_trace),
                jnp.where(W_kept.any(), idle, _PATIENCE).astype(jnp.int32),
            ),
        )

    def _search_directions(self, state: _State) -> tuple[Array, Array, Array, Array, Array]:
        """W; BW; WᵀBV; WᵀBW; whether this shows B to be indefinite.

        W are the preconditioned residuals of the pairs that have not converged, zero for the others (soft locking); where
        they nearly depend on each other or on V, or are not finite, a roughly orthonormal basis of them outside span V.
        """
        V = state.V
        active = state.errors > self.tolerance
        W = state.R * jnp.where(active, _inverse_roots((state.R**2).sum(axis=0)), 0)[None, :]
        W = self._constrained(W if self.inverse is None else self.inverse.apply(W))
        BW = self.B(W)
        overlap, gram = BW.T @ V, BW.T @ W
        finite = jnp.isfinite(gram.diagonal())
        overlap = jnp.where(finite[:, None], overlap, 0)
        gram = jnp.where(finite[:, None] & finite[None, :], gram, 0)
        scale = _inverse_roots(gram.diagonal())
        outside = _scaled(gram - overlap @ overlap.T, scale)
        tightest = jnp.linalg.eigvalsh(outside + jnp.diag(jnp.where(scale > 0, 0.0, 1.0).astype(V.dtype))).min()

        def separated() -> tuple[Array, Array, Array, Array, Array]:
            C = scale[:, None] * _whitening(outside, _tiny(V, len(scale)))[0]
            directions = jnp.where(finite[None, :], W, 0) @ C - V @ (overlap.T @ C)
            directions = self._constrained(directions)
            B_directions = self.B(directions)
            negative = _negative(gram.diagonal(), W, BW)
            return directions, B_directions, B_directions.T @ V, B_directions.T @ directions, negative

        doubtful = (tightest < _nearly_dependent(V)) | ~finite.all() | (gram.diagonal() < 0).any()
        return jax.lax.cond(doubtful, separated, lambda: (W, BW, overlap, gram, jnp.bool_(False)))

    def _with_pairs(
        self,
        state: _State,
        V: Float[Array, "n w"],
        AV: Float[Array, "n w"],
        BX: Float[Array, "n m"],
        values: Float[Array, " m"],
    ) -> _State:
        m = values.shape[0]
        R = AV[:, :m] - BX * values[None, :]
        if self.constraints is not None:
            Y, BY = self.constraints
            R = R - BY @ (Y.T @ R)
        errors = jnp.linalg.norm(R, axis=0) / jnp.linalg.norm(V[:, :m], axis=0)
        return eqx.tree_at(
            lambda s: (s.V, s.AV, s.values, s.R, s.errors), state, (V, AV, values, R, errors)
        )

    def _constrained(self, block: Float[Array, "n w"]) -> Float[Array, "n w"]:
        """Its B-orthogonal projection off the constraints."""
        if self.constraints is None:
            return block
        Y, BY = self.constraints
        return block - Y @ (BY.T @ block)

    def _ritz_vectors(self, S: Float[Array, "n w"]) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Ritz vectors V of span S, B-orthonormal; AV; BV; Ritz values; which V are not zero for want of rank; B indefinite?"""
        S, BS, kept, negative = _orthonormalised(self.B, self._constrained, S)
        AS = self.A(S)
        H = jnp.where(kept[:, None] & kept[None, :], S.T @ AS, 0)
        ritz_values, C = _ritz(H, kept)
        return S @ C, AS @ C, BS @ C, ritz_values, jnp.arange(len(kept)) < kept.sum(), negative


def _orthonormalised(
    B: BlockProduct, project: Callable[[Float[Array, "n w"]], Float[Array, "n w"]], S: Float[Array, "n w"]
) -> tuple[Float[Array, "n w"], Float[Array, "n w"], Bool[Array, " w"], Bool[Array, ""]]:
    """A B-orthonormal basis of span S by SVQB, twice where needed; its product with B; which columns are not zero; is B indefinite?"""
    width = S.shape[1]

    def once(carry: tuple[Array, ...]) -> tuple[Array, ...]:
        S, _, _, negative, passes, _ = carry
        S = project(S)
        BS = B(S)
        gram = S.T @ BS
        scale = _inverse_roots(gram.diagonal())
        least = jnp.where(passes == 0, _tiny(S, width), 0.1)  # later, what is short is nothing but rounding
        C, kept, eigenvalues = _whitening(_scaled(gram, scale), least)
        C = scale[:, None] * C
        rounding = [(scale * jnp.linalg.norm(block, axis=0)).max() for block in (S, BS)]
        noise = _tiny(S, width) * jnp.maximum(1, rounding[0] * rounding[1])
        negative |= _negative(gram.diagonal(), S, BS) | (eigenvalues < -noise).any()
        rough = (kept & (eigenvalues < 0.1)).any()
        return S @ C, BS @ C, kept, negative, passes + 1, rough

    start = (S, jnp.zeros_like(S), jnp.zeros(width, bool), jnp.bool_(False), jnp.int32(0), jnp.bool_(True))
    return jax.lax.while_loop(lambda carry: carry[-1] & (carry[-2] < 2), once, start)[:4]


def _negative(energies: Float[Array, " w"], S: Float[Array, "n w"], BS: Float[Array, "n w"]) -> Bool[Array, ""]:
    """Whether sᵀBs is negative for a column, by more than rounding."""
    rounding = _tiny(S, S.shape[1]) * jnp.linalg.norm(S, axis=0) * jnp.linalg.norm(BS, axis=0)
    return (energies < -rounding).any()


def _scaled(gram: Float[Array, "w w"], scale: Float[Array, " w"]) -> Float[Array, "w w"]:
    return gram * scale[:, None] * scale[None, :]


def _nearly_dependent(like: Array) -> float:
    """Least eigenvalue of a scaled Gram matrix that whitening in the coefficients bears: an error of ε^0.6 in BᵀB = I."""
    return float(jnp.finfo(like.dtype).eps) ** 0.4


def _tiny(like: Array, width: int) -> float:
    """Eigenvalues of a scaled Gram matrix of this width below this are rounding."""
    return 10 * width * float(jnp.finfo(like.dtype).eps)


def _inverse_roots(squares: Float[Array, " w"]) -> Float[Array, " w"]:
    """1/√x, and 0 where x ≤ 0."""
    positive = squares > 0
    return jnp.where(positive, jax.lax.rsqrt(jnp.where(positive, squares, 1)), 0)


def _whitening(
    gram: Float[Array, "w w"], least: float | Float[Array, ""]
) -> tuple[Float[Array, "w w"], Bool[Array, " w"], Float[Array, " w"]]:
    """C with Cᵀ gram C = I, by eigenvectors (SVQB); which of its columns are kept; all eigenvalues.

    Columns whose eigenvalue is not above `least` are not kept, and zero.
    """
    eigenvalues, Q = jnp.linalg.eigh(gram)
    kept = eigenvalues > least
    return Q * jnp.where(kept, _inverse_roots(eigenvalues), 0)[None, :], kept, eigenvalues


def _ritz(H: Float[Array, "w w"], kept: Bool[Array, " w"]) -> tuple[Float[Array, " w"], Float[Array, "w w"]]:
    """Eigenpairs of H, ascending, those of coordinates not kept (zero in H) behind all others, with zero vectors."""
    bound = jnp.abs(H).sum(axis=0).max()
    bound = 2 * jnp.where(bound > 0, bound, 1)
    ritz_values, C = jnp.linalg.eigh(H + jnp.diag(jnp.where(kept, 0, bound)))
    behind = jnp.arange(len(kept)) >= kept.sum()
    return ritz_values, jnp.where(kept[:, None] & ~behind[None, :], C, 0)


def _conjugate_directions(
    C: Float[Array, "w w"],
) -> tuple[Float[Array, "w m"], Bool[Array, " m"]]:
    """Coefficients of P: what the new X has outside the old one, orthonormal and orthogonal to the new X."""
    m = C.shape[0] // 3
    new, others = C[:, :m], C[:, m:]
    change = others.T @ new.at[:m].set(0)
    change = change * _inverse_roots((change**2).sum(axis=0))[None, :]
    U, singular_values, _ = jnp.linalg.svd(change, full_matrices=False)
    kept = singular_values > _tiny(C, m)
    return others @ jnp.where(kept[None, :], U, 0), kept
