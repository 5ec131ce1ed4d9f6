"""What a symmetrization has done to a mesh, in numbers that a reader can judge."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..fields import EXACT, killing_fields
from ..geometry import edge_lengths, face_normals, surface_area
from ..killing import Regge
from ..mesh import TriangleMesh
from ..trust import TOO_COARSE, trusted
from ._configuration import Configuration
from ._outcome import OUTCOMES, Symmetrization
from ._terms import metric_at_rest

_NAMED = 10  # triangles


class SymmetryReport(eqx.Module):
    """Before and after."""

    result: str
    """`"successful"`, or the message that says why not."""
    dimensionless_before: Float[np.ndarray, " k"]
    """λ · area of the first few fields of the input …"""
    dimensionless_after: Float[np.ndarray, " k"]
    """… and of the result."""
    trusted_before: Bool[np.ndarray, " k"]
    """Whether the mesh is fine enough for each of these: else it is too coarse to tell (see `KillingFields.trusted`)."""
    trusted_after: Bool[np.ndarray, " k"]
    rms_displacement: float
    """Root mean square displacement of the vertices, in mean edges of the input."""
    largest_displacement: float
    """In mean edges of the input."""
    displacements: Float[np.ndarray, " V"]
    """Of each vertex, in mean edges of the input."""
    stretches: Float[np.ndarray, " F"]
    """Of each face: by what factor, up or down, a length in it changed most; 1 where it is congruent to what it was."""
    smallest_angles: tuple[float, float]
    """Before and after. Degrees."""
    flipped_faces: int
    """Faces whose normal turned by a right angle or more."""
    steps: int
    """Of the minimiser, accepted or not."""

    @property
    def exact_before(self) -> int:
        """Number of trusted fields, among the first few, with λ · area below 1e-3: exact up to discretization."""
        return int(((self.dimensionless_before < EXACT) & self.trusted_before).sum())

    @property
    def exact_after(self) -> int:
        return int(((self.dimensionless_after < EXACT) & self.trusted_after).sum())

    @property
    def remark(self) -> str:
        """`"too coarse to tell"` where that holds of a field of the result; empty otherwise."""
        return "" if self.trusted_after.all() else TOO_COARSE

    @property
    def most_changed_faces(self) -> Int[np.ndarray, " n"]:
        """The ten most stretched faces, the most first."""
        return np.argsort(-self.stretches, kind="stable")[:_NAMED]

    def as_dict(self) -> dict[str, Any]:
        """Everything but the arrays over vertices and faces, ready for JSON."""
        worst = self.most_changed_faces
        return {
            "result": self.result,
            "exact_fields": {"before": self.exact_before, "after": self.exact_after},
            "remark": self.remark,
            "trusted": {"before": self.trusted_before.tolist(), "after": self.trusted_after.tolist()},
            "eigenvalues_times_area": {
                "before": self.dimensionless_before.tolist(),
                "after": self.dimensionless_after.tolist(),
            },
            "displacement_in_mean_edges": {
                "rms": self.rms_displacement,
                "largest": self.largest_displacement,
            },
            "smallest_angle_in_degrees": dict(zip(("before", "after"), self.smallest_angles, strict=True)),
            "flipped_faces": self.flipped_faces,
            "most_changed_faces": [
                {"face": int(face), "stretch": float(self.stretches[face])} for face in worst
            ],
            "steps": self.steps,
        }


def symmetry_report(mesh: TriangleMesh, done: Symmetrization) -> SymmetryReport:
    """What `done = symmetrize(mesh, …)` means. Faces and vertices are counted from 0.

    Raises:
        ValueError: `done` has no mesh, since edge lengths were optimised; or one of another connectivity.
    """
    if done.mesh is None:
        raise ValueError("a report is about moved vertices; here edge lengths were optimised")
    if done.mesh.vertices.shape != mesh.vertices.shape or done.mesh.faces.shape != mesh.faces.shape:
        raise ValueError("the symmetrization is of another mesh")
    displacements, stretches, flipped = _changes(Configuration.of(mesh), done.mesh)
    first, last = done.history[0], done.history[-1]
    after = killing_fields(done.mesh, len(first.dimensionless))
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    values = jnp.asarray(first.dimensionless, lengths.dtype) / surface_area(lengths, mesh.topology)
    return SymmetryReport(
        result=OUTCOMES[done.result] or "successful",
        dimensionless_before=first.dimensionless,
        dimensionless_after=np.asarray(after.dimensionless),
        trusted_before=np.asarray(trusted(Regge(), lengths, mesh.topology, values)),
        trusted_after=np.asarray(after.trusted),
        rms_displacement=float(np.sqrt((np.asarray(displacements) ** 2).mean())),
        largest_displacement=float(displacements.max()),
        displacements=np.asarray(displacements),
        stretches=np.asarray(stretches),
        smallest_angles=(first.smallest_angle, last.smallest_angle),
        flipped_faces=int(flipped),
        steps=done.stats["steps"],
    )


@jax.jit
def _changes(
    original: Configuration, mesh: TriangleMesh
) -> tuple[Float[Array, " V"], Float[Array, " F"], Int[Array, ""]]:
    moved = Configuration.of(mesh)
    displacements = jnp.linalg.norm(moved.vertices - original.vertices, axis=1) / original.unit
    g_11, g_22, g_12 = metric_at_rest(moved, original).T
    mean, half = 0.5 * (g_11 + g_22), jnp.hypot(0.5 * (g_11 - g_22), g_12)
    stretches = jnp.maximum(jnp.sqrt(mean + half), 1 / jnp.sqrt(mean - half))
    before, after = (face_normals(s.vertices, s.topology) for s in (original, moved))
    return displacements, stretches, ((before * after).sum(axis=1) <= 0).sum()
