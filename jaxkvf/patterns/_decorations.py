"""What a pattern may show: relief, an image, stripes."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax.typing import ArrayLike
from jaxtyping import Float
from scipy.sparse.linalg import eigsh, splu

from ..arguments import Integer, Real, checked_integer
from ..exterior import d0, flat
from ..flows import period as period_of
from ..geometry import (
    barycentric_vertex_areas,
    cotan_weights,
    edge_lengths,
    project,
    vertex_frames,
    vertex_normals,
)
from ..host import check_on_host
from ..mesh import TriangleMesh
from ..sparse import to_scipy
from ._pattern import Pattern

Profile = Callable[[Float[np.ndarray, " w"], Float[np.ndarray, " w"]], Float[np.ndarray, " w"]]


def bump(u: Float[np.ndarray, " w"], v: Float[np.ndarray, " w"]) -> Float[np.ndarray, " w"]:
    """(1 − u² − v²)²: 1 in the middle of the unit disk, 0 with its slope at the rim."""
    return np.maximum(1 - u**2 - v**2, 0) ** 2


def heights(made: Pattern, profile: Profile = bump) -> Float[np.ndarray, " W"]:
    """The function `profile(u, v)` on the disks of a pattern, 0 outside of them."""
    inside = made.copy >= 0
    values = np.zeros(len(inside))
    values[inside] = profile(*made.disk[inside].T)
    return values


def emboss(made: Pattern, amplitude: float, profile: Profile = bump) -> TriangleMesh:
    """The pattern's mesh with its vertices moved along their normals by amplitude × `profile`: a relief.

    Args:
        made: a pattern, subdivided finely enough for the profile.
        amplitude: height of the relief where the profile is 1; negative: engraved. Unit: length.
        profile: function on the unit disk.
    """
    x = made.mesh.vertices
    normals = np.asarray(vertex_normals(x, made.mesh.topology))
    moved = np.asarray(x) + amplitude * heights(made, profile)[:, None] * normals
    return made.mesh.with_vertices(jnp.asarray(moved, x.dtype))


def paint(
    made: Pattern,
    image: Float[np.ndarray, "H w 3"],
    background: tuple[float, float, float] = (0.86, 0.85, 0.83),
) -> Float[np.ndarray, "W 3"]:
    """Colours of the vertices: the image, laid over the square around each disk, inside the disks. Colours in 0…1.

    Args:
        made: a pattern.
        image: its middle is the centre of a disk, right is along the field.
        background: of everything outside the disks.
    """
    inside = made.copy >= 0
    colors = np.tile(np.asarray(background, float), (len(inside), 1))
    height, width = image.shape[:2]
    u, v = made.disk[inside].T
    column, row = (u + 1) / 2 * (width - 1), (1 - v) / 2 * (height - 1)
    left = np.clip(column.astype(int), 0, width - 2)
    top = np.clip(row.astype(int), 0, height - 2)
    s, t = (column - left)[:, None], (row - top)[:, None]
    colors[inside] = (1 - t) * ((1 - s) * image[top, left] + s * image[top, left + 1]) + t * (
        (1 - s) * image[top + 1, left] + s * image[top + 1, left + 1]
    )
    return colors


def stripes(
    mesh: TriangleMesh,
    vectors: ArrayLike,
    count: Integer,
    *,
    direction: str = "across",
    period: Real | None = None,
) -> Float[np.ndarray, " V"]:
    """Stripes that the flow maps to themselves: the cosine, −1…1, of a phase at each vertex.

    `"across"`: `count` stripes that stand across the field around each integral curve, of equal flow time; the phase is that
    of the complex function whose gradient fits (count 2π/T) U/|U|² best (Knöppel et al., Stripe patterns on surfaces, 2015).
    `"along"`: stripes along integral curves, of equal flux between them: the phase is count 2π times a stream function from
    0 to 1. On the host.

    Args:
        mesh: the surface.
        vectors: `[V, 3]`, a nearly Killing field. Unit: length / time.
        count: number of stripes, ≥ 1.
        direction: `"across"` or `"along"` the field.
        period: T, for stripes across; by default `period(mesh, vectors).period`.

    Raises:
        ValueError: count < 1; unknown direction; the field has no single-valued stream function (such as a turning torus).
    """
    check_on_host("stripes", mesh, vectors, period)
    count = checked_integer("count", count)
    if direction not in {"across", "along"}:
        raise ValueError(f"direction must be 'across' or 'along', got {direction!r}")
    topology = mesh.topology
    lengths = edge_lengths(mesh.vertices, topology)
    u = project(jnp.asarray(vectors, lengths.dtype), vertex_frames(mesh.vertices, topology))
    gradient = sp.csr_array(to_scipy(d0(topology, float)))
    weights = np.asarray(cotan_weights(lengths, topology), float)
    if direction == "along":
        turned = jnp.stack([-u[:, 1], u[:, 0]], axis=1)
        form = np.asarray(flat(turned, lengths, topology), float)
        return np.cos(2 * np.pi * count * _stream_function(gradient, weights, form))
    whole = period_of(mesh, vectors).period if period is None else period
    square = np.asarray((u * u).sum(axis=1), float)
    slow = square < 1e-4 * square.max()
    unit = u / jnp.asarray(np.where(slow, np.inf, square))[:, None]
    winding = np.exp(1j * count * 2 * np.pi / whole * np.asarray(flat(unit, lengths, topology), float))
    edges = np.asarray(topology.edges)
    weights = np.maximum(weights, 0) * square[edges].mean(axis=1)
    n, row = topology.n_vertices, np.arange(topology.n_edges)
    columns = (np.concatenate([row, row]), np.concatenate([edges[:, 0], edges[:, 1]]))
    twisted = sp.csc_array(
        (np.concatenate([-winding, np.ones_like(winding)]), columns), shape=(len(edges), n)
    )
    areas = np.asarray(barycentric_vertex_areas(lengths, topology), float)
    mass = sp.diags_array(areas * (square + 1e-3 * square.max()))  # phases near singular points do not matter
    energy = sp.csc_array(twisted.conj().T @ sp.diags_array(weights) @ twisted)
    shift = -1e-6 * abs(energy.diagonal()).mean() / mass.diagonal().mean()
    start = np.random.default_rng(0).standard_normal(n).astype(complex)
    _, z = eigsh(energy, 1, M=sp.csc_array(mass), sigma=shift, v0=start)  # pyright: ignore[reportArgumentType]
    return np.cos(np.angle(z[:, 0]))


def _stream_function(
    gradient: sp.csr_array, weights: Float[np.ndarray, " E"], form: Float[np.ndarray, " E"]
) -> Float[np.ndarray, " V"]:
    """The function, from 0 to 1, whose differential fits the form best."""
    weighted = gradient.T @ sp.diags_array(weights)
    solve = splu(sp.csc_matrix((weighted @ gradient)[1:, 1:])).solve
    psi = np.concatenate([[0.0], solve((weighted @ form)[1:])])
    rest = form - gradient @ psi
    if (np.abs(weights) * rest**2).sum() > 0.05 * (np.abs(weights) * form**2).sum():
        raise ValueError(
            "the field has no single-valued stream function: its integral curves cannot be numbered along a line; "
            "take stripes across it"
        )
    return (psi - psi.min()) / np.ptp(psi)
