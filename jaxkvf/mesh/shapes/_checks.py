"""Checks of radii that say what was given and what is allowed."""

import math

from ...arguments import Real


def check_radii(name: str, value: tuple[Real, ...], n: int) -> None:
    """Raises `ValueError` unless `value` has `n` entries, all positive and finite."""
    if len(value) != n or not all(math.isfinite(radius) and radius > 0 for radius in value):
        raise ValueError(f"{name} must be {n} positive and finite numbers, got {value!r}")


def check_ascending(low_name: str, low: Real, high_name: str, high: Real) -> None:
    """Raises `ValueError` unless 0 < `low` < `high`, both finite."""
    if not (math.isfinite(high) and 0 < low < high):
        raise ValueError(f"0 < {low_name} < {high_name} must hold, got {low!r} and {high!r}")
