"""The intrinsic Delaunay triangulation of a surface, as a differentiable function of its edge lengths.

The flips are found on the host; what they do to the lengths is repeated in JAX, so derivatives flow back through every one.

References: A. Bobenko, B. Springborn, A Discrete Laplace–Beltrami Operator for Simplicial Surfaces (2007); N. Sharp,
Y. Soliman, K. Crane, Navigating Intrinsic Triangulations (2019).
"""

import itertools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, DTypeLike, Float, Int

from ..arguments import Integer, check_shape, checked_integer
from ..mesh import DelaunayFlips, Topology, TopologyArrays, TriangleMesh, delaunay_flips
from ._duals import cotan_weights
from ._metric import edge_lengths, triangle_areas


class IntrinsicDelaunay(eqx.Module):
    """The same surface over the same vertices, cut along other geodesics: the angles opposite an edge sum to at most π.

    Several edges may join the same two vertices, or a vertex to itself. Edges and faces keep their number, and those not
    flipped their place.
    """

    lengths: Float[Array, " E"]
    """Length of each edge; differentiable. Unit: length."""
    topology: Topology
    """Edges need not run from the smaller to the larger vertex, nor be sorted."""
    frame_rotations: Float[Array, " V"]
    """Rotation from the polar frame of each vertex here to that in the given triangulation; held constant in derivatives.

    Radians; 0 where the first spoke did not move.
    """
    flips: Int[Array, ""]
    """Number of flips; with 0 lengths and topology are the given ones."""

    @property
    def least_cotan_weight(self) -> Float[Array, ""]:
        """Smallest ⋆₁. Inner edges have ⋆₁ ≥ −`delaunay_tolerance`; those that cannot flip may have less: on the boundary,
        or at vertices held at `least_degree`.
        """
        return cotan_weights(self.lengths, self.topology).min()


def delaunay_tolerance(dtype: DTypeLike) -> float:
    """How far below zero the cotangent weight of an inner edge may stay: the root of the rounding unit. Dimensionless.

    Two faces inscribed in one circle, of which regular grids are full, thus stay as they are whatever the rounding.
    """
    return float(np.finfo(dtype).eps) ** 0.5


@eqx.filter_jit
def intrinsic_delaunay(
    surface: TriangleMesh | Float[Array, " E"],
    topology: Topology | None = None,
    *,
    capacity: Integer = 1,
    least_degree: Integer = 0,
) -> IntrinsicDelaunay:
    """The intrinsic Delaunay triangulation of a mesh, or of edge lengths over a topology.

    Under `jit`, `vmap` and `grad` too (forward and reverse, any order). The new lengths are smooth in the given ones while
    the same edges flip. Where four vertices come to lie on a circle, an edge jumps to the other diagonal; both have ⋆₁ = 0
    there, so what is made of cotangent weights stays continuous.
    Triangles that break the triangle inequality are left alone, with their NaN areas.

    Args:
        surface: a mesh, or the length of each edge of `topology`.
        topology: connectivity, of a mesh or of an intrinsic triangulation; none beside a mesh.
        least_degree: edges that flips leave at an inner vertex at the least, loops not counted; some edges then stay though
            they are not Delaunay. Along fewer than three a vector is not determined by its components.
        capacity: multiplies the room kept for flips, whose number must have a bound under `jit`. 1 is room for twice as
            many flips as edges and for a thousand that depend on each other; most meshes need a fraction of it.

    Raises:
        ValueError: not one length an edge; lengths without a topology, or a mesh with one; capacity not a positive integer.
        equinox.EquinoxRuntimeError: more flips than there is room for.
    """
    if isinstance(surface, TriangleMesh) != (topology is None):
        raise ValueError("intrinsic_delaunay takes a mesh alone, or edge lengths and their topology")
    if isinstance(surface, TriangleMesh):
        lengths, topology = edge_lengths(surface.vertices, surface.topology), surface.topology
    else:
        lengths = surface
    assert topology is not None
    check_shape("lengths", lengths, (topology.n_edges,), "one an edge")
    capacity = checked_integer("capacity", capacity)
    least_degree = checked_integer("least_degree", least_degree, at_least=0)
    found = _find_flips(jax.lax.stop_gradient(lengths), topology, capacity, least_degree)
    flipped = lengths
    for diamonds in (found.wide, found.narrow):
        needed = diamonds[0, 0, 0] < topology.n_edges
        flipped = jax.lax.cond(needed, _repeat_flips, lambda lengths, _: lengths, flipped, diamonds)
    flipped = eqx.error_if(flipped, ~found.complete, _NO_ROOM)
    return IntrinsicDelaunay(flipped, Topology(*found.topology), found.frame_rotations, found.flips)


_NO_ROOM = (
    "The intrinsic Delaunay triangulation takes more edge flips than there is room for: the mesh is very far from "
    "Delaunay (long fans or strips of thin triangles). Raise `capacity`, or remesh."
)


class _Schedule(NamedTuple):
    """What crosses the callback: arrays of NumPy on the host, of JAX on this side; and their shapes, announced to it.

    Flips stand in rows `[rows, width, 5]`, to be done one row after the other, padded with the number of edges.
    """

    topology: Any
    frame_rotations: Any
    wide: Any
    narrow: Any
    flips: Any
    complete: Any


_LEAST_WIDTH = 32
_WIDE_ROWS = 128
_NARROW_ROWS = 1024


def _row_shapes(n_edges: int, capacity: Integer) -> tuple[tuple[int, int], tuple[int, int]]:
    """Rows and width: 128 rows of E/64 flips for the bulk, then many short ones, since a fan of n flips takes n steps."""
    wide = (capacity * _WIDE_ROWS, max(_LEAST_WIDTH, n_edges // 64))
    return wide, (capacity * _NARROW_ROWS, _LEAST_WIDTH)


def _find_flips(
    lengths: Float[Array, " E"], topology: Topology, capacity: Integer, least_degree: int
) -> _Schedule:
    shapes = _row_shapes(topology.n_edges, capacity)
    dtype = np.dtype(lengths.dtype)

    def on_host(lengths: Array, topology: TopologyArrays) -> _Schedule:
        given = TopologyArrays(*(np.asarray(part) for part in topology))
        most = sum(rows * width for rows, width in shapes)
        # Weights are ½ (cot α + cot β).
        found = delaunay_flips(
            given, np.asarray(lengths, np.float64), 2 * delaunay_tolerance(dtype), most, least_degree
        )
        (wide, narrow), fits = _in_rows(found, shapes, len(given.edges))
        return _Schedule(
            topology=found.topology,
            frame_rotations=found.frame_rotations.astype(dtype),
            wide=wide,
            narrow=narrow,
            flips=np.int32(len(found.levels)),
            complete=np.bool_(found.complete and fits),
        )

    arrays = TopologyArrays(*(getattr(topology, name) for name in TopologyArrays._fields))
    returned = _Schedule(
        topology=jax.tree.map(lambda part: jax.ShapeDtypeStruct(part.shape, np.int32), arrays),
        frame_rotations=jax.ShapeDtypeStruct((topology.n_vertices,), dtype),
        wide=jax.ShapeDtypeStruct((*shapes[0], 5), np.int32),
        narrow=jax.ShapeDtypeStruct((*shapes[1], 5), np.int32),
        flips=jax.ShapeDtypeStruct((), np.int32),
        complete=jax.ShapeDtypeStruct((), np.bool_),
    )
    return jax.pure_callback(on_host, returned, lengths, arrays, vmap_method="sequential")


def _in_rows(
    found: DelaunayFlips, shapes: tuple[tuple[int, int], ...], n_edges: int
) -> tuple[list[Int[np.ndarray, "rows width 5"]], bool]:
    """The flips in rows of these shapes, no two levels in a row; and whether all found room."""
    blocks = [np.full((*shape, 5), n_edges, np.int32) for shape in shapes]
    rows = itertools.chain(*blocks)
    for level in np.split(found.diamonds, np.flatnonzero(np.diff(found.levels)) + 1):
        waiting = level
        while len(waiting):
            row = next(rows, None)
            if row is None:
                return blocks, False
            row[: len(waiting)] = waiting[: len(row)]
            waiting = waiting[len(row) :]
    return blocks, True


def _repeat_flips(lengths: Float[Array, " E"], diamonds: Int[Array, "rows width 5"]) -> Float[Array, " E"]:
    """The lengths after these flips, one row after the other."""
    n_edges = lengths.shape[0]
    padded = jnp.concatenate([lengths, jnp.ones(1, lengths.dtype)])  # padding sees a rhombus of unit sides

    def flip(
        lengths: Float[Array, " padded"], diamonds: Int[Array, "width 5"]
    ) -> tuple[Float[Array, " padded"], None]:
        flipped = flipped_lengths(*lengths[diamonds].T)
        # Padding is written out of bounds, which drops it, each to its own place.
        beyond = n_edges + 1 + jnp.arange(diamonds.shape[0], dtype=diamonds.dtype)
        target = jnp.where(diamonds[:, 0] < n_edges, diamonds[:, 0], beyond)
        return lengths.at[target].set(flipped, mode="drop", unique_indices=True), None

    return jax.lax.scan(flip, padded, diamonds)[0][:n_edges]


@jax.custom_jvp
def flipped_lengths(
    ij: Float[Array, " n"],
    ik: Float[Array, " n"],
    jk: Float[Array, " n"],
    il: Float[Array, " n"],
    jl: Float[Array, " n"],
) -> Float[Array, " n"]:
    """Length of the other diagonal kl of a quadrilateral i l j k, k on the left of ij. Unit: length.

    Both triangles are laid out along ij in the plane, k at (x, y) and l at (x', −y'); nothing is subtracted but the feet x.
    """
    (x_k, y_k), (x_l, y_l) = _apex(ij, ik, jk), _apex(ij, il, jl)
    return jnp.sqrt((x_k - x_l) ** 2 + (y_k + y_l) ** 2)


def _apex(
    base: Float[Array, " n"], left: Float[Array, " n"], right: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Foot (from the base's left end) and height of a triangle's apex over its base."""
    foot = ((left - right) * (left + right) + base * base) / (2 * base)
    return foot, 2 * triangle_areas(base, left, right) / base


@flipped_lengths.defjvp
def _(primals, tangents):
    """By the self-stress of the quadrilateral, ratios of its four triangles. Reverse mode keeps five numbers a flip."""
    ij, ik, jk, il, jl = primals
    kl = flipped_lengths(ij, ik, jk, il, jl)
    (x_k, y_k), (x_l, y_l) = _apex(ij, ik, jk), _apex(ij, il, jl)
    ijk, ijl = ij * y_k, ij * y_l  # twice the areas
    ikl = x_k * y_l + x_l * y_k
    jkl = (ij - x_k) * y_l + (ij - x_l) * y_k
    partials = (
        -ij / kl * (ikl / ijk) * (jkl / ijl),
        ik / kl * (jkl / ijk),
        jk / kl * (ikl / ijk),
        il / kl * (jkl / ijl),
        jl / kl * (ikl / ijl),
    )
    change = sum((p * t for p, t in zip(partials, tangents, strict=True)), start=jnp.zeros_like(kl))
    return kl, change
