"""The spectrum of a surface of revolution, to ten digits, Fourier mode by Fourier mode."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy.polynomial import Legendre
from threadpoolctl import threadpool_limits

from ..arguments import Integer, checked_integer, checked_positive
from ._fourier_mode import admissible_fields, mode_eigenpairs, quadrature
from ._meridian import End, Meridian, Profile, meridian_ends, resolve_meridian

COARSEST_DEGREE, FINEST_DEGREE = 16, 600


@dataclass(frozen=True)
class RevolutionModes:
    """Smallest eigenvalues of the Killing energy on a surface of revolution, and their fields.

    A field is a(t) cos mφ e_s + b(t) sin mφ e_φ, with e_s along the meridian, e_φ across, and ∫|U|² = 1. For
    m ≥ 1 it stands there twice in a row, the second time for its twin a(t) sin mφ e_s − b(t) cos mφ e_φ;
    for m = 0 it is a(t) e_s + b(t) e_φ.
    """

    eigenvalues: Float[np.ndarray, " k"]
    """Ascending; equal ones in no particular order. Length scaling −2."""
    fourier_modes: Int[np.ndarray, " k"]
    """m of each."""
    meridional: tuple[Legendre, ...]
    """a of each, a function of the meridian's parameter."""
    azimuthal: tuple[Legendre, ...]
    """b of each."""


def surface_of_revolution_spectrum(
    r: Profile, z: Profile, k: Integer, *, interval: tuple[float, float] = (0.0, np.pi), rtol: float = 1e-10
) -> Float[np.ndarray, " {k}"]:
    """First `k` eigenvalues of the Killing energy on the surface that (r(t), z(t)) sweeps around the z-axis.

    Arguments and errors are those of `surface_of_revolution_modes`, which also knows the fields.

    Returns:
        float64 `[k]`, ascending, each as often as its multiplicity says; length scaling −2.
    """
    return surface_of_revolution_modes(r, z, k, interval=interval, rtol=rtol).eigenvalues


def surface_of_revolution_modes(
    r: Profile, z: Profile, k: Integer, *, interval: tuple[float, float] = (0.0, np.pi), rtol: float = 1e-10
) -> RevolutionModes:
    """First `k` eigenvalues and eigenfields on the surface that (r(t), z(t)) sweeps around the z-axis.

    Each end of the meridian is one of three:

    - a *pole* if r = 0 (to 1e-12 of the largest r); the meridian must meet the axis at a right angle;
    - a *seam* if r > 0 and the other end is the same point (to 1e-12 of the length): a torus. The meridian
      may have a corner there;
    - a *boundary circle*, left free (natural boundary conditions), if r > 0 (1e-4 of the largest r or more)
      and the other end is elsewhere (by 1e-4 of the length or more).

    Args:
        r: distance from the axis, a function of float64 arrays `[n]` of parameters that returns float64 `[n]`
            (NumPy or JAX) or one number; smooth, and positive inside the interval.
        z: height, likewise, of any sign. It may be constant: flat disks and annuli.
        k: number of eigenvalues; it may cut through a multiple one.
        interval: of the parameter t. (r, z) must move with positive speed all along it.
        rtol: what λ + σ must agree to, relatively, between two polynomial degrees; σ, there for λ = 0, is
            1/max(largest r, length of the meridian)².

    Returns:
        Eigenvalues, their Fourier modes and their fields.

    Raises:
        ValueError: `k`, `rtol`, `interval`, `r` or `z` is not what it must be; r or z is not finite, not
            float64 or not smooth; r ≤ 0 inside; the meridian stands still; an end is none of the three, or a
            conical tip.
        RuntimeError: `rtol` was not reached; the message says what was.

    The energy splits by Fourier mode into ∫ (4ε_ss² + 4ε_φφ² + 2(2ε_sφ)²) r ds over ∫ (a² + b²) r ds with
    ε_ss = a', ε_φφ = (m b + r'a)/r, 2ε_sφ = −m a/r + b' − r'b/r, ' = d/ds. Each mode is a Galerkin problem in
    Legendre polynomials of t, their degree raised until the eigenvalues stand.
    """
    k, rtol = checked_integer("k", k), checked_positive("rtol", rtol)
    meridian = resolve_meridian(r, z, interval, rtol)
    ends = meridian_ends(meridian)
    shift = 1 / max(meridian.largest_radius, meridian.length) ** 2

    degree, change = COARSEST_DEGREE, np.inf
    with threadpool_limits(1, user_api="blas"):  # small matrices: more threads only wait for each other
        coarse = _modes_of_degree(meridian, ends, k, degree, shift)
        while degree < FINEST_DEGREE:
            degree = degree * 3 // 2
            fine = _modes_of_degree(meridian, ends, k, degree, shift)
            change = np.max(np.abs(fine.eigenvalues - coarse.eigenvalues) / (fine.eigenvalues + shift))
            if change <= rtol:
                return fine
            coarse = fine
    raise RuntimeError(
        f"the first {k} eigenvalues still change by a relative {change:.1e} at polynomial degree {degree}, "
        f"and rtol = {rtol:.1e} is wanted; use a smoother meridian, a parameter closer to its arc length, "
        "fewer eigenvalues, or a larger rtol"
    )


def _modes_of_degree(
    meridian: Meridian, ends: tuple[End, End], k: Integer, degree: int, shift: float
) -> RevolutionModes:
    """The `k` smallest eigenpairs among all Fourier modes, in polynomials of one degree."""
    nodes = quadrature(meridian, 2 * degree + meridian.r_t.degree())
    highest_curvature = np.max(meridian.gaussian_curvature(meridian.nodes[1:-1]))

    def floor(m: int) -> float:
        # On a closed surface ∫‖KU‖² = 2∫ |∇U|² + (div U)² − κ|U|² (Bochner), and |∇U| ≥ (m − |r'|)|U|/r.
        return 2 * (m - 1) ** 2 / meridian.largest_radius**2 - 2 * highest_curvature

    found: list[tuple[float, int, np.ndarray]] = []
    m, barren = 0, 0
    while len(found) < k or barren < 2 or floor(m) < found[-1][0]:
        eigenvalues, fields = mode_eigenpairs(admissible_fields(ends, m, degree), nodes, m, shift)
        barren = barren + 1 if len(found) == k and eigenvalues[0] >= found[-1][0] else 0
        norm, copies = (2 * np.pi, 1) if m == 0 else (np.pi, 2)
        found += [
            (eigenvalue, m, field / np.sqrt(norm))
            for eigenvalue, field in zip(eigenvalues, fields, strict=True)
            for _ in range(copies)
        ]
        found = sorted(found, key=lambda pair: pair[0])[:k]
        m += 1
    eigenvalues, modes, fields = zip(*found, strict=True)
    meridional, azimuthal = (
        tuple(Legendre(field[part], domain=meridian.interval) for field in fields) for part in (0, 1)
    )
    return RevolutionModes(np.array(eigenvalues), np.array(modes), meridional, azimuthal)
