"""`regge` on pieces of a surface: sets of faces with free boundary.

Energy and norm are sums over faces, so the matrices of a piece are the sums over its own, in the frames of the whole
surface: cone angles at the rim of a piece stay rescaled as they are inside it.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from ..geometry import edge_directions
from ..mesh import Topology
from ._regge import CORNER_SHARE, SIDE_SHARE, KillingOperator, Regge, head_to_tail, mass_areas


class PieceMatrices(NamedTuple):
    """A x = λ B x on the vertices of a piece, two unknowns each."""

    A: sp.csr_array
    B: sp.csr_array
    vertices: Int[np.ndarray, " n"]
    """Of the whole surface, ascending."""


class Pieces:
    """Restricts `regge` to sets of faces: everything is computed once, and summed up for each piece. On the host."""

    def __init__(self, lengths: Float[Array, " E"], topology: Topology) -> None:
        parts = (topology.faces, mass_areas(lengths, topology), *_at_corners(lengths, topology))
        self._faces, self.areas, self._strains, self._transports = (np.asarray(part) for part in parts)

    def matrices(self, faces: Int[np.ndarray, " n"]) -> PieceMatrices:
        """A and B of the piece made of these faces."""
        used, local = np.unique(self._faces[faces], return_inverse=True)
        unknowns = (2 * local.reshape(-1, 3, 1) + np.arange(2)).reshape(-1, 6)
        strains = self._strains[faces].astype(np.float64)
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
        areas = self.areas[faces].astype(np.float64)
        at_start = unknowns.reshape(-1, 3, 2)
        at_end = np.roll(at_start, -1, axis=1)
        diagonal = np.bincount(unknowns.ravel(), np.repeat(CORNER_SHARE * areas, 6), size)
        blocks = SIDE_SHARE * areas[:, None, None, None] * self._transports[faces]
        rows = np.broadcast_to(at_start[..., :, None], blocks.shape)
        columns = np.broadcast_to(at_end[..., None, :], blocks.shape)
        upper = sp.csr_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))
        return sp.csr_array(upper + upper.T + sp.diags_array(diagonal))


@jax.jit
def _at_corners(
    lengths: Float[Array, " E"], topology: Topology
) -> tuple[Float[Array, "F 3 6"], Float[Array, "F 3 2 2"]]:
    """Strains of each face by the vectors at its corners, and transport backwards along each of its sides."""
    operator = Regge().eigenproblem(lengths, topology).A
    assert isinstance(operator, KillingOperator)
    strains = operator.corner_strains().reshape(-1, 3, 6)
    backwards = head_to_tail(edge_directions(lengths, topology))[topology.face_edges]
    along = (topology.face_edge_signs > 0)[..., None, None]
    return strains, jnp.where(along, backwards, backwards.mT)
