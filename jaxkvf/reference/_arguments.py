"""Checks of the scalar arguments that the reference spectra share."""

import operator
from typing import SupportsIndex

import numpy as np


def checked_count(k: object) -> int:
    """`k`, a number of eigenvalues, as an `int`; `ValueError` unless it is a positive integer."""
    if not isinstance(k, SupportsIndex) or isinstance(k, bool):
        raise ValueError(f"k, the number of eigenvalues, must be an integer; got {k!r}")
    count = operator.index(k)
    if count <= 0:
        raise ValueError(f"k, the number of eigenvalues, must be at least 1; got {count}")
    return count


def checked_positive(name: str, value: object) -> float:
    """`value` as a `float`; `ValueError` unless it is a finite number above zero."""
    if not isinstance(value, int | float | np.number) or not 0.0 < value < np.inf:
        raise ValueError(f"{name} must be a finite number above zero; got {value!r}")
    return float(value)
