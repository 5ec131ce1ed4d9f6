"""How fast the flow becomes an isometry under refinement: edge lengths of a spheroid after a period, and their order in h.

python benchmarks/isometry.py [--frequencies 8 16 32]
"""

import argparse

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

from jaxkvf import geometry, shapes  # noqa: E402
from jaxkvf.flows import isometry_error  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--frequencies", type=int, nargs="+", default=[8, 16, 32], help="of the spheroids: 10 f² + 2 vertices"
    )
    print("spheroid 1 : 1 : 1.6, rotation about its axis for a whole period (2π)")
    print("| vertices | relative RMS change of edge lengths | largest |\n| --- | --- | --- |")
    h, errors = [], []
    for frequency in parser.parse_args().frequencies:
        mesh = shapes.ellipsoid(frequency)
        x = np.asarray(mesh.vertices)
        turn = np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1)
        found = isometry_error(mesh, jnp.asarray(turn), 2 * np.pi)
        h.append(float(geometry.edge_lengths(mesh.vertices, mesh.topology).mean()))
        errors.append(float(found.relative_rms))
        print(f"| {len(x)} | {found.relative_rms:.2e} | {found.largest:.2e} |", flush=True)
    order = np.polyfit(np.log(h), np.log(errors), 1)[0]
    print(f"order in h: {order:.2f}")


if __name__ == "__main__":
    main()
