"""One set of argument checks, and one place for packages that may be missing."""

import math
import sys
import tomllib
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxkvf import extras
from jaxkvf.arguments import (
    check_shape,
    checked_choice,
    checked_finite,
    checked_integer,
    checked_not_negative,
    checked_positive,
)


@pytest.mark.parametrize("three", [3, np.int64(3), np.uint8(3), np.array(3), jnp.asarray(3)])
def test_integers_of_python_numpy_and_jax_are_integers(three):
    found = checked_integer("k", three, 1, 3)
    assert found == 3 and type(found) is int


@pytest.mark.parametrize(
    "wrong", [True, np.True_, 3.0, np.float64(3), "3", None, np.array([3]), 0, -1, np.int64(4)]
)
def test_what_is_no_integer_or_out_of_bounds_is_shown_as_given(wrong):
    with pytest.raises(
        ValueError, match=r"^k must be an integer between 1 and the number of unknowns 3, got "
    ) as caught:
        checked_integer("k", wrong, 1, 3, limit="the number of unknowns")
    shown = str(wrong) if isinstance(wrong, np.number) else repr(wrong)
    assert str(caught.value).endswith(shown)


def test_wording_without_an_upper_bound():
    with pytest.raises(ValueError, match=r"^m must be an integer of at least 2, got 1$"):
        checked_integer("m", 1, 2)
    assert checked_integer("m", 0, 0) == 0


@pytest.mark.parametrize("half", [0.5, np.float32(0.5), np.float64(0.5), np.array(0.5), jnp.asarray(0.5)])
def test_numbers_become_floats(half):
    for check in (checked_positive, checked_not_negative, checked_finite):
        found = check("radius", half)
        assert found == 0.5 and type(found) is float


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf, "1", None, True, np.array([1.0]), 1j])
def test_what_is_no_finite_number_is_refused_by_every_check(wrong):
    for check in (checked_positive, checked_not_negative, checked_finite):
        with pytest.raises(ValueError, match=r"^radius must be .*, got "):
            check("radius", wrong)


def test_signs():
    with pytest.raises(ValueError, match="must be positive and finite, got 0"):
        checked_positive("radius", 0)
    with pytest.raises(ValueError, match=r"must be finite and at least 0, got -0\.1"):
        checked_not_negative("sigma", -0.1)
    assert checked_not_negative("sigma", 0) == 0 and checked_finite("time", -2) == -2
    assert checked_positive("radius", math.inf, finite=False) == math.inf
    with pytest.raises(ValueError, match="must be positive, got nan"):
        checked_positive("radius", math.nan, finite=False)


def test_choices_are_listed():
    assert checked_choice("up", "z", ("x", "y", "z")) == "z"
    for wrong in ("w", None, 1, ["z"]):
        with pytest.raises(ValueError, match=r"^up must be 'x', 'y' or 'z', got "):
            checked_choice("up", wrong, ("x", "y", "z"))


def test_shapes_with_and_without_free_lengths():
    check_shape("guess", np.zeros((4, 7)), (4, "any"))
    check_shape("colors", [[0, 0, 0]], (1, 3))
    with pytest.raises(ValueError, match=r"^guess must have shape \[4, any\], got \[5, 7\]$"):
        check_shape("guess", np.zeros((5, 7)), (4, "any"))
    with pytest.raises(ValueError, match=r"^lengths must have shape \[6\], one an edge, got \[6, 1\]$"):
        check_shape("lengths", jnp.zeros((6, 1)), (6,), "one an edge")


def test_the_extra_that_is_named_brings_the_package():
    content = tomllib.loads(Path(__file__).parents[1].joinpath("pyproject.toml").read_text(encoding="utf-8"))
    offered = content["project"]["optional-dependencies"]
    for name, extra in extras._PACKAGES.values():
        if extra is not None:
            assert any(line.startswith(name) for line in offered[extra]), (name, extra)


@pytest.mark.parametrize(
    ("module", "remedy"),
    [
        ("igl", r'this needs libigl: pip install "jaxkvf\[geodesics\]" '),
        ("PIL.Image", r'this needs pillow: pip install "jaxkvf\[patterns\]" '),
        ("pyvista", r"this needs pyvista: pip install pyvista "),
    ],
)
def test_a_missing_package_is_named_with_what_to_install(monkeypatch, module, remedy):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=remedy) as caught:
        extras.extra(module)
    assert caught.value.name == module.partition(".")[0]
