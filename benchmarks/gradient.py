"""What the gradient costs: value and gradient of λ₀ against the eigensolve alone, paired in one run.

python benchmarks/gradient.py [--frequency 32] [--repeats 9]
"""

import argparse
import time

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import jaxkvf  # noqa: E402
from jaxkvf import shapes  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frequency", type=int, default=32, help="of the spheroid: 10 f² + 2 vertices")
    parser.add_argument("--repeats", type=int, default=9)
    options = parser.parse_args()

    mesh = shapes.add_normal_noise(shapes.ellipsoid(options.frequency), 0.02, seed=0)

    def lowest(x: jax.Array) -> jax.Array:
        return jaxkvf.killing_eigenvalues(mesh.with_vertices(x), 1)[0]

    programs = {"value": jax.jit(lowest), "value and gradient": jax.jit(jax.value_and_grad(lowest))}
    seconds: dict[str, list[float]] = {name: [] for name in programs}
    print(f"{mesh.topology.n_vertices} vertices, λ₀ of `regge`, default solver")
    for name, program in programs.items():
        start = time.perf_counter()
        jax.block_until_ready(program(mesh.vertices))
        print(f"{name}: first call, with compilation, {time.perf_counter() - start:.2f} s")
    for _ in range(options.repeats):
        for name, program in programs.items():
            start = time.perf_counter()
            jax.block_until_ready(program(mesh.vertices))
            seconds[name].append(time.perf_counter() - start)
    value, both = (np.array(seconds[name]) for name in programs)
    print(f"value: median {np.median(value):.3f} s; value and gradient: median {np.median(both):.3f} s")
    print(f"ratio, pair by pair: median {np.median(both / value):.2f}")


if __name__ == "__main__":
    main()
