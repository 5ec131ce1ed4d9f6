"""Shapes refuse arguments that make no sense, and name them."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from jaxkvf import TriangleMesh
from jaxkvf.mesh import shapes

BAD_ARGUMENTS = [
    (lambda: shapes.icosphere(0), "frequency must be an integer of at least 1, got 0"),
    (lambda: shapes.icosphere(2, -1.0), "radius must be positive and finite, got -1.0"),
    (
        lambda: shapes.ellipsoid(2, (1.0, 0.0, 1.0)),
        r"radii must be 3 positive and finite numbers, got \(1.0, 0.0, 1.0\)",
    ),
    (lambda: shapes.ellipsoid(-3), "frequency must be an integer of at least 1, got -3"),
    (lambda: shapes.random_sphere(3), "n_vertices must be an integer of at least 4, got 3"),
    (
        lambda: shapes.random_sphere(9, 0, (1, 1, math.inf)),
        r"radii must be 3 positive and finite numbers, got \(1, 1, inf\)",
    ),
    (lambda: shapes.limbed_blob(0), "frequency must be"),
    (lambda: shapes.bumpy_sphere(0), "frequency must be"),
    (lambda: shapes.torus(2, 5), "n_major must be an integer of at least 3, got 2"),
    (lambda: shapes.torus(5, 2), "n_minor must be an integer of at least 3, got 2"),
    (lambda: shapes.torus(5, 5, 1, 2), "0 < minor_radius < major_radius must hold, got 2 and 1"),
    (lambda: shapes.cylinder(2), "n_around must be an integer of at least 3, got 2"),
    (lambda: shapes.cylinder(5, 0), "n_along must be an integer of at least 1, got 0"),
    (lambda: shapes.cylinder(5, height=0.0), "height must be positive and finite, got 0.0"),
    (lambda: shapes.cylinder(5, radius=math.nan), "radius must be positive and finite, got nan"),
    (lambda: shapes.disk(0), "n_rings must be an integer of at least 1, got 0"),
    (lambda: shapes.disk(2, 0.0), "radius must be positive"),
    (lambda: shapes.annulus(2, 1.0, 0.5), "0 < inner_radius < outer_radius must hold, got 1.0 and 0.5"),
    (
        lambda: shapes.cone(9, top_radius=0.0),
        r"bottom_radius, top_radius, height must be 3 positive .* got \(1.0, 0.0, 1.0\)",
    ),
    (
        lambda: shapes.cone(9, bottom_radius=2, top_radius=2),
        "top_radius must differ from bottom_radius, got 2 twice; use `cylinder`",
    ),
    (lambda: shapes.elliptic_cone(2), "n_around must be"),
    (
        lambda: shapes.elliptic_cone(9, semi_axes=(1, -1)),
        r"semi_axes must be 2 positive and finite numbers, got \(1, -1\)",
    ),
    (
        lambda: shapes.elliptic_cone(9, distances=(0.0, 1.0)),
        r"0 < distances\[0\] < distances\[1\] must hold, got 0.0 and 1.0",
    ),
    (
        lambda: shapes.elliptic_cone(7, semi_axes=(0.01, 3)),
        "7 generators cannot be spread evenly .* take more of them",
    ),
    (lambda: shapes.spherical_band(2), "n_around must be"),
    (lambda: shapes.spherical_band(9, latitudes=(0.5, -0.5)), r"latitudes must hold .* got \(0.5, -0.5\)"),
    (lambda: shapes.spherical_band(9, latitudes=(0.5, 2)), "latitudes must hold"),
    (lambda: shapes.vase(2), "n_along must be an integer of at least 3, got 2"),
    (lambda: shapes.squashed_cone(0.0), "squash must be positive and finite, got 0.0"),
    (lambda: shapes.squashed_cone(1.0, 5), "n_along must be an integer of at least 6, got 5"),
    (lambda: shapes.surface_of_revolution(np.sin, np.cos, 2), "n_along must be"),
    (
        lambda: shapes.surface_of_revolution(np.sin, np.cos, 9, 2),
        "n_around must be an integer of at least 3, got 2",
    ),
    (
        lambda: shapes.surface_of_revolution(np.sin, np.cos, 9, interval=(1, 1)),
        r"interval must be finite with start < end, got \(1, 1\)",
    ),
    (
        lambda: shapes.surface_of_revolution(np.sin, np.cos, 9, interval=(0, 6)),
        "r must not be negative; it is at t =",
    ),
    (
        lambda: shapes.surface_of_revolution(np.abs, lambda t: t, 10, interval=(-1, 1)),
        "r must be positive except at the ends .* is not at t = ",
    ),
    (lambda: shapes.surface_of_revolution(lambda t: t * np.nan, np.cos, 9), "r is not finite at t = 0.0"),
    (
        lambda: shapes.surface_of_revolution(np.sin, lambda t: np.where(t > 1, np.inf, t), 9),
        "z is not finite at t = 1.0",
    ),
    (lambda: shapes.surface_of_revolution(np.ones_like, np.ones_like, 9), "the meridian has no length"),
    (
        lambda: shapes.add_normal_noise(shapes.icosphere(1), -0.1),
        "sigma must be finite and at least 0, got -0.1",
    ),
    (
        lambda: shapes.add_normal_noise(shapes.icosphere(1), math.inf),
        "sigma must be finite and at least 0, got inf",
    ),
]


@pytest.mark.parametrize(("call", "message"), BAD_ARGUMENTS)
def test_bad_arguments_are_named(call: Callable[[], TriangleMesh], message: str):
    with pytest.raises(ValueError, match=message):
        call()
