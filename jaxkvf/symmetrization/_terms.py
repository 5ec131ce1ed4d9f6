"""What moving a mesh costs: small objects, each a sum of squares."""

import abc
from functools import partial
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..arguments import checked_not_negative
from ..geometry import corner_cotangents, face_areas, vertex_normals
from ._configuration import Configuration


class AbstractTerm(eqx.Module):
    """A dimensionless price Σ r² of changing `original` to `moved`, 0 for changing nothing."""

    @abc.abstractmethod
    def residuals(self, moved: Configuration, original: Configuration) -> Float[Array, " r"]:
        """r, its weight included; smooth."""

    def __call__(self, moved: Configuration, original: Configuration) -> Float[Array, ""]:
        """The price."""
        return (self.residuals(moved, original) ** 2).sum()


def _weight(default: float) -> Any:
    return eqx.field(default=default, static=True, converter=partial(checked_not_negative, "weight"))


class PositionFidelity(AbstractTerm):
    """Weight × mean squared displacement of the vertices, in mean edge lengths of the original."""

    weight: float = _weight(1e-4)

    def residuals(self, moved: Configuration, original: Configuration) -> Float[Array, " r"]:
        displacement = (moved.vertices - original.vertices) / original.unit
        return _root_of_mean(self.weight, displacement.ravel(), len(displacement))


class NormalFidelity(AbstractTerm):
    """Weight × mean squared displacement along the original's vertex normals, in its mean edge lengths.

    Vertices may slide along the surface at no price.
    """

    weight: float = _weight(1e-4)

    def residuals(self, moved: Configuration, original: Configuration) -> Float[Array, " r"]:
        displacement = (moved.vertices - original.vertices) / original.unit
        normals = vertex_normals(original.vertices, original.topology)
        return _root_of_mean(self.weight, (displacement * normals).sum(axis=1), len(displacement))


class LengthFidelity(AbstractTerm):
    """Weight × mean squared change of the edge lengths, in mean edge lengths of the original: free to bend."""

    weight: float = _weight(1e-4)

    def residuals(self, moved: Configuration, original: Configuration) -> Float[Array, " r"]:
        change = (moved.lengths - original.lengths) / original.unit
        return _root_of_mean(self.weight, change, len(change))


class VolumeFidelity(AbstractTerm):
    """Weight × squared relative change of the enclosed volume, of a closed surface.

    Raises:
        ValueError: the surface has a boundary, and encloses nothing.
    """

    weight: float = _weight(1.0)

    def residuals(self, moved: Configuration, original: Configuration) -> Float[Array, " r"]:
        if 3 * moved.topology.n_faces != 2 * moved.topology.n_edges:
            raise ValueError("VolumeFidelity is for closed surfaces; this one has a boundary")
        change = _volume(moved) / _volume(original) - 1
        return _root_of_mean(self.weight, change[None], 1)


class ShapeBarrier(AbstractTerm):
    """Weight × mean symmetric Dirichlet energy of the triangles: infinite for slivers, indifferent to bending.

    Of the affine map with metric g from each triangle's original shape to its moved one, ½ tr (g + g⁻¹) − 2 =
    ½ ‖√g − 1/√g‖² ≥ 0 with 0 for rotations: it keeps angles and areas, and grows like area⁻² as a triangle collapses, so no
    needle or sliver pays.

    Reference: J. Smith, S. Schaefer, Bijective Parameterization with Free Boundaries (2015).
    """

    weight: float = _weight(1e-4)

    def residuals(self, moved: Configuration, original: Configuration) -> Float[Array, " r"]:
        topology = original.topology
        rest_area = face_areas(original.lengths, topology)
        determinant = face_areas(moved.lengths, topology) / rest_area  # of √g
        # √g = (g + det 1) / trace by Cayley–Hamilton.
        g = metric_at_rest(moved, original)
        g_11, g_22, g_12 = g.T
        trace = jnp.sqrt(g_11 + g_22 + 2 * determinant)
        inverse = 1 / (trace * determinant)
        # √g − 1/√g, its last entry counted twice.
        r = jnp.stack(
            [
                (g_11 + determinant) / trace - (g_22 + determinant) * inverse,
                (g_22 + determinant) / trace - (g_11 + determinant) * inverse,
                2**0.5 * g_12 * (1 / trace + inverse),
            ],
            axis=1,
        )
        share = jnp.sqrt(0.5 * self.weight * rest_area / rest_area.sum())
        return (share[:, None] * r).ravel()


def _root_of_mean(weight: float, r: Float[Array, " r"], count: int) -> Float[Array, " r"]:
    return (weight / count) ** 0.5 * r


def _volume(surface: Configuration) -> Float[Array, ""]:
    a, b, c = (surface.vertices[surface.topology.faces[:, corner]] for corner in range(3))
    return (a * jnp.cross(b, c)).sum() / 6


def metric_at_rest(moved: Configuration, original: Configuration) -> Float[Array, "F 3"]:
    """g₁₁, g₂₂, g₁₂ of each moved triangle in an orthonormal frame of its original shape: ℓ² = eᵀg e on all sides."""
    topology = original.topology
    sides = original.lengths[topology.face_edges]
    cot = corner_cotangents(original.lengths, topology)
    base, height = sides[:, 0], 2 * face_areas(original.lengths, topology) / sides[:, 0]
    foot = height * cot[:, 0]  # of the third corner, from the first along the first side
    first, second, third = (moved.lengths[topology.face_edges] ** 2).T
    g_11 = first / base**2
    # side 2 = (foot, height), side 1 = (foot − base, height).
    g_12 = (third - second + (base - 2 * foot) * base * g_11) / (2 * base * height)
    g_22 = (third - foot**2 * g_11 - 2 * foot * height * g_12) / height**2
    return jnp.stack([g_11, g_22, g_12], axis=1)
