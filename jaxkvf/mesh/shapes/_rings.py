"""Rings of vertices around the z axis, stitched to surfaces of revolution."""

import numpy as np
from jaxtyping import Float, Int

FEWEST_AROUND = 6


def rings_around_axis(
    radii: Float[np.ndarray, " rings"],
    heights: Float[np.ndarray, " rings"],
    counts: Int[np.ndarray, " rings"],
    *,
    staggered: bool = True,
    periodic: bool = False,
) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
    """Vertices evenly spaced on circles around the z axis, and triangles between neighbouring circles.

    Args:
        radii: of the circles; a circle of radius 0 is a pole.
        heights: their z.
        counts: vertices on each, ≥ 3, or 1 at a pole.
        staggered: turns every other circle by half a step, which makes triangles between equal circles isosceles.
        periodic: joins the last circle to the first.

    Returns:
        Positions, and faces that are counter-clockwise seen from outside; seen from above if the surface is flat.
    """
    phases = np.arange(len(counts)) % 2 if staggered else np.zeros_like(counts)
    ring = np.repeat(np.arange(len(counts)), counts)
    angle = np.pi * (2 * _count_within(counts) + phases[ring]) / counts[ring]
    radius = radii[ring]
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), heights[ring]], axis=1)
    faces = _stitch(counts, phases, periodic=periodic)
    r, z = (np.append(a, a[0]) if periodic else a for a in (radii, heights))
    volume = ((r[1:] ** 2 + r[1:] * r[:-1] + r[:-1] ** 2) * np.diff(z)).sum()  # of the solid, times 3/π
    inside_out = volume < 0 or (volume == 0 and r[-1] > r[0])
    return vertices, faces[:, ::-1] if inside_out else faces


def counts_for_spacing(radii: Float[np.ndarray, " rings"], spacing: float) -> Int[np.ndarray, " rings"]:
    """Vertices on each circle for edges about `spacing` long, at least six; one where the radius is 0."""
    counts = np.maximum(FEWEST_AROUND, np.rint(2 * np.pi * radii / spacing)).astype(np.int64)
    return np.where(radii == 0, 1, counts)


def _stitch(
    counts: Int[np.ndarray, " rings"], phases: Int[np.ndarray, " rings"], *, periodic: bool
) -> Int[np.ndarray, "F 3"]:
    """Triangles between each ring and the next.

    Every edge of a ring is joined to the vertex of the other ring that is nearest in angle to the edge's midpoint.
    That merges the two rings' edges in the order of their midpoints' angles, so the triangles fit together; in ties
    the lower ring comes first. Angles are compared as fractions of integers, exactly.
    """
    lower = np.arange(len(counts) if periodic else len(counts) - 1)
    upper = (lower + 1) % len(counts)
    upward = _fans(counts, phases, lower, upper, base_first=True)
    downward = _fans(counts, phases, upper, lower, base_first=False)
    return np.concatenate([upward, downward[:, ::-1]])


def _fans(
    counts: Int[np.ndarray, " rings"],
    phases: Int[np.ndarray, " rings"],
    base: Int[np.ndarray, " pairs"],
    apex: Int[np.ndarray, " pairs"],
    *,
    base_first: bool,
) -> Int[np.ndarray, "f 3"]:
    """The triangles on the edges of each ring `base` with apexes on the ring `apex`."""
    edges = np.where(counts[base] > 1, counts[base], 0)
    i = _count_within(edges)
    n, p, m, q = (np.repeat(a, edges) for a in (counts[base], phases[base], counts[apex], phases[apex]))
    # Edges of the apex ring with a midpoint before this edge's: (2 j + q + 1) / m < (2 i + p + 1) / n, or ≤.
    numerator = (2 * i + p + 1) * m - (q + 1) * n
    passed = -(-numerator // (2 * n)) if base_first else numerator // (2 * n) + 1
    starts = np.cumsum(counts) - counts
    first, opposite = np.repeat(starts[base], edges), np.repeat(starts[apex], edges)
    return np.stack([first + i, first + (i + 1) % n, opposite + passed % m], axis=1)


def _count_within(counts: Int[np.ndarray, " rings"]) -> Int[np.ndarray, " V"]:
    """0, 1, …, counts[0] − 1, 0, 1, …, counts[1] − 1, …"""
    return np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
