"""Checks of what callers pass: one wording for one mistake, "NAME must be …, got …".

Each returns the argument as the type that the caller of the check goes on with.
"""

import math
import operator
from collections.abc import Iterable, Sequence
from typing import Any, SupportsFloat, TypeAlias

import numpy as np

Integer: TypeAlias = int | np.integer
Real: TypeAlias = float | int | np.floating | np.integer


def checked_integer(
    name: str, value: Any, at_least: int = 1, at_most: int | None = None, *, limit: str = ""
) -> int:
    """`value` as an `int`: Python's, NumPy's and JAX's integers are integers; `True` and `3.0` are not.

    Args:
        at_least, at_most: what is allowed; both are.
        limit: what `at_most` is, as "the number of unknowns".

    Raises:
        ValueError: it is not.
    """
    try:
        number = None if isinstance(value, bool | np.bool_) else operator.index(value)
    except TypeError:
        number = None
    if number is None or number < at_least or (at_most is not None and number > at_most):
        most = f"between {at_least} and {limit + ' ' if limit else ''}{at_most}"
        allowed = f"of at least {at_least}" if at_most is None else most
        raise ValueError(f"{name} must be an integer {allowed}, got {_shown(value)}")
    return number


def checked_positive(name: str, value: Any, *, finite: bool = True) -> float:
    """`value` as a `float`; a finite number above zero, or where infinity makes sense that too.

    Raises:
        ValueError: it is not.
    """
    number = _number(value)
    if not (number > 0 and (math.isfinite(number) or not finite)):
        raise ValueError(f"{name} must be positive{' and finite' if finite else ''}, got {_shown(value)}")
    return number


def checked_not_negative(name: str, value: Any) -> float:
    """`value` as a `float`; a finite number, zero or above.

    Raises:
        ValueError: it is not.
    """
    number = _number(value)
    if not (number >= 0 and math.isfinite(number)):
        raise ValueError(f"{name} must be finite and at least 0, got {_shown(value)}")
    return number


def checked_finite(name: str, value: Any) -> float:
    """`value` as a `float`; a finite number.

    Raises:
        ValueError: it is not.
    """
    number = _number(value)
    if not math.isfinite(number):
        raise ValueError(f"{name} must be a finite number, got {_shown(value)}")
    return number


def checked_choice(name: str, value: Any, choices: Iterable[str]) -> str:
    """`value`, one of the words that are allowed.

    Raises:
        ValueError: it is not.
    """
    choices = tuple(choices)
    if not (isinstance(value, str) and value in choices):
        *most, last = (repr(choice) for choice in choices)
        raise ValueError(f"{name} must be {', '.join(most)} or {last}, got {_shown(value)}")
    return value


def check_shape(name: str, array: Any, shape: Sequence[int | str], each: str = "") -> None:
    """Whether an array has a shape; a word in place of a number, as "any", allows every length.

    Args:
        each: what a row belongs to, as "one a vertex".

    Raises:
        ValueError: it has another.
    """
    got = np.shape(array)
    if len(got) != len(shape) or any(n != m for n, m in zip(got, shape, strict=True) if isinstance(m, int)):
        wanted = ", ".join(map(str, shape))
        raise ValueError(f"{name} must have shape [{wanted}]{', ' + each if each else ''}, got {list(got)}")


def _number(value: Any) -> float:
    """NaN, which no comparison accepts, for what is no number."""
    is_number = isinstance(value, SupportsFloat) and not isinstance(value, bool | np.bool_)
    scalar = getattr(value, "ndim", 0) == 0
    return float(value) if is_number and scalar else math.nan


def _shown(value: Any) -> str:
    """NumPy's numbers as their digits, everything else as Python shows it."""
    return str(value) if isinstance(value, np.number) else repr(value)
