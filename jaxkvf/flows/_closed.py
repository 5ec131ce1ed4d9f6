"""The combination of fields of equal λ whose integral curves close."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..arguments import Integer
from ..geometry import barycentric_vertex_areas, edge_directions, edge_lengths, vertex_frames
from ..host import check_on_host
from ..mesh import TriangleMesh
from ._period import NoPeriodError, Period, period

_OWN = 0.99
"""Share of a field on one component above which it counts as a field of that component alone."""


class ClosedField(eqx.Module):
    """A combination of fields, its integral curves closed."""

    vectors: Float[Array, "V 3"]
    """Of the norm that fields of unit norm have. Unit: that of the fields."""
    coefficients: Float[Array, " d"]
    """Of each of the fields: `vectors` is their sum; their squares sum to 1. Dimensionless."""
    period: Period


def closed_field(
    mesh: TriangleMesh, vectors: ArrayLike, *, curves: Integer = 64, seed: int = 0
) -> ClosedField:
    """Of all combinations of some fields, one whose integral curves close, with its period.

    Fields of equal λ come in any basis: those of an open cylinder as two screws, neither of which closes. Tried are, from
    the largest connected component to the smallest, the combinations that live on it alone, and of these those first that
    cross its boundary least: on a surface that ends, curves close only if they run along the boundary. A Killing field
    that vanishes somewhere closes always (near that point it is a turn). On the host.

    Args:
        mesh: the surface.
        vectors: `[d, V, 3]`, fields of unit norm of one cluster of λ, or `[V, 3]`.
        curves: how many, as in `period`.
        seed: as in `period`.

    Raises:
        NoPeriodError: none of the combinations tried closes.
        ValueError: fields of another shape, or linearly dependent; fields as in `flow`.

    Warns:
        UserWarning: as for `period`.
    """
    check_on_host("closed_field", mesh, vectors)
    fields = np.asarray(vectors, np.float64)
    if fields.ndim == 2:
        fields = fields[None]
    if fields.ndim != 3 or fields.shape[1:] != mesh.vertices.shape or not len(fields):
        raise ValueError(
            f"vectors must have shape [d, {mesh.topology.n_vertices}, 3], one field a row, got {list(fields.shape)}"
        )
    if not np.isfinite(fields).all():
        raise ValueError("vectors must be finite")
    first: NoPeriodError | None = None
    for coefficients in _candidates(mesh, fields):
        combination = jnp.asarray(np.tensordot(coefficients, fields, 1), mesh.vertices.dtype)
        try:
            found = period(mesh, combination, curves=curves, seed=seed)
        except NoPeriodError as failure:
            first = first or failure
            continue
        return ClosedField(combination, jnp.asarray(coefficients, mesh.vertices.dtype), found)
    assert first is not None
    raise first


def _candidates(mesh: TriangleMesh, fields: Float[np.ndarray, "d V 3"]) -> list[Float[np.ndarray, " d"]]:
    """Coefficients of combinations to try, of unit norm, the most promising first."""
    topology = mesh.topology
    areas = np.asarray(barycentric_vertex_areas(edge_lengths(mesh.vertices, topology), topology), np.float64)
    count, label = topology.components()
    each = np.zeros((count, len(fields), len(fields)))
    np.add.at(each, label, np.einsum("v,ivx,jvx->vij", areas, fields, fields))
    total = each.sum(axis=0)
    size = np.linalg.eigvalsh(total)
    if size[0] <= 1e-12 * size[-1]:
        raise ValueError("the fields are linearly dependent: take each of them once")
    flux = _boundary_flux(mesh, fields)
    candidates = []
    for c in np.argsort(-np.bincount(label, areas, count), kind="stable"):
        share, basis = scipy.linalg.eigh(each[c], total)
        own = basis[:, share > _OWN]
        if own.shape[1]:
            _, within = np.linalg.eigh(own.T @ flux @ own)
            candidates.extend((own @ within).T)
    candidates = candidates or list(scipy.linalg.eigh(flux, total)[1].T)
    return [a * np.sign(a[np.abs(a).argmax()]) / np.linalg.norm(a) for a in candidates]


def _boundary_flux(mesh: TriangleMesh, fields: Float[np.ndarray, "d V 3"]) -> Float[np.ndarray, "d d"]:
    """∮ ⟨U_i, n⟩⟨U_j, n⟩ ds along the boundary, of means over its edges, as tracers see them: in intrinsic frames."""
    topology = mesh.topology
    lengths = edge_lengths(mesh.vertices, topology)
    frames = np.asarray(vertex_frames(mesh.vertices, topology), np.float64)
    intrinsic = np.einsum("vax,ivx->iva", frames, fields)
    edge = np.flatnonzero(np.asarray(topology.is_boundary_edge))
    tangent = np.asarray(edge_directions(lengths, topology), np.float64)[edge]
    at_ends = intrinsic[:, np.asarray(topology.edges)[edge]]
    across = at_ends[..., 1] * tangent[..., 0] - at_ends[..., 0] * tangent[..., 1]
    through = across.mean(axis=2)
    return (through * np.asarray(lengths, np.float64)[edge]) @ through.T
