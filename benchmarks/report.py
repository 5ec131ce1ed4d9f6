"""What an HTML report takes: seconds and bytes.

python benchmarks/report.py [--frequency 32] [-k 6]
"""

import argparse
import tempfile
import time
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

from jaxkvf import shapes  # noqa: E402
from jaxkvf.report import write_report  # noqa: E402
from jaxkvf.report._page import three_js  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frequency", type=int, default=32, help="of the spheroid: 10 f² + 2 vertices")
    parser.add_argument("-k", type=int, default=6, help="fields")
    options = parser.parse_args()

    mesh = shapes.ellipsoid(options.frequency)
    noisy = shapes.add_normal_noise(mesh, 0.05, seed=0)
    print(
        f"{mesh.topology.n_vertices:,} vertices, {options.k} fields; three.js: {len(three_js()) / 1e6:.2f} MB"
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "report.html"
        for name, other in (("one surface", None), ("two surfaces", mesh)):
            start = time.perf_counter()
            write_report(file, noisy, options.k, symmetrized=other)
            seconds = time.perf_counter() - start
            print(f"{name}: {file.stat().st_size / 1e6:.2f} MB, {seconds:.1f} s (compilation in the first)")


if __name__ == "__main__":
    main()
