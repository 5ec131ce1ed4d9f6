"""The meridian of a surface of revolution: radius, slope and speed along it, and what its two ends are."""

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import chebpts1
from numpy.typing import ArrayLike
from scipy.fft import dct
from scipy.integrate import trapezoid

Profile: TypeAlias = Callable[[np.ndarray], ArrayLike]

# An end with r below the first lies on the axis, above the second off it; what is in between is refused.
POLE_RADIUS, BOUNDARY_RADIUS = 1e-12, 1e-4  # in largest radii
# The same for the gap between two ends off the axis: they are one circle, or two.
SEAM_GAP, OPEN_GAP = 1e-12, 1e-4  # in lengths of the meridian
RIGHT_ANGLE = 1e-10  # how far |dr/ds| may be from 1 where the meridian meets the axis
SLOWEST_SPEED = 1e-8  # in largest speeds
FINEST_DEGREE = 512  # of the Chebyshev series; rounding, degree² ε, takes over soon after


class End(enum.Enum):
    """What the surface does where its meridian ends."""

    POLE = "pole"
    BOUNDARY = "boundary circle"
    SEAM = "seam"


@dataclass(frozen=True)
class Meridian:
    """A curve (r(t), z(t)), t in `interval`, and its derivatives in t as Chebyshev series of one degree."""

    r: Callable[[np.ndarray], np.ndarray]
    z: Callable[[np.ndarray], np.ndarray]
    r_t: Chebyshev
    z_t: Chebyshev
    interval: tuple[float, float]

    @property
    def nodes(self) -> Float[np.ndarray, " n"]:
        """Parameters that resolve the curve, ascending; the first and the last are its ends."""
        t0, t1 = self.interval
        return np.concatenate([[t0], t0 + (t1 - t0) * (1 + chebpts1(self.r_t.degree() + 2)) / 2, [t1]])

    @property
    def largest_radius(self) -> float:
        return float(np.max(self.r(self.nodes)))

    @property
    def length(self) -> float:
        """Arc length, to the trapezoidal rule's accuracy: a scale."""
        return float(trapezoid(self.speed(self.nodes), self.nodes))

    def speed(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """ds/dt."""
        return np.hypot(self.r_t(t), self.z_t(t))

    def slope(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """r' = dr/ds."""
        return self.r_t(t) / self.speed(t)

    def gaussian_curvature(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """κ = −r''/r, off the axis."""
        r_t, z_t, r_tt, z_tt = self.r_t(t), self.z_t(t), self.r_t.deriv()(t), self.z_t.deriv()(t)
        return z_t * (r_t * z_tt - r_tt * z_t) / self.speed(t) ** 4 / self.r(t)


def resolve_meridian(r: object, z: object, interval: tuple[float, float], rtol: float) -> Meridian:
    """The meridian, sampled until its tangent is known to `rtol`; `ValueError` where it is not regular."""
    t0, t1 = interval
    if not (np.isfinite(t0) and np.isfinite(t1) and t0 < t1):
        raise ValueError(f"interval must be finite and ascending, got ({t0}, {t1})")
    r, z = _checked_profile("r", r), _checked_profile("z", z)

    def interpolated(degree: int) -> Meridian:
        r_t, z_t = (_interpolant(f, degree, (t0, t1)).deriv() for f in (r, z))
        return Meridian(r, z, r_t, z_t, (t0, t1))

    coarse, degree, error = interpolated(16), 32, np.inf
    t = coarse.nodes
    if np.ptp(r(t)) + np.ptp(z(t)) <= SLOWEST_SPEED * np.max(r(t)):
        raise ValueError(f"the meridian is a point: r and z are constant, {r(t)[0]} and {z(t)[0]}")
    while degree <= FINEST_DEGREE:
        fine = interpolated(degree)
        t = fine.nodes
        error = np.max(np.hypot(fine.r_t(t) - coarse.r_t(t), fine.z_t(t) - coarse.z_t(t)))
        if error <= rtol * np.max(fine.speed(t)):
            _check_regular(fine)
            return fine
        coarse, degree = fine, 2 * degree
    raise ValueError(
        f"the meridian is not smooth enough: {FINEST_DEGREE} samples give its tangent to a relative "
        f"{error / np.max(coarse.speed(coarse.nodes)):.1e} only, and rtol = {rtol:.1e} is wanted; "
        "give r and z as smooth functions in float64, or raise rtol"
    )


def meridian_ends(meridian: Meridian) -> tuple[End, End]:
    """What each end is, by the rule in `surface_of_revolution_modes`; `ValueError` where it is none."""
    t = np.array(meridian.interval)
    r, z = meridian.r(t), meridian.z(t)
    on_axis = r <= POLE_RADIUS * meridian.largest_radius
    for i in np.flatnonzero(~on_axis & (r < BOUNDARY_RADIUS * meridian.largest_radius)):
        raise ValueError(
            f"r = {r[i]:.3e} at the meridian's end t = {t[i]} is too large for a pole and too small for a "
            "boundary circle; end the interval exactly where r = 0, or farther away from the axis"
        )
    for i in np.flatnonzero(on_axis & (np.abs(np.abs(meridian.slope(t)) - 1) > RIGHT_ANGLE)):
        raise ValueError(
            f"the meridian meets the axis at t = {t[i]} with dr/ds = {meridian.slope(t)[i]:.6f}, not ±1: "
            "a conical tip; round it, or cut it off (an end with r > 0 is a boundary circle)"
        )
    if not on_axis.any():
        gap = np.hypot(r[1] - r[0], z[1] - z[0]) / meridian.length
        if gap <= SEAM_GAP:
            return End.SEAM, End.SEAM
        if gap < OPEN_GAP:
            raise ValueError(
                f"the meridian's ends, t = {t[0]} and t = {t[1]}, are {gap:.1e} of its length apart: too far "
                "for a closed curve, too close for two boundary circles; make them meet, or move them apart"
            )
    start, end = (End.POLE if pole else End.BOUNDARY for pole in on_axis)
    return start, end


def _checked_profile(name: str, profile: object) -> Callable[[np.ndarray], np.ndarray]:
    """`profile` as a function to finite float64 arrays; what it returns is checked whenever it is called."""
    if not callable(profile):
        raise ValueError(f"{name} must be a function of the meridian's parameter, got {profile!r}")

    def checked(t: np.ndarray) -> np.ndarray:
        values = np.asarray(profile(t))
        if values.dtype.kind not in "iuf" or (values.dtype.kind == "f" and values.dtype.itemsize < 8):
            raise ValueError(f"{name}(t) must be float64, got {values.dtype} (in JAX, set JAX_ENABLE_X64)")
        if values.shape not in ((), t.shape):
            raise ValueError(
                f"{name}(t) must be vectorised: {values.shape} came back for t of shape {t.shape}"
            )
        values = np.broadcast_to(values.astype(np.float64), t.shape)
        for i in np.flatnonzero(~np.isfinite(values))[:1]:
            raise ValueError(f"{name}(t) is not finite at t = {t[i]}: {values[i]}")
        return values

    return checked


def _interpolant(
    f: Callable[[np.ndarray], np.ndarray], degree: int, interval: tuple[float, float]
) -> Chebyshev:
    """Chebyshev interpolant of f by a cosine transform (`Chebyshev.interpolate` loses degree² ε)."""
    t0, t1 = interval
    x = chebpts1(degree + 1)[::-1]
    coefficients = np.asarray(dct(f(t0 + (t1 - t0) * (1 + x) / 2), type=2)) / (degree + 1)
    coefficients[0] /= 2
    return Chebyshev(coefficients, domain=interval)


def _roots(series: Chebyshev) -> Float[np.ndarray, " n"]:
    """Real roots inside the domain."""
    t0, t1 = series.domain
    t = series.trim(1e-13 * np.max(np.abs(series.coef))).roots()
    t = t[np.abs(t.imag) < 1e-6 * (t1 - t0)].real
    return t[(t0 < t) & (t < t1)]


def _check_regular(meridian: Meridian) -> None:
    """`ValueError` unless r > 0 between the ends, r ≥ 0 at them, and ds/dt > 0 everywhere."""
    t = np.append(meridian.nodes, _roots(meridian.r_t))
    r = meridian.r(t)
    lowest = np.where(np.isin(t, meridian.interval), -1.0, 1.0) * POLE_RADIUS * np.max(r)
    for i in np.flatnonzero(r < lowest)[:1]:
        raise ValueError(
            f"r = {r[i]:.3e} at t = {t[i]}: the meridian must stay off the axis, r > 0, between its ends"
        )
    t = np.append(meridian.nodes, _roots((meridian.r_t**2 + meridian.z_t**2).deriv()))
    speed = meridian.speed(t)
    for i in np.flatnonzero(speed <= SLOWEST_SPEED * np.max(speed))[:1]:
        raise ValueError(f"the meridian stands still at t = {t[i]}: dr/dt and dz/dt must not vanish together")
