"""What a report tells of a surface, as arrays: fields, where they stretch it, periods, flow lines."""

import warnings
from collections.abc import Callable

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from ..arguments import Integer
from ..fields import KillingFields, component_shares, killing_fields
from ..flows import NoPeriodError, Period, integral_curves, period
from ..geometry import SurfacePoints, spread_evenly
from ..killing import AbstractDiscretization, killing_energy_density
from ..mesh import TriangleMesh

LINES = 64
"""Flow lines of each field at most, and curves that its period is taken from: as many, so that tracing is compiled once."""
_LEAST = 4
"""Flow lines sought on what is small."""
CARRIED = 0.01
"""Share of ∫|U|², relative to the largest, from which on a component counts as one that carries the field."""
_APART = 0.4
"""Least distance between a line's start and the lines before it, in mean distances between starts."""
_STEPS = 160
_MOVING = 0.1
"""Share of the largest speed below which no flow line starts: it would be a dot."""


class FlowLines(eqx.Module):
    """Integral curves of a field, as polylines in its faces."""

    positions: Float[np.ndarray, "n s 3"]
    """Points at equal times. Unit: length."""
    faces: Int[np.ndarray, "n s"]
    """The face of each point."""
    counts: Int[np.ndarray, " n"]
    """How many points each has until it leaves the surface."""
    durations: Float[np.ndarray, " n"]
    """The time that all s points take: the period, where there is one. Unit: time of the unit-norm field, length²."""


class Contents(eqx.Module):
    """A surface and its k fields, as a report shows them."""

    mesh: TriangleMesh
    fields: KillingFields
    shares: Float[np.ndarray, "k C"]
    """Share of ∫|U|² of each field on each component of the mesh."""
    strains: Float[np.ndarray, "k V"]
    """‖KU‖ at the vertices, pointwise, the mean of the faces around in the square. Unit: length⁻²."""
    periods: tuple[Period | None, ...]
    """None where no integral curve closes."""
    lines: tuple[FlowLines, ...]


def contents(
    mesh: TriangleMesh,
    k: Integer = 6,
    *,
    discretization: str | AbstractDiscretization = "regge",
    callback: Callable[[str], object] | None = None,
) -> Contents:
    """Everything that a report tells of one surface.

    Args:
        mesh: the surface.
        k: number of fields.
        discretization: as for `killing_fields`.
        callback: called with what is done next, in words.

    Raises:
        ValueError: as for `killing_fields`.
        equinox.EquinoxRuntimeError: the eigensolver failed.
    """

    def say(what: str) -> None:
        if callback is not None:
            callback(what)

    say(f"solving for {k} fields on {mesh.topology.n_vertices} vertices")
    fields = killing_fields(mesh, k, discretization=discretization)
    vectors, shares = np.asarray(fields.vectors), component_shares(mesh, fields)
    strains, periods, lines = [], [], []
    for i, field in enumerate(vectors):
        say(f"following field {i} of {k}")
        strains.append(_strain(mesh, field))
        periods.append(_period(mesh, field))
        lines.append(_lines(mesh, field, shares[i], periods[-1]))
    return Contents(mesh, fields, shares, np.stack(strains), tuple(periods), tuple(lines))


def _strain(mesh: TriangleMesh, field: Float[np.ndarray, "V 3"]) -> Float[np.ndarray, " V"]:
    x, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    areas = _face_areas(x, faces)
    density = np.asarray(killing_energy_density(mesh, mesh.vertices.dtype.type(field)))
    corners, each = faces.ravel(), np.repeat(areas, 3)
    energy = np.bincount(corners, np.repeat(areas * density, 3), len(x))
    return np.sqrt(energy / np.bincount(corners, each, len(x)))


def _period(mesh: TriangleMesh, field: Float[np.ndarray, "V 3"]) -> Period | None:
    with warnings.catch_warnings():  # the page tells how many curves close
        warnings.simplefilter("ignore", UserWarning)
        try:
            return period(mesh, field, curves=LINES)
        except NoPeriodError:  # that is what the report will say
            return None


def _lines(
    mesh: TriangleMesh, field: Float[np.ndarray, "V 3"], shares: Float[np.ndarray, " C"], found: Period | None
) -> FlowLines:
    """On the components that carry the field, each in its own time: else those of a speck would go round it without end."""
    x, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    count, label = mesh.topology.components()
    on = label[faces[:, 0]]
    areas = np.bincount(on, _face_areas(x, faces), count)
    speed = np.linalg.norm(field, axis=1)
    fastest = np.zeros(count)
    np.maximum.at(fastest, label, speed)
    carries = shares > CARRIED * shares.max()
    moving = np.flatnonzero((speed[faces].mean(axis=1) > _MOVING * fastest[on]) & carries[on])
    # Where all that moves is a speck, fewer: as many as its extent, not its area, is of the whole.
    wanted = max(round(LINES * np.sqrt(areas[carries].sum() / areas.sum())), _LEAST)
    starts = spread_evenly(x, faces[moving], wanted)
    # On a component with the share s of a unit-norm field and the area a its root mean square speed is √(s/a): in this time
    # it goes half around a sphere of this area.
    durations = np.sqrt(np.pi) * areas / np.sqrt(np.maximum(shares, CARRIED * shares.max()))
    if found is not None:
        durations[found.component] = found.period
    first = moving[starts.faces]
    padded = np.resize(np.arange(wanted), LINES)  # always as many: tracing is compiled once
    curves = integral_curves(
        mesh,
        field,
        durations[on[first]][padded],
        SurfacePoints(first[padded], starts.barycentric[padded]),
        samples=_STEPS,
    )
    lines = curves.polylines()[:wanted]
    kept = _apart(lines, _APART * starts.spacing)
    counts = np.array([len(lines[i]) for i in kept])
    positions, passed = np.asarray(curves.positions)[kept], np.asarray(curves.points.faces)[kept]
    return FlowLines(positions, passed, counts, durations[on[first[kept]]])


def _face_areas(x: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> Float[np.ndarray, " F"]:
    a, b, c = np.moveaxis(x[faces], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def _apart(lines: list[Float[np.ndarray, "_ 3"]], distance: float) -> list[int]:
    """Those lines that do not start next to one that is kept already: closed curves would lie on top of each other."""
    kept: list[int] = []
    for i, line in enumerate(lines):
        if all(np.linalg.norm(lines[j] - line[0], axis=1).min() > distance for j in kept):
            kept.append(i)
    return kept
