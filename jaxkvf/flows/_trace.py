"""All tracers at once through the faces of a mesh: one step takes each to the next side of its face."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._face_fields import LEAVES, FaceField

ARRIVED, LEFT, STATIONARY, UNFINISHED = range(4)

_ORDER = 8
_SHARE = 0.125
"""Taylor order of exp(τJ) and largest τ‖∇U‖ of a step: the remainder, _SHARE⁹/9!, is below rounding."""
_NEWTON_STEPS = 5
_NOWHERE = 3
_MOST_AT_ONE_POINT = 64
"""Faces a tracer may pass without getting anywhere: more than meet in any vertex of a sane mesh, so that it stands still."""


class Tracers(NamedTuple):
    """Where each tracer is: a point in a face, and how long it has still to go."""

    face: Int[Array, " N"]
    barycentric: Float[Array, "3 N"]
    time_left: Float[Array, " N"]
    status: Int[Array, " N"]
    entered: Int[Array, " N"]
    """Corner opposite the side on which the tracer has just come in; `_NOWHERE` otherwise."""
    waits: Int[Array, " N"]
    """Crossings in a row without getting anywhere."""


def trace(
    field: FaceField,
    face: Int[Array, " N"],
    barycentric: Float[Array, "N 3"],
    time: Float[Array, " N"],
    max_steps: int | Int[Array, ""],
) -> tuple[Tracers, Int[Array, ""]]:
    """Tracers after `time` ≥ 0 along the field, and the steps that took."""
    start = departed(field, face, barycentric, time)

    def goes_on(carry: tuple[Tracers, Int[Array, ""]]) -> Bool[Array, ""]:
        tracers, steps = carry
        return (tracers.status == UNFINISHED).any() & (steps < max_steps)

    def body(carry: tuple[Tracers, Int[Array, ""]]) -> tuple[Tracers, Int[Array, ""]]:
        tracers, steps = carry
        return advanced(field, tracers, motion(field, tracers)), steps + 1

    return jax.lax.while_loop(goes_on, body, (start, jnp.zeros((), jnp.int32)))


def departed(
    field: FaceField, face: Int[Array, " N"], barycentric: Float[Array, "N 3"], time: Float[Array, " N"]
) -> Tracers:
    """Tracers about to go for `time`, those at vertices in the face into which the field points."""
    b = barycentric.T
    none = jnp.full_like(face, _NOWHERE)
    start = Tracers(face, b, time, jnp.full_like(face, UNFINISHED), none, jnp.zeros_like(face))
    corner = jnp.argmax(b, axis=0).astype(face.dtype)
    at_vertex = b.max(axis=0) >= 1 - _tolerance(b)
    code = field.exits[3 * field.n_faces + 3 * face + corner]
    start = _depart(start, at_vertex, code)
    return start._replace(status=jnp.where(time > 0, start.status, ARRIVED))


def _tolerance(b: Array) -> float:
    return 1e4 * float(jnp.finfo(b.dtype).eps)


class Motion(NamedTuple):
    """The next step of each tracer, within its face."""

    terms: list[Float[Array, "3 N"]]
    """Taylor terms of the barycentric coordinates in time."""
    step: Float[Array, " N"]
    """Up to the side that it meets, or as far as the series reaches. Unit: time."""
    crosses: Bool[Array, " N"]
    corner: Int[Array, " N"]
    """Opposite the side that it crosses."""
    end: Float[Array, "3 N"]


def motion(field: FaceField, old: Tracers) -> Motion:
    """How tracers go on in their faces, exactly."""
    J01, J02, J10, J12, J20, J21, rate, _ = field.velocities[old.face].T
    J00, J11, J22 = -(J10 + J20), -(J01 + J21), -(J02 + J12)
    b = old.barycentric

    terms = [b]
    for n in range(1, _ORDER + 1):
        x, y, z = terms[-1]
        image = jnp.stack(
            [J00 * x + J01 * y + J02 * z, J10 * x + J11 * y + J12 * z, J20 * x + J21 * y + J22 * z]
        )
        terms.append(image * (1.0 / n))

    longest = jnp.minimum(old.time_left, _SHARE / jnp.where(rate > 0, rate, jnp.finfo(b.dtype).tiny))
    entered = jnp.arange(3, dtype=old.entered.dtype)[:, None] == old.entered[None]
    crossing = _first_zero(terms, entered, longest)
    corner = jnp.argmin(crossing, axis=0).astype(old.face.dtype)
    soonest = crossing.min(axis=0)
    crosses = soonest <= longest
    step = jnp.where(crosses, soonest, longest)
    b = jnp.maximum(horner(terms, step[None]), 0.0)
    opposite = jnp.arange(3, dtype=corner.dtype)[:, None] == corner[None]
    b = jnp.where(opposite & crosses[None], 0.0, b)
    return Motion(terms, step, crosses, corner, b / b.sum(axis=0, keepdims=True))


def advanced(field: FaceField, old: Tracers, moved: Motion) -> Tracers:
    """Tracers after a step: in the next face, where it met a side."""
    b, corner, step, crosses = moved.end, moved.corner, moved.step, moved.crosses
    # Across the side, or around the vertex if the tracer ran into one.
    at_vertex = crosses & (b.max(axis=0) >= 1 - _tolerance(b))
    vertex_corner = jnp.argmax(b, axis=0).astype(corner.dtype)
    side = (corner + 1) % 3
    code = field.exits[3 * old.face + jnp.where(at_vertex, 3 * field.n_faces + vertex_corner, side)]
    time_left = old.time_left - step
    stands = jnp.abs(b - old.barycentric).max(axis=0) <= _tolerance(b)
    waits = jnp.where(stands & crosses, old.waits + 1, 0)
    there = old._replace(
        barycentric=b, time_left=time_left, waits=waits, entered=jnp.full_like(corner, _NOWHERE)
    )
    new = _cross(there, crosses & ~at_vertex, code, side)
    new = _depart(new, at_vertex, code)
    status = jnp.where(new.status == UNFINISHED, jnp.where(time_left <= 0, ARRIVED, new.status), new.status)
    status = jnp.where((status == UNFINISHED) & (waits > _MOST_AT_ONE_POINT), STATIONARY, status)
    new = new._replace(status=status)
    active = old.status == UNFINISHED
    return jax.tree.map(
        lambda after, before: jnp.where(active if after.ndim == 1 else active[None], after, before), new, old
    )


def _first_zero(
    terms: list[Float[Array, "3 N"]], entered: Bool[Array, "3 N"], longest: Float[Array, " N"]
) -> Float[Array, "3 N"]:
    """First time in [0, longest] at which each barycentric coordinate falls through zero; infinite where it does not.

    A coordinate that starts at zero is divided by τ, which takes away that zero. A step is short against the field's
    variation, so a coordinate has at most one extremum in it. On the side just entered it is the end of the step that
    tells whether the tracer goes on inside: where the field is tangent to the side, the sign at the start is rounding.
    """
    zero = jnp.zeros_like(terms[0])
    on_side = terms[0] == 0
    g = [jnp.where(on_side, later, now) for now, later in zip(terms, [*terms[1:], zero], strict=True)]
    slope = [n * c for n, c in enumerate(g)][1:]
    curvature = [n * c for n, c in enumerate(slope)][1:]
    end = jnp.broadcast_to(longest[None], zero.shape)
    g_end, slope_end = horner(g, end), horner(slope, end)

    dips = (g[0] > 0) & (slope[0] < 0) & (slope_end > 0)
    lowest = end * slope[0] / jnp.where(dips, slope[0] - slope_end, 1.0)
    for _ in range(2):
        bend = horner(curvature, lowest)
        lowest = jnp.clip(lowest - horner(slope, lowest) / jnp.where(bend > 0, bend, jnp.inf), 0.0, end)
    upper = jnp.where(dips, lowest, end)
    g_upper = jnp.where(dips, horner(g, lowest), g_end)
    falls = (g_upper < 0) | ((g[0] < 0) & ~entered)

    secant = upper * g[0] / jnp.where(g_upper < 0, g[0] - g_upper, 1.0)
    # What rises first is concave: its parabola says where it falls, and Newton comes from the right.
    concave = (slope[0] >= 0) & (g[2] < 0)
    discriminant = jnp.sqrt(jnp.where(concave, g[1] * g[1] - 4 * g[2] * g[0], 0.0))
    beyond = (g[1] + discriminant) / jnp.where(concave, -2 * g[2], 1.0)
    tau = jnp.where(slope[0] < 0, secant, jnp.where(concave, jnp.minimum(beyond, upper), upper))
    for _ in range(_NEWTON_STEPS):
        descent = horner(slope, tau)
        tau = jnp.clip(tau - horner(g, tau) / jnp.where(descent < 0, descent, -jnp.inf), 0.0, upper)
    return jnp.where(falls, jnp.where(g[0] > 0, tau, 0.0), jnp.inf)


def horner(terms: list[Float[Array, "..."]], tau: Float[Array, "..."]) -> Float[Array, "..."]:
    value = terms[-1]
    for term in terms[-2::-1]:
        value = value * tau + term
    return value


def _cross(
    tracers: Tracers, where: Bool[Array, " N"], code: Int[Array, " N"], side: Int[Array, " N"]
) -> Tracers:
    """Over a side into the neighbour, in which the side starts where it ended here."""
    leaves, enters = where & (code == LEAVES), where & (code != LEAVES)
    b = tracers.barycentric
    at_start, at_end = _pick(b, side), _pick(b, (side + 1) % 3)
    face, new_side = code // 3, code % 3
    index = jnp.arange(3, dtype=side.dtype)[:, None]
    there = jnp.where(
        index == new_side[None],
        at_end[None],
        jnp.where(index == ((new_side + 1) % 3)[None], at_start[None], 0.0),
    )
    return tracers._replace(
        face=jnp.where(enters, face, tracers.face),
        barycentric=jnp.where(enters[None], there, b),
        status=jnp.where(leaves, LEFT, tracers.status),
        entered=jnp.where(enters, (new_side + 2) % 3, tracers.entered),
    )


def _depart(tracers: Tracers, where: Bool[Array, " N"], code: Int[Array, " N"]) -> Tracers:
    """From a vertex into the face into which its vector points."""
    goes = where & (code >= 0)
    corner = jnp.arange(3, dtype=code.dtype)[:, None] == (code % 3)[None]
    status = jnp.where(where & (code < 0), jnp.where(code == LEAVES, LEFT, STATIONARY), tracers.status)
    return tracers._replace(
        face=jnp.where(goes, code // 3, tracers.face),
        barycentric=jnp.where(goes[None], corner.astype(tracers.barycentric.dtype), tracers.barycentric),
        status=status,
    )


def _pick(b: Float[Array, "3 N"], index: Int[Array, " N"]) -> Float[Array, " N"]:
    return jnp.where(index == 0, b[0], jnp.where(index == 1, b[1], b[2]))
