"""Lengths, areas and angles: everything intrinsic starts from the edge lengths."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mesh import Topology


@jax.jit
def edge_lengths(vertices: Float[Array, "V 3"], topology: Topology) -> Float[Array, " E"]:
    """Length of each edge. Unit: length."""
    tail, head = vertices[topology.edges[:, 0]], vertices[topology.edges[:, 1]]
    return jnp.linalg.norm(head - tail, axis=1)


@jax.jit
def mean_edge_length(lengths: Float[Array, " E"]) -> Float[Array, ""]:
    """Mean over the edges: the unit in which noise and displacements are given. Unit: length."""
    return lengths.mean()


@jax.jit
def length_unit(lengths: Float[Array, " E"]) -> Float[Array, ""]:
    """The power of two next to the mean length, constant to derivatives. Unit: length.

    Dividing by it is exact, and what is made of the quotients does not leave the range of numbers.
    """
    mean = mean_edge_length(jax.lax.stop_gradient(lengths))
    _, exponent = jnp.frexp(mean)
    return jnp.where(jnp.isfinite(mean), jnp.ldexp(jnp.ones_like(mean), exponent), mean)


def _sorted_three(a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
    """The three values in descending order by a sorting network.

    `where` rather than `maximum`: at a tie it takes one side whole, so derivatives of symmetric functions of the result
    are right to every order.
    """

    def ordered(x: Array, y: Array) -> tuple[Array, Array]:
        return jnp.where(x >= y, x, y), jnp.where(x >= y, y, x)

    a, b = ordered(a, b)
    b, c = ordered(b, c)
    a, b = ordered(a, b)
    return a, b, c


@jax.jit
def triangle_areas(a: Float[Array, " n"], b: Float[Array, " n"], c: Float[Array, " n"]) -> Float[Array, " n"]:
    """Areas of triangles with these sides by Kahan's formula, accurate to rounding for thin ones. Unit: length².

    Three lengths that are flat within their rounding count as thick as that (2ε of the longest); NaN where they break the
    triangle inequality by more (4ε).

    Reference: W. Kahan, Miscalculating Area and Angles of a Needle-like Triangle (2014), §2.
    """
    a, b, c = _sorted_three(a, b, c)
    rounding = jnp.finfo(a.dtype).eps * a
    excess = c - (a - b)
    excess = jnp.where((excess < 2 * rounding) & (excess > -4 * rounding), 2 * rounding, excess)
    # Two roots: the product of four lengths leaves the range of numbers where areas do not.
    return 0.25 * jnp.sqrt((a + (b + c)) * (a + (b - c))) * jnp.sqrt((c + (a - b)) * excess)


@jax.jit
def face_areas(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, " F"]:
    """Area of each face, accurate to rounding for thin ones; NaN where lengths break the triangle inequality.

    Unit: length².
    """
    return triangle_areas(*lengths[topology.face_edges].T)


@jax.jit
def corner_cotangents(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, "F 3"]:
    """Cotangent of the angle at each corner: (b² + c² − a²) / (4 area), a opposite. Dimensionless."""
    area = face_areas(lengths, topology)
    return _twice_dot_products(lengths, topology) / (4 * area[:, None])


@jax.jit
def corner_angles(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, "F 3"]:
    """Interior angle at each corner, in (0, π). Radians.

    By atan2 of twice the cross and twice the dot product of the two sides: no loss near 0 and π, unlike acos.
    """
    area = face_areas(lengths, topology)
    return jnp.arctan2(
        jnp.broadcast_to(4 * area[:, None], (area.shape[0], 3)), _twice_dot_products(lengths, topology)
    )


def _twice_dot_products(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, "F 3"]:
    """b² + c² − a² at each corner, written so that nearly equal squares are subtracted as (b − a)(b + a)."""
    side = lengths[topology.face_edges]  # side s joins corners s and s + 1
    opposite, after, before = jnp.roll(side, -1, axis=1), side, jnp.roll(side, 1, axis=1)
    longer, shorter = jnp.where(after >= before, after, before), jnp.where(after >= before, before, after)
    return (longer - opposite) * (longer + opposite) + shorter * shorter


@jax.jit
def surface_area(lengths: Float[Array, " E"], topology: Topology) -> Float[Array, ""]:
    """Total area. Unit: length²."""
    return face_areas(lengths, topology).sum()
