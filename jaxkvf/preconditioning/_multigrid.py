"""Multigrid: an approximate inverse whose quality does not depend on size.

References: A. Brandt, Algebraic multigrid theory (1986); U. Trottenberg, C. Oosterlee, A. Schüller, Multigrid (2001), §2.6
for nested iteration.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float

from ..eigen import AbstractApproximateInverse, AbstractPreconditioner, GeneralizedEigenproblem
from ..eigen.subspace import inverse_roots, ritz_pairs, rounding, scaled, whitening
from ..sparse import (
    RowProduct,
    SymmetricBlockOperator,
    apply_blocks,
    assembled,
    gathered,
    inverse_factors,
    times,
)
from ._coarsening import Coarsening
from ._coarsest import Direct
from ._smoothing import Smoother

_MORE_BELOW = 4  # smoothing steps on the coarser levels, where they cost little and spare LOBPCG steps


class Multigrid(AbstractPreconditioner):
    """One V-cycle for A + sB, symmetric and positive definite, on a hierarchy of ever coarser graphs.

    Coarse operators are Galerkin products PᵀKP, smoothing is by Chebyshev polynomials over block Jacobi, the coarsest
    problem is solved directly: as one dense matrix, but for components that are down to a node each. All numbers but the
    interpolation's weights come from the problem, so that one `Multigrid` serves while its entries change. A and B must be,
    or assemble to, `SymmetricBlockOperator`s on the graph that the hierarchy was built for; A positive semi-definite. Each
    off-diagonal block of B is a positive multiple of the rotation that carries components from the column's frame to the
    row's, as in a mass matrix with transport along the edges (of 1 for scalars); where it is zero, the frames are taken to
    agree.
    """

    hierarchy: tuple[Coarsening, ...]
    """From fine to coarse; empty for a direct solve. Of a mesh: `jaxkvf.killing.vector_hierarchy`."""
    degree: int = eqx.field(default=3, static=True)
    """Of the smoother: products with the operator before and after a coarse correction; four more on coarser levels."""
    dtype: str | None = eqx.field(default="float32", static=True)
    """Precision inside; None for the problem's. Single precision costs LOBPCG in float64 no steps, and half the memory."""
    nested_steps: int = eqx.field(default=3, static=True)
    """Smoothings of the starting vectors on each level between the coarsest and the finest."""

    def __check_init__(self) -> None:
        if self.degree < 1:
            raise ValueError(f"degree must be at least 1, got {self.degree}")
        if self.dtype not in (None, "float32", "float64"):
            raise ValueError(f"dtype must be None, 'float32' or 'float64', got {self.dtype!r}")
        if self.nested_steps < 0:
            raise ValueError(f"nested_steps must not be negative, got {self.nested_steps}")

    def __str__(self) -> str:
        """The levels, and the operator complexity: blocks of the operators of all levels, over those of the finest."""
        if not self.hierarchy:
            return "Multigrid of one level: a direct solve"
        finest, edges = self.hierarchy[0].interpolation, [len(c.coarse_edges) for c in self.hierarchy]
        nodes = [finest.weights.shape[1], *(c.interpolation.n_coarse for c in self.hierarchy)]
        blocks = [n + 2 * m for n, m in zip(nodes, [finest.n_edges, *edges], strict=True)]
        lines = [f"  {n:>10,} nodes, {count:>11,} blocks" for n, count in zip(nodes, blocks, strict=True)]
        complexity = f"operator complexity {sum(blocks) / blocks[0]:.2f}"
        return "\n".join([f"Multigrid of {len(nodes)} levels, {complexity}", *lines])

    def prepare(self, problem: GeneralizedEigenproblem) -> AbstractApproximateInverse:
        """The cycle for this problem.

        Raises:
            ValueError: A or B does not assemble to a `SymmetricBlockOperator`, or not on the hierarchy's graph.
        """
        A, B = self._checked(problem.A), self._checked(problem.B)
        a, b = (M.diagonal.diagonal(axis1=1, axis2=2) for M in (A, B))
        # About the spacing of the spectrum: λ_max / n, with the sum over all unknowns in place of n like terms.
        shift = 1 / jnp.where(a > 0, b / jnp.where(a > 0, a, 1), 0).sum()

        dtype = jnp.dtype(self.dtype or problem.dtype)
        K = SymmetricBlockOperator(
            (A.diagonal + shift * B.diagonal).astype(dtype),
            (A.upper + shift * B.upper).astype(dtype),
            A.graph,
        )
        turns = _directions(B.upper).astype(dtype)
        masses = (b.mean(axis=1) / b.mean()).astype(dtype)
        levels = []
        for coarsening in self.hierarchy:
            degree = self.degree + (_MORE_BELOW if levels else 0)
            level, K, turns, masses = _Level.descend(coarsening, K, turns, masses, degree)
            levels.append(level)
        nodes = jnp.arange(len(masses), dtype=jnp.int32)
        joined, alone = (
            (self.hierarchy[-1].joined, self.hierarchy[-1].alone) if levels else (nodes, nodes[:0])
        )
        return _VCycle(tuple(levels), Direct.factorize(K, masses, joined, alone), self.nested_steps)

    def _checked(self, operator: lx.AbstractLinearOperator) -> SymmetricBlockOperator:
        while isinstance(operator, lx.TaggedLinearOperator):
            operator = operator.operator
        operator = assembled(operator)
        if not isinstance(operator, SymmetricBlockOperator):
            raise ValueError(
                f"Multigrid needs A and B as SymmetricBlockOperator, got {type(operator).__name__}"
            )
        if self.hierarchy:
            finest = self.hierarchy[0].interpolation
            built, got = (
                (finest.weights.shape[1], finest.n_edges),
                (len(operator.diagonal), len(operator.upper)),
            )
            if built != got:
                raise ValueError(
                    f"the hierarchy was built for {built[0]} nodes and {built[1]} edges, "
                    f"the operator has {got[0]} and {got[1]}"
                )
        return operator


def _directions(blocks: Float[Array, "m b b"]) -> Float[Array, "m b b"]:
    """The rotations of which these are positive multiples, of any size; no rotation for 0."""
    size = jnp.abs(blocks).max(axis=(1, 2), keepdims=True)
    blocks = blocks / jnp.where(size > 0, size, 1)
    length = jnp.linalg.norm(blocks, axis=(1, 2), keepdims=True) / blocks.shape[1] ** 0.5
    stay = jnp.eye(blocks.shape[1], dtype=blocks.dtype)[None]
    return jnp.where(length > 0, blocks / jnp.where(length > 0, length, 1), stay)


class _Level(eqx.Module):
    """A level of the hierarchy, its unknowns x̂ = G⁻ᵀ x scaled so that the diagonal blocks of its operator are identities."""

    G: Float[Array, "n b b"]
    smoother: Smoother
    """Of G K Gᵀ."""
    P: RowProduct
    """G⁻ᵀ P: coarse unknowns, unscaled, to fine ones, scaled."""
    R: RowProduct
    """Its transpose."""
    masses: Float[Array, " n"]

    def mass(self, x: Float[Array, "nb k"]) -> Float[Array, "nb k"]:
        """The masses times x, in scaled unknowns."""
        y = apply_blocks(self.G.mT, x).reshape(len(self.masses), -1)
        return apply_blocks(self.G, (self.masses[:, None] * y).reshape(x.shape))

    @classmethod
    def descend(
        cls,
        coarsening: Coarsening,
        K: SymmetricBlockOperator,
        turns: Float[Array, "m b b"],
        masses: Float[Array, " n"],
        degree: int,
    ) -> tuple["_Level", SymmetricBlockOperator, Float[Array, "coarse_m b b"], Float[Array, " n_coarse"]]:
        """The level of the operator K, and the operator, turns and masses of the next."""
        n, b, _ = K.diagonal.shape
        interpolation, dtype = coarsening.interpolation, K.diagonal.dtype
        G = inverse_factors(K.diagonal)
        tail, head = K.edges.T
        upper = times(times(gathered(G, tail), K.upper), gathered(G, head).mT)
        identity = jnp.broadcast_to(jnp.eye(b, dtype=dtype), (n, b, b))
        blocks = jnp.concatenate([identity, upper, upper.mT])

        to_scaled = times(G, K.diagonal)  # G⁻ᵀ
        P, coarse_turns = interpolation.prolongation(turns, to_scaled)
        shares = interpolation.shares().astype(dtype).reshape(-1, 1, 1)
        level = cls(
            G=G,
            smoother=Smoother.prepare(coarsening.operator.fill(blocks), n * b, dtype, degree),
            P=coarsening.prolongation.fill(P),
            R=coarsening.restriction.fill(P, transposed=True),
            masses=masses,
        )
        coarse_masses = coarsening.restriction.fill(shares)(masses[:, None])[:, 0]
        return level, coarsening.coarse_operator(blocks, P), coarse_turns, coarse_masses


class _VCycle(AbstractApproximateInverse):
    """(A + sB)⁻¹, nearly."""

    levels: tuple[_Level, ...]
    direct: Direct
    nested_steps: int = eqx.field(static=True)

    def apply(self, block: Float[Array, "n k"]) -> Float[Array, "n k"]:
        inside = self.direct.values.dtype
        return self._cycle(0, block.astype(inside)).astype(block.dtype)

    def _cycle(self, depth: int, r: Float[Array, "n k"]) -> Float[Array, "n k"]:
        if depth == len(self.levels):
            return self.direct.solve(r)
        level = self.levels[depth]
        x = level.smoother.around(
            apply_blocks(level.G, r), lambda left: level.P(self._cycle(depth + 1, level.R(left)))
        )
        return apply_blocks(level.G.mT, x)

    def starting_vectors(self, count: int) -> Float[Array, "n _"]:
        """The coarsest level's lowest eigenvectors, smoothed on each level on the way up; fewer than `count` if it is small.

        Interpolation errs in the upper part of the spectrum, which smoothing mends, and mixes low eigenvectors with the next
        ones, which a Ritz step among more vectors than wanted undoes.
        """
        wide = count + count // 2
        values, x = self.direct.lowest(wide)
        for depth in reversed(range(len(self.levels))):
            level = self.levels[depth]
            x = level.P(x)
            if depth > 0:
                x = self._smoothed(level, values, x)
            if depth == 1:
                x = _ritz_vectors(x, level.smoother.K(x), level.mass(x))[:, :count]
            x = apply_blocks(level.G.mT, x)
        return x[:, :count]

    def _smoothed(
        self, level: _Level, values: Float[Array, " k"], x: Float[Array, "n k"]
    ) -> Float[Array, "n k"]:
        """Some steps of inverse iteration, K x_new = μ M x, with a smoother for K⁻¹; scaled unknowns.

        The values μ need not be those of this level: they change little but the length of the vectors.
        """

        def step(_: Array, x: Float[Array, "n k"]) -> Float[Array, "n k"]:
            return level.smoother.from_guess(values[None, :] * level.mass(x), x)

        return jax.lax.fori_loop(0, self.nested_steps, step, x)


def _ritz_vectors(
    basis: Float[Array, "n w"], K_basis: Float[Array, "n w"], M_basis: Float[Array, "n w"]
) -> Float[Array, "n w"]:
    """Those of K x = μ M x in the span of the basis, ascending; zero behind its rank."""
    gram = basis.T @ M_basis
    scale = inverse_roots(gram.diagonal())
    Q, kept, _ = whitening(scaled(gram, scale), rounding(basis, len(scale)))
    Q = scale[:, None] * Q
    _, C = ritz_pairs(Q.T @ (basis.T @ K_basis) @ Q, kept)
    return basis @ (Q @ C)
