"""Tracing the vertices of a spheroid for a whole period, against VTK's surface streamlines (through pyvista), in one run.

python benchmarks/streamlines.py [--frequency 64] [--every 1]

The same seeds and lengths. VTK integrates with its defaults (Runge–Kutta 4(5), surface streamlines) and bounds the length of
a line, not its time: the seeds are grouped by the circles they are on, each group with the length of its circle.
"""

import argparse
import time

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import pyvista  # noqa: E402

from jaxkvf import shapes  # noqa: E402
from jaxkvf.flows import FlowStatus, flow  # noqa: E402
from jaxkvf.geometry import surface_positions, vertex_points  # noqa: E402

_GROUPS = 16


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frequency", type=int, default=64, help="of the spheroid: 10 f² + 2 vertices")
    parser.add_argument("--every", type=int, default=1, help="trace every n-th vertex only, both")
    parser.add_argument("--repeats", type=int, default=3, help="of ours; the median counts")
    options = parser.parse_args()

    mesh = shapes.ellipsoid(options.frequency)
    x = np.asarray(mesh.vertices)
    turn = np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1)
    seeds = np.flatnonzero(np.hypot(x[:, 0], x[:, 1]) > 1e-6)[:: options.every]
    print(f"{mesh.topology.n_vertices} vertices, {len(seeds)} tracers, one period (2π)")

    points = vertex_points(mesh, seeds)
    seconds = []
    for _ in range(options.repeats + 1):
        start = time.perf_counter()
        end = flow(mesh, jnp.asarray(turn), 2 * np.pi, points)
        jax.block_until_ready(end)
        seconds.append(time.perf_counter() - start)
    there = np.asarray(surface_positions(mesh, end.points))
    gap = np.linalg.norm(there - x[seeds], axis=1)
    finished = int((np.asarray(end.status) == FlowStatus.ARRIVED).sum())
    ours = float(np.median(seconds[1:]))
    print(
        f"jaxkvf.flow: first call, with compilation, {seconds[0]:.2f} s; median {ours:.2f} s; "
        f"{finished} finished, mean gap after the period {gap.mean():.1e}"
    )

    surface = pyvista.PolyData.from_regular_faces(x, np.asarray(mesh.faces))
    surface["turn"] = turn
    radius = np.hypot(*x[seeds, :2].T)
    theirs, lines, complete = 0.0, 0, 0
    for group in np.array_split(np.argsort(radius), min(_GROUPS, len(seeds))):
        length = 2 * np.pi * float(radius[group].mean())
        start = time.perf_counter()
        found = surface.streamlines_from_source(
            pyvista.PolyData(x[seeds[group]]),
            vectors="turn",
            surface_streamlines=True,
            integration_direction="forward",
            max_length=length,
            max_steps=1_000_000,
        )
        theirs += time.perf_counter() - start
        lengths = found.compute_cell_sizes()["Length"]
        lines += found.n_lines
        complete += int((lengths > 0.98 * length).sum())
    print(f"VTK: {theirs:.2f} s; {lines} lines, {complete} of full length")
    print(f"ratio VTK / jaxkvf.flow: {theirs / ours:.1f}")


if __name__ == "__main__":
    main()
