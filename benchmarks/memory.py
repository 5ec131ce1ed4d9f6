"""Peak memory of eigensolvers, and what `jaxkvf.solvers.working_memory` expects, which refuses what will not fit.

    python benchmarks/memory.py [--sizes 32,64,128] [-k 6]

Bumpy spheres of such frequencies (10 f² + 2 vertices). Each solve runs in a process of its own, twice: the second time no
program is compiled. Memory is by how much more a mesh takes than the one before, for each vertex that it has more: what
Python, JAX and compiled programs take is left out, some 300 MiB with LOBPCG.
"""

import argparse
import itertools
import json
import os
import resource
import subprocess
import sys
import tempfile
from typing import Any

SOLVERS = ("LOBPCG + multigrid", "Cholmod", "SuperLU")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", default="32,64,128", help="frequencies of bumpy spheres")
    parser.add_argument("-k", type=int, default=6, help="eigenpairs")
    parser.add_argument("--only", default="", help="solvers whose name contains this")
    parser.add_argument("--worker", default=None, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker is not None:
        print(json.dumps(work(**json.loads(options.worker))))
        return
    frequencies = [int(f) for f in options.sizes.split(",")]
    print("| vertices | discretization | solver | kB a vertex | expected |")
    print("| --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as cache:
        for discretization, solver in itertools.product(("regge", "dec"), SOLVERS):
            if options.only not in solver:
                continue
            spec = {"discretization": discretization, "solver": solver, "k": options.k}
            found = [measured(cache, frequency=f, **spec) for f in frequencies]
            for small, large in itertools.pairwise(found):
                more = {key: large[key] - small[key] for key in large}
                kilobytes = " | ".join(
                    f"{more[key] / more['vertices'] / 1000:.1f}" for key in ("peak", "expected")
                )
                print(f"| {large['vertices']:,} | {discretization} | {solver} | {kilobytes} |", flush=True)


def measured(cache: str, **spec: Any) -> dict[str, Any]:
    for _ in range(2):
        environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": cache, "JAX_PLATFORMS": "cpu"}
        command = [sys.executable, __file__, "--worker", json.dumps(spec)]
        ran = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    return json.loads(ran.stdout.strip().splitlines()[-1])


def work(frequency: int, discretization: str, solver: str, k: int) -> dict[str, Any]:
    import jax  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    import jaxkvf  # noqa: PLC0415
    from jaxkvf import eigen  # noqa: PLC0415
    from jaxkvf.killing import discretization_named  # noqa: PLC0415
    from jaxkvf.solvers import working_memory  # noqa: PLC0415

    mesh = jaxkvf.shapes.bumpy_sphere(frequency)
    if solver == "LOBPCG + multigrid":
        method = jaxkvf.multigrid_solver(mesh, discretization=discretization)
    else:
        method = eigen.ScipyEigsh(getattr(eigen, solver)())
    jax.block_until_ready(jaxkvf.killing_fields(mesh, k, discretization=discretization, solver=method))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    expected = working_memory(mesh.topology, discretization_named(discretization), k, method)
    return {
        "vertices": mesh.topology.n_vertices,
        "peak": peak,
        "expected": expected,
    }


if __name__ == "__main__":
    main()
