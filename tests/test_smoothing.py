"""Chebyshev smoothing against the polynomials that it stands for."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxkvf.preconditioning._smoothing import Smoother

EIGENVALUES = np.linspace(0.0, 2.0, 41)
LARGEST = 2.0


def smoother(degree: int) -> Smoother:
    return Smoother(lambda x: EIGENVALUES[:, None] * x, jnp.array(LARGEST), degree)


def fourth_kind(degree: int) -> np.ndarray:
    """W(1 − 2λ/Λ) / (2 degree + 1), where W(cos θ) = sin((degree + ½) θ) / sin(θ/2): what is left of an error."""
    angle = np.arccos(1 - 2 * EIGENVALUES / LARGEST)
    with np.errstate(invalid="ignore"):
        left = np.sin((degree + 0.5) * angle) / np.sin(angle / 2) / (2 * degree + 1)
    return np.where(angle == 0, 1, left)


@pytest.mark.parametrize("degree", [1, 2, 3, 7])
def test_an_error_is_multiplied_by_the_polynomial_of_the_fourth_kind(degree):
    solution, error = np.random.default_rng(0).standard_normal((2, len(EIGENVALUES), 3))
    b, guess = jnp.array(EIGENVALUES[:, None] * solution), jnp.array(solution + error)
    found = smoother(degree).from_guess(b, guess)
    np.testing.assert_allclose(found - solution, fourth_kind(degree)[:, None] * error, atol=1e-13)


@pytest.mark.parametrize("degree", [1, 2, 3, 7])
def test_the_correction_is_given_the_residual_and_smoothed_behind(degree):
    b, correction = np.random.default_rng(0).standard_normal((2, len(EIGENVALUES), 3))
    seen = []

    def correct(residual):
        seen.append(np.asarray(residual))
        return jnp.array(correction)

    found = smoother(degree).around(jnp.array(b), correct)
    left = fourth_kind(degree)[:, None]
    np.testing.assert_allclose(seen[0], left * b, atol=1e-13)
    residual = b - EIGENVALUES[:, None] * np.asarray(found)
    np.testing.assert_allclose(residual, left * (left * b - EIGENVALUES[:, None] * correction), atol=1e-12)
