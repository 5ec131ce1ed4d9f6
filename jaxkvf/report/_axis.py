"""The axis that a shape stands on in pictures."""

import numpy as np
from jaxtyping import Float

from ..fields import KillingFields
from ..geometry import barycentric_vertex_areas, closest_rigid_motion, edge_lengths
from ..mesh import TriangleMesh

_RIGID = 0.15
"""Misfit up to which a field counts as a rigid motion."""
_ROTATES = 0.3
"""Least speed of the rotation in it, at the radius of gyration, relative to the field's own."""
_ONE_AXIS = 0.15
"""Most of the second axis, relative to the first, where there is one alone."""
_CARRIED = 0.01


def symmetry_axis(mesh: TriangleMesh, fields: KillingFields) -> Float[np.ndarray, "3"] | None:
    """Unit direction of the one axis that the fields of least λ turn the largest component about; None without one.

    A sphere has many, a bent sheet's symmetries are no rotations of space. An infinitesimal rigid motion is fitted to each
    field of the first cluster. On the host.
    """
    count, label = mesh.topology.components()
    x = np.asarray(mesh.vertices, np.float64)
    areas = np.asarray(barycentric_vertex_areas(edge_lengths(mesh.vertices, mesh.topology), mesh.topology))
    largest = np.bincount(label, areas, count).argmax()
    weights = np.where(label == largest, areas, 0.0)
    vectors, clusters = np.asarray(fields.vectors, np.float64), np.asarray(fields.clusters)
    squared = (vectors**2).sum(axis=2)
    carried = np.flatnonzero(squared @ weights > _CARRIED * (squared @ areas))
    if not carried.size:
        return None
    turns = []
    for i in carried[clusters[carried] == clusters[carried[0]]]:
        motion = closest_rigid_motion(x, vectors[i], weights)
        if motion.misfit < _RIGID:
            gyration = np.sqrt(weights @ ((x - motion.center) ** 2).sum(axis=1) / weights.sum())
            speed = np.sqrt(squared[i] @ weights / weights.sum())
            turns.append(motion.rotation * gyration / speed)
    if not turns:
        return None
    _, sizes, axes = np.linalg.svd(np.array(turns))
    alone = len(sizes) == 1 or sizes[1] < _ONE_AXIS * sizes[0]
    return axes[0] if sizes[0] > _ROTATES and alone else None
