"""Small dense algebra of subspace methods: orthonormal bases in a metric B, and Rayleigh–Ritz in them, for any rank.

Shapes stay static: basis vectors that rank loss takes away become zero columns, and are marked as not kept.

References: A. Stathopoulos, K. Wu, A block orthogonalization procedure with constant synchronization requirements (2002) for
SVQB; U. Hetmaniuk, R. Lehoucq, Basis selection in LOBPCG (2006).
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..sparse import BlockProduct


def orthonormalised(
    B: BlockProduct, S: Float[Array, "n w"], project: Callable[[Array], Array] = lambda block: block
) -> tuple[Float[Array, "n w"], Float[Array, "n w"], Bool[Array, " w"], Bool[Array, ""]]:
    """A B-orthonormal basis Q of span S by SVQB, twice where once is not enough.

    Args:
        B: product with the metric.
        S: any columns; zeros, repeated and dependent ones too.
        project: applied to S each time.

    Returns:
        Q; BQ; which columns of Q are kept; whether B was seen not to be positive semi-definite.
    """
    width = S.shape[1]

    def once(carry: tuple[Array, ...]) -> tuple[Array, ...]:
        S, _, _, negative, passes, _ = carry
        S = project(S)
        BS = B(S)
        gram = S.T @ BS
        scale = inverse_roots(gram.diagonal())
        least = jnp.where(
            passes == 0, rounding(S, width), 0.1
        )  # at the second time, less is nothing but rounding
        C, kept, eigenvalues = whitening(scaled(gram, scale), least)
        C = scale[:, None] * C
        sizes = [(scale * jnp.linalg.norm(block, axis=0)).max() for block in (S, BS)]
        noise = rounding(S, width) * jnp.maximum(1, sizes[0] * sizes[1])
        negative |= negative_energies(gram.diagonal(), S, BS) | (eigenvalues < -noise).any()
        rough = (kept & (eigenvalues < 0.1)).any()
        return S @ C, BS @ C, kept, negative, passes + 1, rough

    start = (S, jnp.zeros_like(S), jnp.zeros(width, bool), jnp.bool_(False), jnp.int32(0), jnp.bool_(True))
    Q, BQ, kept, negative, *_ = jax.lax.while_loop(lambda carry: carry[-1] & (carry[-2] < 2), once, start)
    return Q, BQ, kept, negative


def whitening(
    gram: Float[Array, "w w"], least: float | Float[Array, ""]
) -> tuple[Float[Array, "w w"], Bool[Array, " w"], Float[Array, " w"]]:
    """C with Cᵀ gram C = I on the eigenvectors with eigenvalues above `least`, 0 on the others; which; all eigenvalues."""
    eigenvalues, Q = jnp.linalg.eigh(gram)
    kept = eigenvalues > least
    return Q * jnp.where(kept, inverse_roots(eigenvalues), 0)[None, :], kept, eigenvalues


def ritz_pairs(
    H: Float[Array, "w w"], kept: Bool[Array, " w"]
) -> tuple[Float[Array, " w"], Float[Array, "w w"]]:
    """Eigenpairs of H on the coordinates kept, ascending; then, for the others, zero vectors with larger values."""
    H = jnp.where(kept[:, None] & kept[None, :], H, 0)
    bound = jnp.abs(H).sum(axis=0).max()
    bound = 2 * jnp.where(bound > 0, bound, 1)
    values, C = jnp.linalg.eigh(H + jnp.diag(jnp.where(kept, 0, bound)))
    inside = jnp.arange(len(kept)) < kept.sum()
    return values, jnp.where(kept[:, None] & inside[None, :], C, 0)


def conjugate_directions(C: Float[Array, "w w"], m: int) -> tuple[Float[Array, "w m"], Bool[Array, " m"]]:
    """Coefficients of the search directions P that led from the first m basis vectors X to the Ritz vectors C[:, :m].

    They span what the new X has outside the old one, are orthonormal, and orthogonal to the new X; which of them are kept.
    """
    new, others = C[:, :m], C[:, m:]
    change = others.T @ new.at[:m].set(0)
    change = change * inverse_roots((change**2).sum(axis=0))[None, :]
    U, singular_values, _ = jnp.linalg.svd(change, full_matrices=False)
    kept = singular_values > rounding(C, m)
    return others @ jnp.where(kept[None, :], U, 0), kept


def combined(
    V: Float[Array, "n v"], C: Float[Array, "v c"], W: Float[Array, "n w"], D: Float[Array, "w c"]
) -> Float[Array, "n c"]:
    """V C + W D, with the second product, of few columns, added to the first in place."""
    return functools.reduce(jnp.add, (W[:, j, None] * D[None, j] for j in range(W.shape[1])), V @ C)


def negative_energies(
    energies: Float[Array, " w"], S: Float[Array, "n w"], BS: Float[Array, "n w"]
) -> Bool[Array, ""]:
    """Whether sᵀBs is negative for a column, by more than rounding."""
    size = jnp.linalg.norm(S, axis=0) * jnp.linalg.norm(BS, axis=0)
    return (energies < -rounding(S, S.shape[1]) * size).any()


def scaled(gram: Float[Array, "w w"], scale: Float[Array, " w"]) -> Float[Array, "w w"]:
    """D gram D with D = diag(scale)."""
    return gram * scale[:, None] * scale[None, :]


def inverse_roots(squares: Float[Array, " w"]) -> Float[Array, " w"]:
    """1/√x, and 0 where x ≤ 0."""
    positive = squares > 0
    return jnp.where(positive, jax.lax.rsqrt(jnp.where(positive, squares, 1)), 0)


def rounding(like: Array, width: int) -> float:
    """Eigenvalues of a scaled Gram matrix of this width are nothing but rounding below this."""
    return 10 * width * float(jnp.finfo(like.dtype).eps)
