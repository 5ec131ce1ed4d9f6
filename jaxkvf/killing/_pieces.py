"""`regge` on pieces of a surface: sets of faces with free boundary. On the host.

Energy and norm are sums over faces, so the matrices of a piece are the sums over its own, in the frames of the whole
surface: cone angles at the rim of a piece stay rescaled as they are inside it.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
import scipy.sparse as sp
from jaxtyping import Array, Float, Int
from scipy.sparse.linalg import LinearOperator, eigsh

from ..eigen import default_factorization
from ..mesh import Topology, TopologyArrays, polar_angles
from ._regge import CORNER_SHARE, SIDE_SHARE, corner_strains, mass_areas, strain_factors

_DENSE_BELOW = 300  # unknowns
_CHUNK = 1 << 11  # faces that one program handles, whatever the mesh: nothing is compiled anew for each


class PieceMatrices(NamedTuple):
    """A x = λ B x on the vertices of a piece, two unknowns each."""

    A: sp.csr_array
    B: sp.csr_array
    vertices: Int[np.ndarray, " n"]
    """Of the whole surface, ascending."""


class Pieces:
    """Restricts `regge` to sets of faces: what belongs to a face is computed once, and summed up for each piece."""

    def __init__(self, lengths: Float[Array, " E"], topology: Topology) -> None:
        arrays = TopologyArrays(*(np.asarray(getattr(topology, name)) for name in TopologyArrays._fields))
        scale, angles = polar_angles(arrays, np.asarray(lengths, np.float64))
        angles = scale[arrays.edges] * angles
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1) * np.array([1.0, -1.0])[:, None]
        along = arrays.face_edge_signs > 0
        first, last = (
            directions[arrays.face_edges, np.where(along, end, 1 - end)] for end in (0, 1)
        )  # along the edge
        sign = np.where(along, 1.0, -1.0)[..., None]
        self._faces = arrays.faces
        self._strains, self.areas = _in_chunks(
            np.asarray(lengths)[arrays.face_edges], -sign * first, sign * last
        )
        dot, cross = (
            (first * last).sum(axis=-1),
            (last[..., 0] * first[..., 1] - last[..., 1] * first[..., 0]),
        )
        self._transports = np.stack([np.stack([dot, -cross], -1), np.stack([cross, dot], -1)], -2)

    def matrices(self, faces: Int[np.ndarray, " n"]) -> PieceMatrices:
        """A and B of the piece made of these faces."""
        used, local = np.unique(self._faces[faces], return_inverse=True)
        unknowns = (2 * local.reshape(-1, 3, 1) + np.arange(2)).reshape(-1, 6)
        strains = self._strains[faces]
        rows = np.broadcast_to(
            3 * np.arange(len(faces))[:, None, None] + np.arange(3)[:, None], strains.shape
        )
        columns = np.broadcast_to(unknowns[:, None, :], strains.shape)
        root = sp.csr_array(
            (strains.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * len(faces), 2 * len(used))
        )
        return PieceMatrices(sp.csr_array(root.T @ root), self._mass(faces, unknowns, 2 * len(used)), used)

    def _mass(
        self, faces: Int[np.ndarray, " n"], unknowns: Int[np.ndarray, "n 6"], size: int
    ) -> sp.csr_array:
        areas = self.areas[faces]
        at_start = unknowns.reshape(-1, 3, 2)
        at_end = np.roll(at_start, -1, axis=1)
        diagonal = np.bincount(unknowns.ravel(), np.repeat(CORNER_SHARE * areas, 6), size)
        blocks = SIDE_SHARE * areas[:, None, None, None] * self._transports[faces]
        rows = np.broadcast_to(at_start[..., :, None], blocks.shape)
        columns = np.broadcast_to(at_end[..., None, :], blocks.shape)
        upper = sp.csr_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))
        return sp.csr_array(upper + upper.T + sp.diags_array(diagonal))

    def smallest(self, faces: Int[np.ndarray, " n"], k: int) -> Float[np.ndarray, " k"]:
        """The k smallest λ · area of the piece made of these faces. Dimensionless."""
        A, B, vertices = self.matrices(faces)
        area, size = float(self.areas[faces].sum()), 2 * len(vertices)
        if size <= max(_DENSE_BELOW, k):
            values = scipy.linalg.eigh(
                A.toarray(), B.toarray(), eigvals_only=True, subset_by_index=[0, k - 1]
            )
            return values * area
        solve = default_factorization().factorize(sp.csc_array(A + B / area))
        assert solve is not None  # A is positive semi-definite, B positive definite
        inverse = LinearOperator((size, size), matvec=solve, dtype=np.float64)  # pyright: ignore[reportCallIssue]
        start = np.random.default_rng(0).standard_normal(size)
        values = eigsh(A, k, M=B, sigma=-1 / area, OPinv=inverse, v0=start, return_eigenvectors=False)
        return np.sort(values) * area


def _in_chunks(
    sides: Float[np.ndarray, "F 3"], starts: Float[np.ndarray, "F 3 2"], ends: Float[np.ndarray, "F 3 2"]
) -> tuple[Float[np.ndarray, "F 3 6"], Float[np.ndarray, " F"]]:
    """Strains of each face by the vectors at its corners, and its mass."""
    padded = [
        np.pad(part, [(0, -len(part) % _CHUNK)] + [(0, 0)] * (part.ndim - 1), mode="edge")
        for part in (sides, starts.astype(sides.dtype), ends.astype(sides.dtype))
    ]
    chunks = zip(*(part.reshape(-1, _CHUNK, *part.shape[1:]) for part in padded), strict=True)
    found = [_of_faces(*(jnp.asarray(part) for part in chunk)) for chunk in chunks]
    strains, areas = (
        np.concatenate([np.asarray(part, np.float64) for part in parts]) for parts in zip(*found, strict=True)
    )
    return strains[: len(sides)], areas[: len(sides)]


@jax.jit
def _of_faces(
    sides: Float[Array, "n 3"], starts: Float[Array, "n 3 2"], ends: Float[Array, "n 3 2"]
) -> tuple[Float[Array, "n 3 6"], Float[Array, " n"]]:
    return corner_strains(strain_factors(sides), starts, ends).reshape(-1, 3, 6), mass_areas(sides)
