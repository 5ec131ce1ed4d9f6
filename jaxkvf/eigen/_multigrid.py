"""Multigrid: an approximate inverse whose quality does not depend on size.

References: A. Brandt, Algebraic multigrid theory (1986); J. Lottes, Optimal polynomial smoothers for multigrid V-cycles (2023);
U. Trottenberg, C. Oosterlee, A. Schüller, Multigrid (2001), §2.6 for nested iteration.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float

from ..sparse import SymmetricBlockOperator
from ._coarsening import Coarsening
from ._jacobi import _apply_blocks, _inverse_factors
from ._layouts import RowProduct
from ._preconditioner import AbstractApproximateInverse, AbstractPreconditioner
from ._problem import GeneralizedEigenproblem
from ._residual import spectral_norm


class Multigrid(AbstractPreconditioner):
    """One V-cycle for A + sB, symmetric and positive definite, from a hierarchy of ever coarser graphs.

    Coarse operators are Galerkin products PᵀKP, smoothing is by Chebyshev polynomials over block Jacobi, the coarsest problem
    is solved directly. All numbers but the interpolation weights come from the problem, so the same `Multigrid` serves while
    its entries change. A and B must be `SymmetricBlockOperator`s on the graph that the hierarchy was built for, A positive
    semi-definite and each off-diagonal block of B a positive multiple of the rotation that carries components from column to
    row frame, as in mass matrices with transport along edges (of +1, for scalars).
    """

    hierarchy: tuple[Coarsening, ...]
    """From fine to coarse; empty for a direct solve."""
    degree: int = eqx.field(default=3, static=True)
    """Of the smoother, from 1 to 6: products with the operator before and after each coarse correction."""
    dtype: str | None = eqx.field(default=None, static=True)
    """Precision inside: `"float32"` halves memory and does not slow LOBPCG in float64 down. By default the problem's."""
    nested_steps: int = eqx.field(default=2, static=True)
    """Improvements of the starting vectors on each level but the finest."""

    def __check_init__(self) -> None:
        if self.degree not in range(1, len(_SMOOTHERS) + 1):
            raise ValueError(f"degree must be from 1 to {len(_SMOOTHERS)}, got {self.degree}")
        if self.dtype not in (None, "float32", "float64"):
            raise ValueError(f"dtype must be None, 'float32' or 'float64', got {self.dtype!r}")
        if self.nested_steps < 0:
            raise ValueError(f"nested_steps must not be negative, got {self.nested_steps}")

    def prepare(self, problem: GeneralizedEigenproblem) -> "_VCycle":
        """The cycle for this problem.

        Raises:
            ValueError: the problem is not on the hierarchy's graph, or A or B is no `SymmetricBlockOperator`.
        """
        A, B = _bare(problem.A), _bare(problem.B)
        if not (isinstance(A, SymmetricBlockOperator) and isinstance(B, SymmetricBlockOperator)):
            raise ValueError(
                f"Multigrid needs A and B as SymmetricBlockOperator, got {type(A).__name__} and {type(B).__name__}"
            )
        if self.hierarchy:
            graph = self.hierarchy[0].weights.shape[0], self.hierarchy[0].n_edges
            if not graph == (A.diagonal.shape[0], A.upper.shape[0]) == (B.diagonal.shape[0], B.upper.shape[0]):
                raise ValueError(
                    f"the hierarchy was built for {graph[0]} nodes and {graph[1]} edges, but A has "
                    f"{A.diagonal.shape[0]} and {A.upper.shape[0]}, B {B.diagonal.shape[0]} and {B.upper.shape[0]}"
                )
        # The shift is the typical spacing of the spectrum, Σ over all n unknowns replacing n times a typical term.
        a, b = (M.diagonal.diagonal(axis1=1, axis2=2) for M in (A, B))
        shift = 1 / jnp.where(a > 0, b / jnp.where(a > 0, a, 1), 0).sum()
        dtype = jnp.dtype(self.dtype or problem.dtype)
        K = SymmetricBlockOperator(
            (A.diagonal + shift * B.diagonal).astype(dtype), (A.upper + shift * B.upper).astype(dtype), A.edges
        )
        size = jnp.linalg.norm(B.upper, axis=(1, 2)) / B.block_size**0.5
        turns = (B.upper / size[:, None, None]).astype(dtype)
        masses = b.mean(axis=1).astype(dtype)

        levels, scaling = [], None
        pending = None  # the prolongation to the level above, until its columns are scaled
        for coarsening in self.hierarchy:
            # In unknowns scaled by G, GᵀG the inverse of the diagonal blocks, block Jacobi is the identity.
            G = _inverse_factors(K.diagonal)
            to_scaled = _product(G, K.diagonal)  # G⁻ᵀ
            if pending is None:
                scaling = G
            else:
                levels.append(pending(G))
            K, pending, turns, masses = _level(coarsening, K, G, to_scaled, turns, masses, self.degree)
        if pending is not None:
            levels.append(pending(None))
        ...
