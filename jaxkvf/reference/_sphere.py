"""The round sphere, the one closed surface whose whole spectrum is a formula."""

from math import isqrt

import numpy as np
from jaxtyping import Float

from ..arguments import Integer, checked_integer, checked_positive


def sphere_spectrum(k: Integer, radius: float = 1.0) -> Float[np.ndarray, " {k}"]:
    """First `k` eigenvalues of the Killing energy on the round sphere, repeated by multiplicity.

    With λₙ = n(n+1), n ≥ 1, the Laplace eigenvalues and 2n+1 their multiplicity, rotated gradients of
    spherical harmonics have 2λₙ − 4 (n = 1: the three rotations, 0) and gradients have 4λₙ − 4.

    Args:
        k: number of eigenvalues; it may cut through a multiple one.
        radius: of the sphere; eigenvalues scale with radius⁻².

    Returns:
        float64 `[k]`, ascending: 0 (×3), 4 (×3), 8 (×5), 20 (×12), … over radius².

    Raises:
        ValueError: `k` is no positive integer, or `radius` is not finite and above zero.

    Source: Ben-Chen, Butscher, Solomon and Guibas 2010, appendix B; λ = ∫‖KU‖² / ∫|U|², KU = J + Jᵀ.
    """
    k, radius = checked_integer("k", k), checked_positive("radius", radius)
    n = np.arange(1, isqrt(k) + 2)  # Σ (2n+1) over them is above k, and what is left out lies higher
    rotated_gradients = np.repeat(2 * n * (n + 1) - 4, 2 * n + 1)
    gradients = np.repeat(4 * n * (n + 1) - 4, 2 * n + 1)
    return np.sort(np.concatenate([rotated_gradients, gradients]))[:k] / radius**2
