"""The reference spectra against formulas, special functions and a second discretization."""

import inspect
from collections.abc import Callable
from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import jv, jvp
from threadpoolctl import threadpool_limits

from jaxkvf.reference import (
    RevolutionModes,
    sphere_spectrum,
    surface_of_revolution_modes,
    surface_of_revolution_spectrum,
)

spectrum = surface_of_revolution_spectrum


def flat(t):
    return 0.0 * t


def pear_radius(t):
    return np.sin(t) * (1 + 0.3 * np.cos(t))


def pear_height(t):
    return 1.3 * np.cos(t)


@cache
def pear() -> RevolutionModes:
    """A closed surface without any symmetry but that about its axis."""
    return surface_of_revolution_modes(pear_radius, pear_height, 12)


def torus_radius(t):
    return 2 + np.cos(t)


def roots(f: Callable[[np.ndarray], np.ndarray], highest: float) -> list[float]:
    """Where f changes sign in (0, highest)."""
    grid = np.arange(0.02, highest, 0.02)
    brackets = np.flatnonzero(np.diff(np.sign(f(grid))))
    return [brentq(f, grid[i], grid[i + 1], xtol=1e-13) for i in brackets]


# --- the sphere


def test_sphere_spectrum_has_the_multiplicities_of_spherical_harmonics():
    values, counts = np.unique(sphere_spectrum(50), return_counts=True)
    assert_allclose(values, [0, 4, 8, 20, 36, 44, 56])
    assert counts.tolist() == [3, 3, 5, 7 + 5, 9, 7, 11]


@pytest.mark.parametrize("k", [1, 2, 3, 8, 15, 100])
def test_sphere_spectrum_of_any_length_is_a_prefix(k):
    assert sphere_spectrum(k).tolist() == sphere_spectrum(400)[:k].tolist()


def test_sphere_spectrum_scales_by_radius_to_the_minus_two():
    assert_allclose(sphere_spectrum(30, radius=2.5), sphere_spectrum(30) / 2.5**2, rtol=1e-15)


def test_meridian_solver_finds_the_sphere_spectrum():
    assert_allclose(spectrum(np.sin, np.cos, 60), sphere_spectrum(60), rtol=1e-11, atol=1e-11)


def test_fourier_modes_of_the_sphere():
    modes = surface_of_revolution_modes(np.sin, np.cos, 11).fourier_modes
    # vector spherical harmonics of degree 1, 1 and 2
    assert sorted(modes[:3]) == sorted(modes[3:6]) == [0, 1, 1]
    assert sorted(modes[6:]) == [0, 1, 1, 2, 2]


# --- surfaces of revolution against other computations


@pytest.mark.parametrize(
    ("height", "expected"),
    [
        (1.6, [0, *[0.265828542] * 2, 2.117247796, *[2.814862687] * 2, 3.792053008, *[5.454586334] * 2]
            + [8.510528852] * 2 + [10.300796175]),
        (0.5, [0, *[0.526043816] * 2, *[4.721833405] * 2, 7.735414767, *[8.259163645] * 2]),
    ],
)  # fmt: skip
def test_spheroids_agree_with_the_prototype(height, expected):
    found = spectrum(np.sin, lambda t: height * np.cos(t), len(expected))
    assert_allclose(found, expected, rtol=0, atol=6e-10)


def test_free_cylinder_is_a_rayleigh_lamb_plate():
    """Radius R, length 2h: a plate of Lamé constants 0 and 2 whose waves have the wavenumber m/R."""
    R, h, highest = 1.3, 1.0, 25.0

    def characteristic(m: int, lam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k = m / R
        p, q = np.sqrt(lam / 4 - k**2 + 0j), np.sqrt(lam / 2 - k**2 + 0j)
        symmetric = (k**2 - q**2) ** 2 * np.cos(p * h) * np.sinc(q * h / np.pi) * h
        symmetric += 4 * k**2 * p * np.sin(p * h) * np.cos(q * h)
        antisymmetric = (k**2 - q**2) ** 2 * np.cos(q * h) * np.sinc(p * h / np.pi) * h
        antisymmetric += 4 * k**2 * q * np.cos(p * h) * np.sin(q * h)
        return symmetric.real, antisymmetric.real

    n = np.arange(9)
    expected = [*(4 * (n * np.pi / (2 * h)) ** 2), *(2 * (n * np.pi / (2 * h)) ** 2)]  # m = 0: a, b
    for m in range(1, 9):
        for parity in (0, 1):
            expected += 2 * roots(lambda lam, m=m, parity=parity: characteristic(m, lam)[parity], highest)
    expected = np.sort([lam for lam in expected if lam < highest])
    found = spectrum(lambda t: R, lambda t: t, len(expected) + 1, interval=(-h, h))
    assert_allclose(found[:-1], expected, rtol=1e-10, atol=1e-10)
    assert found[-1] > highest
    assert np.count_nonzero(expected == 0) == 2


def test_free_disk_has_bessel_functions_for_fields():
    """U = ∇ J_m(pr) cos mφ + J∇ J_m(qr) sin mφ with λ = 4p² = 2q², and no stress on the rim r = 1."""
    highest = 70.0

    def stress(m: int, lam: np.ndarray) -> np.ndarray:
        p, q = np.sqrt(lam / 4), np.sqrt(lam / 2)
        radial = [p**2 * jvp(m, p, 2), m * (q * jvp(m, q) - jv(m, q))]
        shear = [
            -2 * m * (p * jvp(m, p) - jv(m, p)),
            -(m**2) * jv(m, q) - q**2 * jvp(m, q, 2) + q * jvp(m, q),
        ]
        return radial[0] * shear[1] - radial[1] * shear[0]

    expected = [0.0] * 3 + roots(lambda lam: stress(0, lam), highest)
    for m in range(1, 9):
        expected += 2 * roots(lambda lam, m=m: stress(m, lam), highest)
    found = spectrum(lambda t: t, flat, len(expected) + 1, interval=(0.0, 1.0))
    assert_allclose(found[:-1], np.sort(expected), rtol=1e-10, atol=1e-10)
    assert found[-1] > highest


@pytest.mark.parametrize(
    ("r", "r_t", "rtol"),
    [
        (torus_radius, lambda t: -np.sin(t), 1e-10),
        # where the ends meet there is a corner: trigonometric polynomials converge to it slowly
        (lambda t: 2 + np.sin(t / 2), lambda t: np.cos(t / 2) / 2, 2e-3),
    ],
)
def test_torus_agrees_with_trigonometric_polynomials(r, r_t, rtol):
    n, interval = 512, (0.0, 2 * np.pi)
    t = 2 * np.pi * (np.arange(n) + 0.5) / n
    j = np.arange(1, 30)[:, None]
    f = np.concatenate([np.ones((1, n)), np.cos(j * t), np.sin(j * t)])
    f_t = np.concatenate([np.zeros((1, n)), -j * np.sin(j * t), j * np.cos(j * t)])
    speed = np.hypot(r_t(t), np.cos(t))
    radius, slope, zero = r(t), r_t(t) / speed, np.zeros_like(f)
    a, b = np.concatenate([f, zero]), np.concatenate([zero, f])
    a_s, b_s = np.concatenate([f_t, zero]) / speed, np.concatenate([zero, f_t]) / speed
    dA = radius * speed

    def eigenvalues(m: int) -> np.ndarray:
        across = (m * b + slope * a) / radius
        shear = b_s - (slope * b + m * a) / radius
        A = (4 * a_s * dA) @ a_s.T + (4 * across * dA) @ across.T + (2 * shear * dA) @ shear.T
        return eigh(A, (a * dA) @ a.T + (b * dA) @ b.T, eigvals_only=True)

    with threadpool_limits(1):
        modes = [eigenvalues(m) for m in range(7)]
    expected = np.sort([*modes[0], *np.repeat(modes[1:], 2)])[:24]
    found = spectrum(r, np.sin, 24, interval=interval)
    assert_allclose(found, expected, rtol=rtol, atol=rtol)


@pytest.mark.parametrize(
    ("r", "z", "interval", "zeros"),
    [
        (np.sin, np.cos, (0.5, 2.0), 3),  # band of a sphere
        (np.sin, np.cos, (0.0, 2.0), 3),  # its caps
        (np.sin, np.cos, (1.0, np.pi), 3),
        (lambda t: t, flat, (1.0, 2.0), 3),  # annulus
        (lambda t: t, flat, (0.0, 2.0), 3),  # disk
        (lambda t: 1.0, lambda t: t, (0.0, 2.0), 2),  # cylinder
        (lambda t: t, lambda t: 2 * t, (0.3, 1.0), 1),  # frustum of a cone
        (torus_radius, np.sin, (0.0, 2 * np.pi), 1),
        (pear_radius, pear_height, (0.0, np.pi), 1),
    ],
)
def test_killing_fields_are_counted(r, z, interval, zeros):
    found = spectrum(r, z, 5, interval=interval)
    assert_allclose(found[:zeros], 0, atol=1e-12)
    assert found[zeros] > 0.05


# --- laws


def test_eigenvalues_scale_by_length_to_the_minus_two():
    scaled = spectrum(lambda t: 7.0 * pear_radius(t), lambda t: 7.0 * pear_height(t), 12)
    assert_allclose(scaled, pear().eigenvalues / 49, rtol=1e-10, atol=1e-12)


def test_the_parameter_and_the_direction_of_the_axis_do_not_matter():
    def other(t):  # runs from the end to the start
        return np.pi - t - 0.2 * np.sin(2 * t)

    found = spectrum(lambda t: pear_radius(other(t)), lambda t: 5.0 - pear_height(other(t)), 12)
    assert_allclose(found, pear().eigenvalues, rtol=2e-10, atol=1e-12)


def test_where_a_torus_is_cut_does_not_matter():
    first, second = (spectrum(torus_radius, np.sin, 9, interval=(t, t + 2 * np.pi)) for t in (0.0, 1.0))
    assert_allclose(first, second, rtol=2e-10, atol=1e-12)


def test_more_eigenvalues_do_not_change_the_first():
    # a flat spheroid is strongly curved at its rim: many Fourier modes could still hold a small eigenvalue
    few, many = (spectrum(np.sin, lambda t: 0.3 * np.cos(t), k) for k in (1, 20))
    assert_allclose(few, many[:1], atol=1e-12)
    assert_allclose(pear().eigenvalues, spectrum(pear_radius, pear_height, 50)[:12], rtol=2e-10, atol=1e-12)


def test_a_coarse_tolerance_is_kept():
    coarse = spectrum(pear_radius, pear_height, 12, rtol=1e-3)
    assert_allclose(coarse, pear().eigenvalues, rtol=1e-3, atol=1e-3)


def test_jax_functions_will_do():
    found = spectrum(jnp.sin, lambda t: 1.6 * jnp.cos(t), 3)
    assert_allclose(found, spectrum(np.sin, lambda t: 1.6 * np.cos(t), 3), rtol=1e-12, atol=1e-12)


# --- fields


def test_fields_have_unit_norm_and_their_eigenvalue_as_energy():
    modes = pear()
    x, weight = np.polynomial.legendre.leggauss(200)
    t, weight = np.pi / 2 * (1 + x), np.pi / 2 * weight
    r_t = np.cos(t) + 0.3 * np.cos(2 * t)
    r, speed = pear_radius(t), np.hypot(r_t, 1.3 * np.sin(t))
    for lam, m, a, b in zip(
        modes.eigenvalues, modes.fourier_modes, modes.meridional, modes.azimuthal, strict=True
    ):
        across = (m * b(t) + r_t / speed * a(t)) / r
        shear = b.deriv()(t) / speed - (r_t / speed * b(t) + m * a(t)) / r
        turns = 2 * np.pi if m == 0 else np.pi
        dA = turns * weight * r * speed
        energy = 4 * (a.deriv()(t) / speed) ** 2 + 4 * across**2 + 2 * shear**2
        assert_allclose((a(t) ** 2 + b(t) ** 2) @ dA, 1, rtol=1e-10)
        assert_allclose(energy @ dA, lam, rtol=1e-9, atol=1e-10)


def test_the_killing_field_is_the_rotation():
    modes, t = pear(), np.linspace(0, np.pi, 50)
    a, b = modes.meridional[0](t), modes.azimuthal[0](t)
    assert modes.fourier_modes[0] == 0
    assert_allclose(a, 0, atol=1e-9)
    assert_allclose(b * np.max(pear_radius(t)), b[np.argmax(pear_radius(t))] * pear_radius(t), atol=1e-9)


# --- what is refused


@pytest.mark.parametrize("k", [0, -3, 2.0, "3", True, None])
def test_k_must_be_a_positive_integer(k):
    for function, args in ((sphere_spectrum, ()), (surface_of_revolution_modes, (np.sin, np.cos))):
        with pytest.raises(ValueError, match="k must be an integer of at least 1"):
            inspect.unwrap(function)(*args, k)


@pytest.mark.parametrize("radius", [0.0, -1.0, np.inf, np.nan, "1"])
def test_radius_must_be_positive(radius):
    with pytest.raises(ValueError, match="radius must be positive and finite"):
        inspect.unwrap(sphere_spectrum)(3, radius)


@pytest.mark.parametrize("rtol", [0.0, -1e-3, np.nan])
def test_rtol_must_be_positive(rtol):
    with pytest.raises(ValueError, match="rtol must be"):
        spectrum(np.sin, np.cos, 3, rtol=rtol)


@pytest.mark.parametrize("interval", [(1.0, 1.0), (2.0, 1.0), (0.0, np.inf), (np.nan, 1.0)])
def test_interval_must_be_finite_and_ascending(interval):
    with pytest.raises(ValueError, match="interval must be finite and ascending"):
        spectrum(np.sin, np.cos, 3, interval=interval)


@pytest.mark.parametrize(
    ("r", "z", "interval", "message"),
    [
        (1.0, np.cos, (0.0, 1.0), "r must be a function"),
        (np.sin, None, (0.0, np.pi), "z must be a function"),
        (lambda t: np.where(t > 1, np.nan, 1.0), np.cos, (0.0, 2.0), r"r\(t\) is not finite at t = "),
        (
            np.sin,
            lambda t: np.cos(t).astype(np.float32),
            (0.0, np.pi),
            r"z\(t\) must be float64, got float32",
        ),
        (np.sin, lambda t: np.cos(t) + 0j, (0.0, np.pi), r"z\(t\) must be float64, got complex128"),
        (np.sin, lambda t: np.cos(t)[:-1], (0.0, np.pi), r"z\(t\) must be vectorised"),
        (lambda t: 1 - t, np.cos, (0.0, 2.0), r"r = .* at t = 1\..*: the meridian must stay off the axis"),
        (lambda t: t - 1e-3, flat, (0.0, 2.0), r"r = -1\.000e-03 at t = 0\.0"),
        (lambda t: t**2 + 1, lambda t: t**2, (-1.0, 2.0), r"stands still at t = .*e-\d\d"),
        (lambda t: (t - 0.3) ** 2, lambda t: t, (0.0, 1.0), r"r = .* at t = 0\.(3|29999)"),
        (lambda t: 1.0, lambda t: 1.0, (0.0, 1.0), "the meridian is a point"),
        (
            np.sin,
            np.cos,
            (0.0, 3.14159),
            r"r = 2\.65.e-06 at the meridian's end t = 3\.14159 is too large for a pole",
        ),
        (lambda t: t, lambda t: t, (0.0, 1.0), r"meets the axis at t = 0\.0 with dr/ds = 0\.707107, not ±1"),
        (
            torus_radius,
            np.sin,
            (0.0, 6.2831),
            "too far for a closed curve, too close for two boundary circles",
        ),
        (lambda t: 2 + np.abs(t - 0.3), flat, (0.0, 1.0), "not smooth enough: 512 samples"),
    ],
)
def test_meridians_that_are_none_are_refused(r, z, interval, message):
    with pytest.raises(ValueError, match=message):
        inspect.unwrap(surface_of_revolution_modes)(r, z, 3, interval=interval)


def test_a_spectrum_that_does_not_settle_says_so(monkeypatch):
    monkeypatch.setattr("jaxkvf.reference._revolution.FINEST_DEGREE", 24)
    message = r"still change by a relative .* at polynomial degree 24, and rtol = 1\.0e-10 is wanted; use a"
    with pytest.raises(RuntimeError, match=message):
        spectrum(np.sin, lambda t: 0.2 * np.cos(t), 3)
