"""Checks of arguments that say what was given and what is allowed."""

import math
import operator

Real = float | int


def check_count(name: str, value: int, at_least: int) -> None:
    """Raises `ValueError` unless `value` is an integer and large enough."""
    try:
        large_enough = operator.index(value) >= at_least
    except TypeError:
        large_enough = False
    if not large_enough:
        raise ValueError(f"{name} must be an integer of at least {at_least}, got {value!r}")


def check_positive(name: str, value: Real) -> None:
    """Raises `ValueError` unless `value` is positive and finite."""
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be positive and finite, got {value!r}")


def check_radii(name: str, value: tuple[Real, ...], n: int) -> None:
    """Raises `ValueError` unless `value` has `n` entries, all positive and finite."""
    if len(value) != n or not all(math.isfinite(radius) and radius > 0 for radius in value):
        raise ValueError(f"{name} must be {n} positive and finite numbers, got {value!r}")


def check_ascending(low_name: str, low: Real, high_name: str, high: Real) -> None:
    """Raises `ValueError` unless 0 < `low` < `high`, both finite."""
    if not (math.isfinite(high) and 0 < low < high):
        raise ValueError(f"0 < {low_name} < {high_name} must hold, got {low!r} and {high!r}")
