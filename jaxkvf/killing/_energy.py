"""The Killing energy of a given field."""

import equinox as eqx
from jaxtyping import Array, Float

from ..geometry import edge_lengths, project, vertex_frames
from ..mesh import TriangleMesh
from ._dec import Dec
from ._discretization import AbstractDiscretization
from ._on_delaunay import OnIntrinsicDelaunay
from ._regge import Regge, energy_density

_BY_NAME: dict[str, AbstractDiscretization] = {
    "regge": Regge(),
    "dec": Dec(),
    "regge-delaunay": OnIntrinsicDelaunay(Regge()),
}


def discretization_named(discretization: str | AbstractDiscretization) -> AbstractDiscretization:
    """`"regge"`, `"dec"` or `"regge-delaunay"` as an object; an object as it is.

    Raises:
        ValueError: another name.
    """
    if isinstance(discretization, AbstractDiscretization):
        return discretization
    if discretization not in _BY_NAME:
        raise ValueError(f"discretization must be one of {', '.join(_BY_NAME)}, got {discretization!r}")
    return _BY_NAME[discretization]


def _intrinsic(mesh: TriangleMesh, vectors: Float[Array, "V 3"]) -> Float[Array, "V 2"]:
    if vectors.shape != mesh.vertices.shape:
        raise ValueError(
            f"vectors must have shape [{mesh.vertices.shape[0]}, 3], one a vertex, got {list(vectors.shape)}"
        )
    return project(vectors, vertex_frames(mesh.vertices, mesh.topology))


@eqx.filter_jit
def killing_energy(
    mesh: TriangleMesh,
    vectors: Float[Array, "V 3"],
    *,
    discretization: str | AbstractDiscretization = "regge",
) -> Float[Array, ""]:
    """E_K(U) = ∫‖KU‖² of a vertex field in R³ (its normal part is dropped); λ is this for a unit-norm field.

    Integrated, scale-free for vectors in units of length, quadratic in U; 0 for an exact Killing field. Definition 5.

    Raises:
        ValueError: shape of `vectors` or name of the discretization.
    """
    chosen = discretization_named(discretization)
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    coefficients = chosen.from_vertex_vectors(_intrinsic(mesh, vectors), lengths, mesh.topology)
    return chosen.energy(coefficients, lengths, mesh.topology)


@eqx.filter_jit
def killing_energy_density(mesh: TriangleMesh, vectors: Float[Array, "V 3"]) -> Float[Array, " F"]:
    """‖KU‖² in each face (discretization `regge`), pointwise: where the surface fails to be symmetric along U.

    Unit: (vector / length)². Its integral is `killing_energy`.

    Raises:
        ValueError: shape of `vectors`.
    """
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    return energy_density(_intrinsic(mesh, vectors), lengths, mesh.topology)
