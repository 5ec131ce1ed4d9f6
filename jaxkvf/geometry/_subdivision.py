"""One triangle into four, of the surface itself: no vertex of R³ is asked."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..mesh import Topology


def subdivided(lengths: Float[Array, " E"], topology: Topology) -> tuple[Float[Array, " halves"], Topology]:
    """The same surface with every face cut into four at the midpoints of its sides. On the host.

    Vertices come first, then the midpoint of each edge; edges are the halves at the tails, those at the heads, and three in
    each face. Unit: length.
    """
    V, E, F = topology.n_vertices, topology.n_edges, topology.n_faces
    corners, sides = np.asarray(topology.faces), np.asarray(topology.face_edges)
    along = np.asarray(topology.face_edge_signs) > 0
    middles, inner = (
        V + sides,
        2 * E + np.arange(3 * F, dtype=np.int32).reshape(F, 3),
    )  # inner edge c cuts off corner c
    first_half, second_half = np.where(along, sides, E + sides), np.where(along, E + sides, sides)
    faces, edges, forward = (np.empty((F, 4, 3), kind) for kind in (np.int32, np.int32, bool))
    for c in range(3):
        faces[:, c] = np.stack([corners[:, c], middles[:, c], middles[:, c - 1]], axis=1)
        edges[:, c] = np.stack([first_half[:, c], inner[:, c], second_half[:, c - 1]], axis=1)
        forward[:, c] = np.stack([along[:, c], np.ones(F, bool), along[:, c - 1]], axis=1)
    faces[:, 3], edges[:, 3], forward[:, 3] = middles, np.roll(inner, -1, axis=1), False
    halves = np.asarray(lengths) / 2
    across = np.roll(halves[sides], -1, axis=1)  # side c + 1 lies opposite corner c
    finer = Topology.from_gluing(faces.reshape(-1, 3), edges.ravel(), forward.ravel(), V + E)
    return jnp.asarray(np.concatenate([halves, halves, across.ravel()])), finer
