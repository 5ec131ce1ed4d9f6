"""Our eigensolver against the others on the same matrices, to the same residual.

    python benchmarks/eigensolvers.py [--sizes 2.5k,10k,41k,164k,1M] [--meshes FOLDER] [-k 1,6,20] [--gpu]

Every solver runs in a process of its own, one after another in turn, so that peak memory is its own and a machine that
drifts drifts for all. Seconds are those of set-up (of the hierarchy, where there is one), assembly and solve together, the
median of `--rounds`; compilation is apart, as the first round's. A first call takes both: by that the default solver is
chosen (`--sizes 200k -k 6 --only SuperLU`, `--sizes 400k -k 6 --only CHOLMOD`). Residuals are ‖A x − λ B x‖ / (‖A‖ ‖x‖), the
worst of the k. Prints a table, and writes JSON and a plot; with `--json` of an earlier run its cases are kept and not run
again, so that a long table can be made in pieces. JAX's own `lobpcg_standard` has no B and finds the largest pairs: it does
not apply.
"""

import argparse
import functools
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

FREQUENCIES = {"2.5k": 16, "10k": 32, "41k": 64, "164k": 128, "200k": 142, "400k": 200, "1M": 316}
RESIDUAL = 1e-8
OURS = "jaxkvf LOBPCG + multigrid"
PEERS = {
    "SciPy eigsh": "shift-invert with its defaults",
    "SciPy eigsh, same residual": "shift-invert, asked for no more than ours, and one BLAS thread as ours have",
    "eigsh, SuperLU symmetric": "ScipyEigsh(SuperLU())",
    "eigsh, CHOLMOD": "ScipyEigsh(Cholmod())",
    "SciPy lobpcg, our multigrid": "scipy.sparse.linalg.lobpcg with our V-cycle as M",
    "SciPy lobpcg, PyAMG": "scipy.sparse.linalg.lobpcg with smoothed aggregation as M",
}
# Beyond these sizes a peer needs more than the patience or the memory that a table is worth.
LARGEST = {
    "SciPy eigsh": 170_000,
    "SciPy eigsh, same residual": 170_000,
    "SciPy lobpcg, PyAMG": 45_000,
    "eigsh, SuperLU symmetric": 250_000,
    "eigsh, CHOLMOD": 450_000,
}
_COLUMNS = (
    "mesh",
    "vertices",
    "k",
    "solver",
    "seconds",
    "compilation",
    "first call",
    "steps",
    "residual",
    "peak MiB",
    "ours faster by",
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--sizes", default="2.5k,10k,41k", help=f"of the bumpy sphere, among {', '.join(FREQUENCIES)}"
    )
    parser.add_argument("--meshes", type=Path, default=None, help="a folder of OBJ files to run on too")
    parser.add_argument("-k", default="1,6,20", help="numbers of eigenpairs")
    parser.add_argument("--rounds", type=int, default=3, help="repetitions in turn")
    parser.add_argument("--only", default=None, help="peers whose name contains this, beside ours")
    parser.add_argument(
        "--gpu", action="store_true", help="ours on the accelerator that JAX sees, the peers on the CPU"
    )
    parser.add_argument("--json", type=Path, default=None, help="read and write the figures here")
    parser.add_argument(
        "--plot", type=Path, default=None, help="write a plot of seconds against vertices here (PNG)"
    )
    parser.add_argument("--worker", default=None, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker is not None:
        print(json.dumps(_work(**json.loads(options.worker))))
        return

    cases = [("bumpy sphere", str(FREQUENCIES[size])) for size in options.sizes.split(",") if size]
    if options.meshes is not None:
        cases += [(path.stem, str(path)) for path in sorted(options.meshes.glob("*.obj"))]
    known = json.loads(options.json.read_text()) if options.json is not None and options.json.exists() else []
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as cache:
        for name, source in cases:
            for k in map(int, options.k.split(",")):
                of_case = [row for row in known if (row["source"], row["k"]) == (Path(source).name, k)]
                rows += of_case or _compare(name, source, k, options, cache)
                if options.json is not None:
                    others = [row for row in known if row not in rows]
                    options.json.write_text(json.dumps(others + rows, indent=1))
    _print_table(rows)
    if options.plot is not None:
        _plot(rows, options.plot)


def _compare(name: str, source: str, k: int, options: argparse.Namespace, cache: str) -> list[dict[str, Any]]:
    """Runs all solvers on one mesh in turn."""
    solvers = [OURS] + [peer for peer in PEERS if options.only is None or options.only in peer]
    runs: dict[str, list[dict[str, Any]]] = {solver: [] for solver in solvers}
    n_vertices = 0
    for _ in range(options.rounds):
        for solver in solvers:
            if n_vertices > LARGEST.get(solver, 10**9):
                continue
            run = _run_worker(cache, source=source, k=k, solver=solver, gpu=options.gpu)
            n_vertices = run.get("vertices", n_vertices)
            runs[solver].append(run)
            print(
                f"{name} {n_vertices} k = {k}, {solver}: {run.get('seconds', run.get('error'))}",
                file=sys.stderr,
            )
    rows = []
    for solver, done in runs.items():
        row: dict[str, Any] = {
            "mesh": name,
            "source": Path(source).name,
            "vertices": n_vertices,
            "k": k,
            "solver": solver,
        }
        good = [run for run in done if "error" not in run]
        if good:
            ratios = [run["seconds"] / ours["seconds"] for run, ours in zip(good, runs[OURS], strict=False)]
            row |= {key: float(np.median([run[key] for run in good])) for key in ("seconds", "peak_mib")}
            row |= {"compilation": good[0]["compilation"], "steps": good[0]["steps"]}
            row |= {"residual": max(run["residual"] for run in good), "ratio": float(np.median(ratios))}
            row["eigenvalues"] = good[0]["eigenvalues"]
        else:
            row["error"] = done[0]["error"] if done else "not run at this size"
        rows.append(row)
    return rows


def _print_table(rows: list[dict[str, Any]]) -> None:
    print("| " + " | ".join(_COLUMNS) + " |")
    print("| --- " * len(_COLUMNS) + "|")
    for row in rows:
        start = f"| {row['mesh']} | {row['vertices']:,} | {row['k']} | {row['solver']} |"
        if "error" in row:
            print(f"{start} {row['error']} | | | | | | |")
            continue
        ratio = "" if row["solver"] == OURS else f"{row['ratio']:.1f}×"
        compilation = f"{row['compilation']:.1f}" if row["compilation"] else ""
        first_call = f"{row['seconds'] + row['compilation']:.1f}"
        print(
            f"{start} {row['seconds']:.2f} | {compilation} | {first_call} | {row['steps'] or ''} | {row['residual']:.0e} | "
            f"{row['peak_mib']:.0f} | {ratio} |"
        )


def _run_worker(cache: str, **spec: Any) -> dict[str, Any]:
    environment = os.environ | {
        "JAX_COMPILATION_CACHE_DIR": cache
    }  # the first round compiles, the others find it
    if not (spec["gpu"] and spec["solver"] == OURS):
        environment |= {"JAX_PLATFORMS": "cpu"}
    ran = subprocess.run(
        [sys.executable, __file__, "--worker", json.dumps(spec)],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    if ran.returncode:
        return {"error": (ran.stderr.strip().splitlines() or ["died"])[-1][:120]}
    return json.loads(ran.stdout.strip().splitlines()[-1])


# In the worker -------------------------------------------------------------------------------------------------------


def _work(source: str, k: int, solver: str, gpu: bool) -> dict[str, Any]:
    del gpu  # JAX_PLATFORMS, set by the parent, says where to run
    import jax  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    import jaxkvf  # noqa: PLC0415
    from jaxkvf.geometry import edge_lengths  # noqa: PLC0415

    mesh = jaxkvf.shapes.bumpy_sphere(int(source)) if source.isdigit() else jaxkvf.TriangleMesh.load(source)
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    unit = lengths / np.sqrt(float(jaxkvf.geometry.surface_area(lengths, mesh.topology)))  # area 1
    method = _METHODS[solver]
    compiles = solver not in ("SciPy eigsh", "SciPy eigsh, same residual", "SciPy lobpcg, PyAMG")
    start = time.perf_counter()
    method(unit, mesh.topology, k) if compiles else _problem(unit, mesh.topology)
    first = time.perf_counter() - start
    start = time.perf_counter()
    values, vectors, steps = method(unit, mesh.topology, k)
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "vertices": mesh.topology.n_vertices,
        "seconds": seconds,
        "compilation": max(first - seconds, 0.0) if compiles else 0.0,
        "steps": steps,
        "residual": _residual(unit, mesh.topology, values, vectors),
        "peak_mib": peak,
        "eigenvalues": np.asarray(values).tolist(),
    }


def _problem(lengths: Any, topology: Any) -> Any:
    import jax  # noqa: PLC0415

    return jax.block_until_ready(_assembly()(lengths, topology))


@functools.cache
def _assembly() -> Callable[..., Any]:
    """Compiled once for all calls."""
    import equinox as eqx  # noqa: PLC0415

    from jaxkvf.eigen import GeneralizedEigenproblem  # noqa: PLC0415
    from jaxkvf.killing import Regge  # noqa: PLC0415
    from jaxkvf.sparse import assembled  # noqa: PLC0415

    @eqx.filter_jit
    def assemble(lengths: Any, topology: Any) -> Any:
        problem = Regge().eigenproblem(lengths, topology)
        return GeneralizedEigenproblem(assembled(problem.A), assembled(problem.B))

    return assemble


def _matrices(lengths: Any, topology: Any) -> tuple[Any, Any, float]:
    from jaxkvf.sparse import to_scipy  # noqa: PLC0415

    problem = _problem(lengths, topology)
    A, B = to_scipy(problem.A), to_scipy(problem.B)
    return A, B, float(np.median(A.diagonal() / B.diagonal()) / A.shape[0])


def _residual(lengths: Any, topology: Any, values: Any, vectors: Any) -> float:
    A, B, _ = _matrices(lengths, topology)
    from scipy.sparse.linalg import eigsh  # noqa: PLC0415

    norm = float(eigsh(A, 1, which="LM", return_eigenvectors=False, tol=1e-2)[0])
    x = np.asarray(vectors)
    r = A @ x - (B @ x) * np.asarray(values)
    return float((np.linalg.norm(r, axis=0) / np.linalg.norm(x, axis=0)).max() / norm)


def _multigrid(lengths: Any, topology: Any) -> Any:
    from jaxkvf.killing import vector_hierarchy  # noqa: PLC0415
    from jaxkvf.preconditioning import Multigrid  # noqa: PLC0415

    return Multigrid(vector_hierarchy(lengths, topology))


def _ours(lengths: Any, topology: Any, k: int) -> tuple[Any, Any, int]:
    import jax  # noqa: PLC0415

    from jaxkvf.eigen import LOBPCG, eigsolve  # noqa: PLC0415

    solver = LOBPCG(rtol=RESIDUAL, preconditioner=_multigrid(lengths, topology))
    solution = jax.block_until_ready(eigsolve(_problem(lengths, topology), k, solver))
    return solution.eigenvalues, solution.eigenvectors, int(solution.stats["steps"])


def _eigsh_defaults(lengths: Any, topology: Any, k: int) -> tuple[Any, Any, int]:
    from scipy.sparse.linalg import eigsh  # noqa: PLC0415

    A, B, shift = _matrices(lengths, topology)
    values, vectors = eigsh(A.tocsc(), k, B.tocsc(), sigma=-shift, which="LM")
    return values, vectors, 0


def _eigsh_same_residual(lengths: Any, topology: Any, k: int) -> tuple[Any, Any, int]:
    from scipy.sparse.linalg import eigsh  # noqa: PLC0415
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    A, B, shift = _matrices(lengths, topology)
    with threadpool_limits(1, user_api="blas"):
        values, vectors = eigsh(A.tocsc(), k, B.tocsc(), sigma=-shift, which="LM", tol=RESIDUAL)
    return values, vectors, 0


def _factorized(factorization: str) -> Callable[..., tuple[Any, Any, int]]:
    def solve(lengths: Any, topology: Any, k: int) -> tuple[Any, Any, int]:
        from jaxkvf import eigen  # noqa: PLC0415

        solver = eigen.ScipyEigsh(getattr(eigen, factorization)(), rtol=RESIDUAL)
        solution = eigen.eigsolve(_problem(lengths, topology), k, solver)
        return solution.eigenvalues, solution.eigenvectors, int(solution.stats["solves"])

    return solve


def _scipy_lobpcg(
    lengths: Any, topology: Any, k: int, preconditioner: Any, start: Any
) -> tuple[Any, Any, int]:
    from scipy.sparse.linalg import LinearOperator, lobpcg  # noqa: PLC0415

    A, B, _ = _matrices(lengths, topology)
    n, width = A.shape[0], k + max(2, k // 5)
    if start is None:
        start = np.random.default_rng(0).standard_normal((n, width))
    norm = abs(A).sum(axis=1).max()
    M = LinearOperator(
        (n, n), matvec=lambda x: preconditioner(x.reshape(n, -1)).ravel(), matmat=preconditioner
    )
    # Its tolerance is absolute, for vectors of unit B-norm: ‖x‖ is about the root of the typical entry of B⁻¹.
    tolerance = RESIDUAL * norm / np.sqrt(np.median(B.diagonal()))
    values, vectors, history = lobpcg(
        A,
        np.asarray(start)[:, :width],
        B,
        M,
        tol=tolerance,
        maxiter=500,
        largest=False,
        retResidualNormsHistory=True,
    )
    order = np.argsort(values)[:k]
    return values[order], vectors[:, order], len(history)


def _lobpcg_our_multigrid(lengths: Any, topology: Any, k: int) -> tuple[Any, Any, int]:
    import jax.numpy as jnp  # noqa: PLC0415

    prepare, apply, starting_vectors = _cycle_functions()
    cycle = prepare(_multigrid(lengths, topology), _problem(lengths, topology))
    start = np.asarray(starting_vectors(cycle, k + max(2, k // 5)))
    return _scipy_lobpcg(lengths, topology, k, lambda x: np.asarray(apply(cycle, jnp.asarray(x))), start)


@functools.cache
def _cycle_functions() -> tuple[Callable[..., Any], ...]:
    import equinox as eqx  # noqa: PLC0415

    return (
        eqx.filter_jit(lambda multigrid, problem: multigrid.prepare(problem)),
        eqx.filter_jit(lambda cycle, x: cycle.apply(x)),
        eqx.filter_jit(lambda cycle, count: cycle.starting_vectors(count)),
    )


def _lobpcg_pyamg(lengths: Any, topology: Any, k: int) -> tuple[Any, Any, int]:
    import pyamg  # noqa: PLC0415

    A, B, shift = _matrices(lengths, topology)
    K = (A + shift * B).tobsr((2, 2))
    K.indptr, K.indices = K.indptr.astype(np.int32), K.indices.astype(np.int32)
    import scipy.sparse as sp  # noqa: PLC0415

    hierarchy = pyamg.smoothed_aggregation_solver(sp.bsr_matrix((K.data, K.indices, K.indptr), shape=K.shape))
    cycle = hierarchy.aspreconditioner()
    return _scipy_lobpcg(
        lengths, topology, k, lambda x: np.stack([cycle.matvec(c) for c in x.T], axis=1), None
    )


_METHODS: dict[str, Callable[..., tuple[Any, Any, int]]] = {
    OURS: _ours,
    "SciPy eigsh": _eigsh_defaults,
    "SciPy eigsh, same residual": _eigsh_same_residual,
    "eigsh, SuperLU symmetric": _factorized("SuperLU"),
    "eigsh, CHOLMOD": _factorized("Cholmod"),
    "SciPy lobpcg, our multigrid": _lobpcg_our_multigrid,
    "SciPy lobpcg, PyAMG": _lobpcg_pyamg,
}


def _plot(rows: list[dict[str, Any]], path: Path) -> None:
    import matplotlib.pyplot as plt  # noqa: PLC0415

    figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
    spheres = [row for row in rows if row["mesh"] == "bumpy sphere" and row["k"] == 6 and "seconds" in row]
    for solver in dict.fromkeys(row["solver"] for row in spheres):
        points = sorted((row["vertices"], row["seconds"]) for row in spheres if row["solver"] == solver)
        axes.loglog(*zip(*points, strict=True), "o-", label=solver, linewidth=2.5 if solver == OURS else 1.2)
    axes.set(xlabel="vertices", ylabel="seconds", title=f"6 smallest eigenpairs, residual {RESIDUAL:.0e}")
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main()
