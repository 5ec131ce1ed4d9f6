"""Whether a mesh is fine enough for what was found on it: a zero may be the coarseness's."""

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from .geometry import subdivided, surface_area
from .killing import AbstractDiscretization, Dec, OnIntrinsicDelaunay, Pieces
from .mesh import Topology

TOO_COARSE = "too coarse to tell"
"""A judgement on fields that are not trusted, in words."""

_SMALL = 1.0  # λ · area below which a field would be called nearly symmetric
_GROWTH = 4.0  # of λ · area on the finer mesh, beyond `_SMALL`, that betrays coarseness
_FINE = 500  # vertices
_ENOUGH = 60  # vertices on the finer mesh: an octahedron takes two subdivisions


def trusted(
    discretization: AbstractDiscretization,
    lengths: Float[Array, " E"],
    topology: Topology,
    values: Float[Array, " k"],
) -> Bool[Array, " k"] | Bool[np.ndarray, " k"]:
    """Which of these eigenvalues the mesh is fine enough for.

    A mesh of few vertices has fewer edges than a field has components to be held by, and fields may stretch none of them. So
    where λ · area is small, the same surface is cut into finer triangles (intrinsically, 1 → 4) and solved again: a small
    eigenvalue that does not stay small is not trusted. Meshes of more than 500 vertices are trusted without, unless edges
    are few beside vertices, as on strips. Under `jit`, where no second mesh can be made, small eigenvalues are not trusted
    where they would have to be looked into.
    """
    lengths, values = jax.lax.stop_gradient((lengths, values))
    few_edges = topology.n_edges <= 2 * topology.n_vertices + 6
    if topology.n_vertices > _FINE and not few_edges:
        return np.ones(values.shape, bool)
    small = values * surface_area(lengths, topology) < _SMALL
    if any(isinstance(array, Tracer) for array in (small, topology.faces)):
        return ~small
    small = np.asarray(small)
    if not small.any():
        return ~small
    if isinstance(discretization, Dec | OnIntrinsicDelaunay):
        surface = discretization.triangulation(lengths, topology)
        lengths, topology = surface.lengths, surface.topology
    finer_lengths, finer = subdivided(lengths, topology)
    while finer.n_vertices < _ENOUGH:
        finer_lengths, finer = subdivided(finer_lengths, finer)
    count = int(small.sum())
    found = Pieces(finer_lengths, finer).smallest(np.arange(finer.n_faces), count)
    area = float(surface_area(lengths, topology))
    stays = found < np.maximum(_SMALL, _GROWTH * area * np.asarray(values)[small])
    return np.concatenate([stays, np.ones(len(small) - count, bool)])
