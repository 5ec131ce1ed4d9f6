"""Smooth closed surfaces without symmetry: star-shaped around the origin, over the geodesic sphere."""

import numpy as np

from ...arguments import Integer
from .._triangle_mesh import TriangleMesh
from ._spheres import unit_icosphere

# Direction, length and width of each limb: r(n) = 1 + Σ length exp((n·c − 1) / width).
_LIMBS = np.array(
    [
        (0.95, 0.10, 0.25, 1.10, 0.060),
        (-0.90, 0.25, 0.30, 1.00, 0.070),
        (0.10, 0.85, -0.50, 0.90, 0.065),
        (-0.05, -0.75, -0.60, 0.80, 0.080),
    ]
)


def bumpy_sphere(frequency: Integer) -> TriangleMesh:
    """A smooth closed surface without any symmetry: the unit sphere plus a fixed sum of low harmonics.

    Args:
        frequency: of the geodesic sphere beneath, ≥ 1; 10 frequency² + 2 vertices.

    Raises:
        ValueError: `frequency` out of range.
    """
    n, faces = unit_icosphere(frequency)
    x, y, z = n.T
    radius = (
        1.0
        + 0.10 * (2 * z**2 - x**2 - y**2)
        + 0.12 * x * y
        + 0.15 * (x**3 - 3 * x * y**2)
        + 0.50 * x * y * z
        + 0.10 * y * (4 * z**2 - x**2 - y**2)
        + 0.60 * z * x * (x**2 - 3 * y**2)
    )
    return TriangleMesh.from_arrays(radius[:, None] * n, faces)


def limbed_blob(frequency: Integer) -> TriangleMesh:
    """A smooth closed blob with four limbs of slightly different length and width, after the paper's Fig. 11 but shorter.

    Args:
        frequency: of the geodesic sphere beneath, ≥ 1; 10 frequency² + 2 vertices.

    Raises:
        ValueError: `frequency` out of range.
    """
    n, faces = unit_icosphere(frequency)
    directions, lengths, widths = _LIMBS[:, :3], _LIMBS[:, 3], _LIMBS[:, 4]
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    radius = 1.0 + np.exp((n @ directions.T - 1.0) / widths) @ lengths
    return TriangleMesh.from_arrays(radius[:, None] * n, faces)
