"""When integral curves come back to where they started: found in each face that they pass, however large it is."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..geometry import SurfacePoints, embed, project, surface_positions, vertex_frames
from ..mesh import TriangleMesh
from ._face_fields import FaceField, tracing_field
from ._trace import ARRIVED, UNFINISHED, Tracers, advanced, departed, horner, motion

_NEAR = 0.25
"""A crossing of the plane at the start counts as a return within this share of the furthest that the curve has been."""
_NEWTON_STEPS = 4


class Returns(NamedTuple):
    """The first return of each curve across the plane through its start normal to the field there, close to it."""

    times: Float[Array, " c"]
    """NaN where there is none. Unit: time."""
    lengths: Float[Array, " c"]
    """Length of each curve until then, or as far as it was followed. Unit: length."""
    misses: Float[Array, " c"]
    """How far from its start each comes back; NaN where it does not. Unit: length."""


class _Curves(NamedTuple):
    tracers: Tracers
    beyond: Float[Array, " c"]
    """How far each is beyond its plane."""
    furthest: Float[Array, " c"]
    gone: Float[Array, " c"]
    length: Float[Array, " c"]
    miss: Float[Array, " c"]


def first_returns(
    mesh: TriangleMesh,
    vectors: Float[Array, "V 3"],
    start: SurfacePoints,
    horizon: Float[Array, " c"],
    max_steps: int | Int[Array, ""],
) -> Returns:
    """The first return of the integral curve through each point within the time `horizon`."""
    return _returns(mesh, vectors, tracing_field(mesh, vectors), start, horizon, max_steps=max_steps)


@jax.jit
def _returns(
    mesh: TriangleMesh,
    vectors: Float[Array, "V 3"],
    field: FaceField,
    start: SurfacePoints,
    horizon: Float[Array, " c"],
    *,
    max_steps: int | Int[Array, ""],
) -> Returns:
    corners = mesh.vertices[mesh.faces]
    frames = vertex_frames(mesh.vertices, mesh.topology)
    tangential = embed(project(vectors, frames), frames)
    ahead = jnp.einsum("nc,ncx->nx", start.barycentric, tangential[mesh.faces[start.faces]])
    ahead = ahead / jnp.linalg.norm(ahead, axis=1, keepdims=True)
    origin = surface_positions(mesh, start)

    def goes_on(carry: tuple[_Curves, Int[Array, ""]]) -> Bool[Array, ""]:
        curves, steps = carry
        return (curves.tracers.status == UNFINISHED).any() & (steps < max_steps)

    def body(carry: tuple[_Curves, Int[Array, ""]]) -> tuple[_Curves, Int[Array, ""]]:
        curves, steps = carry
        offsets = corners[curves.tracers.face % len(corners)] - origin[:, None]
        return _further(field, curves, offsets, ahead), steps + 1

    zero = jnp.zeros_like(horizon)
    tracers = departed(field, start.faces, start.barycentric, horizon)
    curves = _Curves(tracers, zero, zero, zero, zero, jnp.full_like(zero, jnp.nan))
    curves, _ = jax.lax.while_loop(goes_on, body, (curves, jnp.zeros((), jnp.int32)))
    times = jnp.where(jnp.isnan(curves.miss), jnp.nan, curves.gone)
    return Returns(times, curves.length, curves.miss)


def _further(
    field: FaceField, old: _Curves, offsets: Float[Array, "c 3 3"], ahead: Float[Array, "c 3"]
) -> _Curves:
    """One step more. `offsets`: from each start to the corners of the face that its curve is in."""
    moved = motion(field, old.tracers)
    beyond = _polynomial(moved.terms, jnp.einsum("ncx,nx->nc", offsets, ahead)[..., None])
    beyond_terms = [term[:, 0] for term in beyond]
    places = _polynomial(moved.terms, offsets)
    velocity = [n * term for n, term in enumerate(places)][1:]

    at_end = horner(beyond_terms, moved.step)
    crosses = (old.beyond < 0) & (at_end >= 0)
    slope = [n * term for n, term in enumerate(beyond_terms)][1:]
    rise = at_end - beyond_terms[0]
    tau = moved.step * jnp.clip(-beyond_terms[0] / jnp.where(rise > 0, rise, 1.0), 0.0, 1.0)
    for _ in range(_NEWTON_STEPS):
        climb = horner(slope, tau)
        change = horner(beyond_terms, tau) / jnp.where(climb > 0, climb, jnp.inf)
        tau = jnp.clip(tau - change, 0.0, moved.step)
    miss = jnp.linalg.norm(horner(places, tau[:, None]), axis=1)
    going = old.tracers.status == UNFINISHED
    returns = going & crosses & (miss < _NEAR * old.furthest)

    gone = jnp.where(returns, tau, moved.step)
    speeds = [jnp.linalg.norm(horner(velocity, (share * gone)[:, None]), axis=1) for share in (0.0, 0.5, 1.0)]
    length = gone * (speeds[0] + 4 * speeds[1] + speeds[2]) / 6  # Simpson: the speed hardly varies in a step
    distance = jnp.linalg.norm(horner(places, moved.step[:, None]), axis=1)
    new = advanced(field, old.tracers, moved)
    return _Curves(
        new._replace(status=jnp.where(returns, ARRIVED, new.status)),
        jnp.where(going, at_end, old.beyond),
        jnp.where(going, jnp.maximum(old.furthest, distance), old.furthest),
        jnp.where(going, old.gone + gone, old.gone),
        jnp.where(going, old.length + length, old.length),
        jnp.where(returns, miss, old.miss),
    )


def _polynomial(
    terms: list[Float[Array, "3 c"]], at_corners: Float[Array, "c 3 d"]
) -> list[Float[Array, "c d"]]:
    """Taylor terms of what is linear in a face, from those of the barycentric coordinates."""
    return [jnp.einsum("cn,ncd->nd", term, at_corners) for term in terms]
