"""The log map: normal coordinates around a vertex."""

import numpy as np
from jaxtyping import Float

from ..extras import extra
from ..geometry import edge_lengths, spoke_angles
from ..mesh import TriangleMesh


def log_map(mesh: TriangleMesh, vertex: int, direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "V 2"]:
    """Normal coordinates around `vertex`, the first axis along `direction`; infinite where there are none. Unit: length.

    By the vector heat method, through potpourri3d; its frame is turned so that the neighbours of the vertex have the
    directions of its polar frame.

    Reference: N. Sharp, Y. Soliman, K. Crane, The vector heat method (2019).

    Raises:
        ImportError: potpourri3d is not installed.
    """
    x, topology = np.asarray(mesh.vertices, np.float64), mesh.topology
    solver = extra("potpourri3d").MeshVectorHeatSolver(x, np.asarray(mesh.faces, np.int64))
    found = np.asarray(solver.compute_log_map(vertex))
    starts = np.asarray(topology.spoke_starts)
    spokes = slice(starts[vertex], starts[vertex + 1])
    neighbours = np.asarray(topology.spoke_neighbours)[spokes]
    angles = np.asarray(spoke_angles(edge_lengths(mesh.vertices, topology), topology))[spokes]
    offset = x[neighbours] - x[vertex]
    # Angles of spokes and of `direction` in one frame: that in which the neighbours' offsets fit their polar angles best.
    normal = np.cross(offset, np.roll(offset, -1, axis=0)).sum(axis=0)
    normal /= np.linalg.norm(normal)
    first = offset[0] - (offset[0] @ normal) * normal
    first /= np.linalg.norm(first)
    flat = offset @ first + 1j * (offset @ np.cross(normal, first))
    turn = np.angle((flat * np.exp(-1j * angles)).sum())
    heading = np.angle(direction @ first + 1j * (direction @ np.cross(normal, first))) - turn
    z = found[:, 0] + 1j * found[:, 1]
    z = z - z[vertex]
    rotation = np.angle((np.exp(1j * (angles - heading)) * np.conj(z[neighbours])).sum())
    z = z * np.exp(1j * rotation)
    torn = (
        np.linalg.norm(x - x[vertex], axis=1)
        > _LONGEST_CHORD * np.abs(z) + np.linalg.norm(offset, axis=1).max()
    )
    z[torn] = np.inf  # nearer by the chart than in space: beyond the cut locus
    return np.stack([z.real, z.imag], axis=1)


_LONGEST_CHORD = 1.1
