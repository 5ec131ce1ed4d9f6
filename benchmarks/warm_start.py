"""What a guess saves: LOBPCG steps on a moved mesh from the fields before the move, from nested iteration and from nothing.

    python benchmarks/warm_start.py [--sizes 32,64] [--meshes FILE ...] [-k 6]

Every vertex of a bumpy sphere of such frequencies, and of each OBJ file, is moved by about 1 % of the mean edge length:
along its normal or in a random direction. All starts have the same hierarchy, made before the move; residual 1e-8.
Seconds are the median of five solves, without compilation, hierarchy and assembly.
"""

import argparse
import time
from pathlib import Path

import equinox as eqx
import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import jaxkvf  # noqa: E402
from jaxkvf import shapes  # noqa: E402
from jaxkvf.eigen import LOBPCG, GeneralizedEigenproblem, eigsolve  # noqa: E402
from jaxkvf.geometry import edge_lengths  # noqa: E402
from jaxkvf.killing import Regge, vector_hierarchy  # noqa: E402
from jaxkvf.preconditioning import Multigrid  # noqa: E402
from jaxkvf.sparse import assembled  # noqa: E402

BY = 0.01  # of the mean edge length


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", default="32,64", help="frequencies of bumpy spheres: 10 f² + 2 vertices")
    parser.add_argument("--meshes", type=Path, nargs="*", default=[], help="OBJ files")
    parser.add_argument("-k", type=int, default=6, help="eigenpairs")
    options = parser.parse_args()

    meshes = {f"bumpy sphere {f}": shapes.bumpy_sphere(int(f)) for f in options.sizes.split(",") if f}
    meshes |= {path.stem: jaxkvf.TriangleMesh.load(path) for path in options.meshes}
    print("| mesh | vertices | moved | start | steps | seconds |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name, mesh in meshes.items():
        lengths = edge_lengths(mesh.vertices, mesh.topology)
        multigrid = Multigrid(vector_hierarchy(lengths, mesh.topology))
        solver = LOBPCG(rtol=1e-8, preconditioner=multigrid)
        before = eigsolve(problem(mesh), options.k, solver).eigenvectors
        starts = {
            "the fields before": before,
            "nested iteration": None,
            "random": jax.random.normal(jax.random.key(0), (len(before), options.k + 2)),
        }
        moves = {
            "along normals": shapes.add_normal_noise(mesh, BY, seed=0),
            "in random directions": mesh.with_vertices(
                mesh.vertices + BY * lengths.mean() * directions(mesh)
            ),
        }
        for move, moved in moves.items():
            near = problem(moved)
            for start, guess in starts.items():
                steps, seconds = solved(near, options.k, solver, guess)
                n = mesh.topology.n_vertices
                print(f"| {name} | {n:,} | {move} | {start} | {steps} | {seconds:.3f} |", flush=True)


def problem(mesh: jaxkvf.TriangleMesh) -> GeneralizedEigenproblem:
    return _assembled(edge_lengths(mesh.vertices, mesh.topology), mesh.topology)


@eqx.filter_jit
def _assembled(lengths: jax.Array, topology: jaxkvf.Topology) -> GeneralizedEigenproblem:
    parts = Regge().eigenproblem(lengths, topology)
    return GeneralizedEigenproblem(assembled(parts.A), assembled(parts.B))


def directions(mesh: jaxkvf.TriangleMesh) -> np.ndarray:
    """A unit vector a vertex."""
    vectors = np.random.default_rng(0).standard_normal(mesh.vertices.shape)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def solved(
    near: GeneralizedEigenproblem, k: int, solver: LOBPCG, guess: jax.Array | None
) -> tuple[int, float]:
    solution = jax.block_until_ready(eigsolve(near, k, solver, guess=guess))  # compiles
    seconds = []
    for _ in range(5):
        start = time.perf_counter()
        jax.block_until_ready(eigsolve(near, k, solver, guess=guess))
        seconds.append(time.perf_counter() - start)
    return int(solution.stats["steps"]), float(np.median(seconds))


if __name__ == "__main__":
    main()
