"""What a report tells of a surface, as arrays: fields, where they stretch it, periods, flow lines."""

import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..arguments import Integer
from ..fields import KillingFields, killing_fields
from ..flows import NoPeriodError, Period, integral_curves, period
from ..geometry import SurfacePoints, spread_evenly
from ..killing import AbstractDiscretization, killing_energy_density
from ..mesh import TriangleMesh

_LIVES = 1e-2
"""Share of the largest ∫|U| of a component below which no flow line starts on another."""
LINES = 64
"""Flow lines of each field at most, and curves that its period is taken from: as many, so that tracing is compiled once."""
_APART = 0.4
"""Least distance between a line's start and the lines before it, in mean distances between starts."""
_STEPS = 160
_MOVING = 0.1
"""Share of the largest speed below which no flow line starts: it would be a dot."""


class FlowLines(NamedTuple):
    """Integral curves of a field, as polylines in its faces."""

    positions: Float[np.ndarray, "n s 3"]
    """Points at equal times. Unit: length."""
    faces: Int[np.ndarray, "n s"]
    """The face of each point."""
    counts: Int[np.ndarray, " n"]
    """How many points each has until it leaves the surface."""
    duration: float
    """The time that all s points take: the period, where there is one. Unit: time of the unit-norm field, length²."""


class Contents(NamedTuple):
    """A surface and its k fields, as a report shows them."""

    mesh: TriangleMesh
    fields: KillingFields
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
    vectors = np.asarray(fields.vectors)
    strains, periods, lines = [], [], []
    for i, field in enumerate(vectors):
        say(f"following field {i} of {k}")
        strains.append(_strain(mesh, field))
        periods.append(_period(mesh, field))
        lines.append(_lines(mesh, field, float(fields.area), periods[-1]))
    return Contents(mesh, fields, np.stack(strains), tuple(periods), tuple(lines))


def _strain(mesh: TriangleMesh, field: Float[np.ndarray, "V 3"]) -> Float[np.ndarray, " V"]:
    x, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    a, b, c = np.moveaxis(x[faces], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
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
    mesh: TriangleMesh, field: Float[np.ndarray, "V 3"], area: float, found: Period | None
) -> FlowLines:
    x, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    moving = np.flatnonzero(_moves(mesh, field))
    starts = spread_evenly(x, faces[moving], LINES)
    # A unit-norm field has the root mean square speed 1/√area: in this time it goes half around a sphere of this area.
    duration = np.sqrt(np.pi) * area if found is None else found.period
    curves = integral_curves(
        mesh, field, duration, SurfacePoints(moving[starts.faces], starts.barycentric), samples=_STEPS
    )
    lines = curves.polylines()
    kept = _apart(lines, _APART * starts.spacing)
    counts = np.array([len(lines[i]) for i in kept])
    return FlowLines(
        np.asarray(curves.positions)[kept], np.asarray(curves.points.faces)[kept], counts, float(duration)
    )


def _moves(mesh: TriangleMesh, field: Float[np.ndarray, "V 3"]) -> Bool[np.ndarray, " F"]:
    """The faces in which the field moves, measured by the fastest of the same component, where there is any field at all."""
    x, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    count, label = mesh.topology.components()
    component, speed = label[faces[:, 0]], np.linalg.norm(field, axis=1)[faces].mean(axis=1)
    a, b, c = np.moveaxis(x[faces], 1, 0)
    flux = np.bincount(component, speed * np.linalg.norm(np.cross(b - a, c - a), axis=1), count)
    most = np.zeros(count)
    np.maximum.at(most, component, speed)
    return (speed > _MOVING * most[component]) & (flux > _LIVES * flux.max())[component]


def _apart(lines: list[Float[np.ndarray, "_ 3"]], distance: float) -> list[int]:
    """Those lines that do not start next to one that is kept already: closed curves would lie on top of each other."""
    kept: list[int] = []
    for i, line in enumerate(lines):
        if all(np.linalg.norm(lines[j] - line[0], axis=1).min() > distance for j in kept):
            kept.append(i)
    return kept
