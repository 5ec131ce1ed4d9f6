"""Peak memory of eigensolvers, and what `jaxkvf.solvers.working_memory` expects, which refuses what will not fit.

    python benchmarks/memory.py [--sizes 32,64] [-k 6]

Bumpy spheres of such frequencies (10 f² + 2 vertices). Each solve runs in a process of its own, twice: the second time no
program is compiled. Memory is what the resident set has grown by since the mesh was made, at its largest, a vertex.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from typing import Any

SOLVERS = ("LOBPCG + multigrid", "Cholmod", "SuperLU", "DenseEigh")
DENSE_UP_TO = 3_000  # vertices


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", default="32,64", help="frequencies of bumpy spheres")
    parser.add_argument("-k", type=int, default=6, help="eigenpairs")
    parser.add_argument("--only", default="", help="solvers whose name contains this")
    parser.add_argument("--worker", default=None, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker is not None:
        print(json.dumps(work(**json.loads(options.worker))))
        return
    print("| vertices | discretization | solver | kB a vertex | expected |")
    print("| --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as cache:
        for frequency in map(int, options.sizes.split(",")):
            for discretization in ("regge", "dec"):
                for solver in (name for name in SOLVERS if options.only in name):
                    if solver == "DenseEigh" and 10 * frequency**2 > DENSE_UP_TO:
                        continue
                    spec = {"frequency": frequency, "discretization": discretization, "solver": solver}
                    print(row(measured(cache, k=options.k, **spec), discretization, solver), flush=True)


def row(found: dict[str, Any], discretization: str, solver: str) -> str:
    n = found["vertices"]
    kilobytes = " | ".join(f"{found[key] / n / 1000:.1f}" for key in ("grew_by", "expected"))
    return f"| {n:,} | {discretization} | {solver} | {kilobytes} |"


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
    before = resident()
    if solver == "LOBPCG + multigrid":
        method = jaxkvf.multigrid_solver(mesh, discretization=discretization)
    elif solver == "DenseEigh":
        method = eigen.DenseEigh()
    else:
        method = eigen.ScipyEigsh(getattr(eigen, solver)())
    jax.block_until_ready(jaxkvf.killing_fields(mesh, k, discretization=discretization, solver=method))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    expected = working_memory(mesh.topology, discretization_named(discretization), k, method)
    return {
        "vertices": mesh.topology.n_vertices,
        "grew_by": peak - before,
        "expected": expected,
    }


def resident() -> int:
    """Bytes of memory that this process has at the moment."""
    pages = int(open("/proc/self/statm").read().split()[1])  # noqa: PTH123, SIM115
    return pages * resource.getpagesize()


if __name__ == "__main__":
    main()
