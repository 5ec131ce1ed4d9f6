"""One Fourier mode on a surface of revolution: a Legendre–Galerkin eigenproblem along the meridian."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre
from scipy.linalg import eigh
from scipy.special import roots_legendre

from ._meridian import End, Meridian


@dataclass(frozen=True)
class Quadrature:
    """Gauss–Legendre points x in (−1, 1) of the meridian, and the geometry there; `area` sums up ∫ · r ds."""

    x: Float[np.ndarray, " q"]
    area: Float[np.ndarray, " q"]
    r: Float[np.ndarray, " q"]
    slope: Float[np.ndarray, " q"]
    ds_dx: Float[np.ndarray, " q"]


def quadrature(meridian: Meridian, count: int) -> Quadrature:
    """`count` Gauss–Legendre points on the meridian."""
    t0, t1 = meridian.interval
    x, weight = roots_legendre(count)
    t = t0 + (t1 - t0) * (1 + x) / 2
    r, ds_dx = meridian.r(t), meridian.speed(t) * (t1 - t0) / 2
    return Quadrature(x, weight * r * ds_dx, r, meridian.slope(t), ds_dx)


def admissible_fields(ends: tuple[End, End], m: int, degree: int) -> Float[np.ndarray, "n 2 {degree}+1"]:
    """A basis of the polynomial fields (a, b) of mode m with finite energy, as Legendre coefficients.

    Inside, a and b are free: (P_j − P_{j+2}) / √(4j+6), orthonormal in ∫ f'g' dx, vanish at both ends.
    The values a field may have at an end give the rest, times (P₀ ∓ P₁)/2, 1 there and 0 at the other end.
    """
    j = np.arange(degree - 1)
    bubbles = (np.eye(degree + 1)[j] - np.eye(degree + 1)[j + 2]) / np.sqrt(4 * j + 6)[:, None]
    inside = np.einsum("cd, jn -> cjdn", np.eye(2), bubbles).reshape(-1, 2, degree + 1)
    P = np.eye(2, degree + 1)
    if End.SEAM in ends:
        at_ends = [(np.eye(2), P[0])]
    else:
        start, end = (_end_values(what, m, sign) for what, sign in zip(ends, (1, -1), strict=True))
        at_ends = [(start, (P[0] - P[1]) / 2), (end, (P[0] + P[1]) / 2)]
    return np.concatenate([inside, *(values[:, :, None] * shape for values, shape in at_ends)])


def _end_values(end: End, m: int, outward: int) -> Float[np.ndarray, "n 2"]:
    """A basis of the values (a, b) that mode m may take at an end; r' = `outward` there if it is a pole.

    At a pole a field of finite energy is a constant vector, and that is mode 1: cos φ e_s − r' sin φ e_φ.
    """
    if end is End.BOUNDARY:
        return np.eye(2)
    return np.array([[1.0, -outward]]) if m == 1 else np.empty((0, 2))


def mode_eigenpairs(
    fields: Float[np.ndarray, "n 2 N"], nodes: Quadrature, m: int, shift: float
) -> tuple[Float[np.ndarray, " h"], Float[np.ndarray, "h 2 N"]]:
    """Lower half of the spectrum of mode m and its fields, ∫ a² + b² r ds = 1, in the span of `fields`.

    Solved as B x = (λ + shift)⁻¹ (A + shift B) x: rounding then costs small λ nothing.
    """
    P = legendre.legvander(nodes.x, fields.shape[-1] - 1).T
    a, b = np.moveaxis(np.tensordot(fields, P, axes=1), 1, 0)
    derivatives = np.tensordot(legendre.legder(fields, axis=2), P[:-1], axes=1) / nodes.ds_dx
    a_s, b_s = np.moveaxis(derivatives, 1, 0)
    r, slope = nodes.r, nodes.slope

    stretch_along = a_s  # ε_ss
    stretch_across = (m * b + slope * a) / r  # ε_φφ
    shear = b_s - (slope * b + m * a) / r  # 2 ε_sφ

    def gram(*parts: Float[np.ndarray, "n q"]) -> Float[np.ndarray, "n n"]:
        weighted = np.concatenate([part * np.sqrt(nodes.area) for part in parts], axis=1)
        return weighted @ weighted.T

    A = gram(2 * stretch_along, 2 * stretch_across, np.sqrt(2) * shear)
    B = gram(a, b)
    inverse, x = eigh(B, A + shift * B)
    lower = slice(-1, -1 - len(fields) // 2, -1)
    inverse, x = inverse[lower], x[:, lower]
    return 1 / inverse - shift, np.tensordot((x / np.sqrt(inverse)).T, fields, axes=1)
