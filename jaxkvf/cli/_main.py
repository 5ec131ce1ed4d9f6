"""The command line: `jaxkvf fields MESH`, `jaxkvf symmetrize [MESH] -o OUT`, and what `_mesh`, `_flow` and
`_report` add.

Exit codes: 0 done, 1 could not (a message says why) or the mesh has errors, 2 wrong use.
"""

import argparse
import io
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from ..fields import KillingFields, killing_fields
from ..files import write_whole
from ..geometry import edge_lengths, mean_edge_length, normal_displacements
from ..mesh import Attributes, TriangleMesh, read_attributes, shapes
from ..symmetrization import OUTCOMES, Step, SymmetryReport, symmetrize, symmetry_report
from ._flow import add_flow_commands
from ._mesh import add_mesh_commands
from ._report import add_report_command
from ._terminal import (
    READABLE,
    add_up_option,
    as_options,
    check_writable,
    draw_picture,
    positive,
    save_mesh,
    size_of,
    upright,
    with_suffix,
)

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

_WRITABLE = (".obj", ".ply", ".off", ".stl")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code."""
    options = _parser().parse_args(arguments)
    try:
        from rich.console import Console  # noqa: PLC0415
    except ImportError:
        print('jaxkvf: the command line needs rich: pip install "jaxkvf[cli]"', file=sys.stderr)
        return 1
    console = Console(stderr=options.json)
    _enable_float64_and_cache()
    try:
        report = options.run(options, console)
    except (ValueError, OSError, RuntimeError, MemoryError, ImportError) as failure:
        print(f"jaxkvf: {as_options(_message(failure))}", file=sys.stderr)
        return 1
    if options.json:
        json.dump(report, sys.stdout, indent=2)
        print()
    return 0 if report.get("ok", True) else 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="jaxkvf", description="Continuous intrinsic symmetry of triangle meshes: Killing vector fields."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    fields = commands.add_parser(
        "fields", help="the approximate Killing fields of a mesh", description=_fields.__doc__
    )
    fields.add_argument("mesh", type=Path, metavar="MESH", help=f"a {READABLE} file")
    fields.add_argument("-k", type=positive, default=6, help="number of fields (default: 6)")
    fields.add_argument("--discretization", choices=("regge", "regge-delaunay", "dec"), default="regge")
    fields.add_argument(
        "-o", "--output", type=with_suffix(".npz"), metavar="NPZ", help="write eigenvalues and vectors here"
    )
    fields.set_defaults(run=_fields)

    symmetrize = commands.add_parser(
        "symmetrize",
        help="move the vertices until the symmetry is exact",
        description=_symmetrize.__doc__,
    )
    symmetrize.add_argument(
        "mesh",
        type=Path,
        nargs="?",
        metavar="MESH",
        help=f"a {READABLE} file; by default a built-in noisy vase",
    )
    symmetrize.add_argument(
        "-o",
        "--output",
        type=with_suffix(*_WRITABLE),
        required=True,
        metavar="OUT",
        help="the mesh to write",
    )
    symmetrize.add_argument(
        "--count", type=positive, default=1, help="number of symmetries to make exact (default: 1)"
    )
    symmetrize.add_argument(
        "--max-steps", type=positive, default=500, help="most evaluations of the objective (default: 500)"
    )
    symmetrize.add_argument(
        "--changes",
        type=with_suffix(".ply"),
        metavar="PLY",
        help="write the result once more, coloured by how far vertices moved and how much triangles were stretched",
    )
    symmetrize.set_defaults(run=_symmetrize)

    add_mesh_commands(commands, READABLE, with_suffix(*_WRITABLE))
    add_report_command(commands)
    for command in (fields, symmetrize, *add_flow_commands(commands)):
        command.add_argument("--json", action="store_true", help="print the result as JSON")
        add_up_option(command)
        picture = command.add_mutually_exclusive_group()
        picture.add_argument(
            "--picture", type=with_suffix(".png"), metavar="PNG", help="where to put the picture"
        )
        picture.add_argument("--no-picture", action="store_true", help="draw nothing")
    return parser


def _fields(options: argparse.Namespace, console: "Console") -> dict[str, Any]:
    """Finds the k tangent fields of smallest Killing energy; λ·area near 0 means a continuous intrinsic symmetry."""
    check_writable(options.output, options.picture)
    with console.status("reading"):
        mesh = TriangleMesh.load(options.mesh)
    with console.status(f"solving for {options.k} fields on {mesh.topology.n_vertices} vertices"):
        found = killing_fields(mesh, options.k, discretization=options.discretization)
        found.eigenvalues.block_until_ready()
    console.print(_table(found, f"{options.mesh.name}: {size_of(mesh)}"))

    if options.output is not None:
        content = io.BytesIO()
        np.savez(
            content,
            eigenvalues=np.asarray(found.eigenvalues),
            vectors=np.asarray(found.vectors),
            area=np.asarray(found.area),
        )
        write_whole(options.output, content.getvalue())
        console.print(f"wrote {options.output}")

    def draw(path: Path) -> None:
        from ..viz import Scene, render  # noqa: PLC0415

        vertices, faces, vectors = _arrays(mesh, found)
        scenes = [
            Scene(vertices, faces, f"λ·area = {value:.3g}", vectors=field)
            for value, field in zip(np.asarray(found.dimensionless)[:4], vectors[:4], strict=True)
        ]
        render(path, scenes, size=(480 * len(scenes), 540), view=upright(options, mesh, found))

    picture = options.picture or Path(f"{options.mesh.stem}-fields.png")
    drawn = draw_picture(draw, picture, options, console)
    return {"mesh": str(options.mesh), **_describe(mesh, found), "picture": drawn}


def _symmetrize(options: argparse.Namespace, console: "Console") -> dict[str, Any]:
    """Moves the vertices of a nearly symmetric mesh until its continuous intrinsic symmetry is exact."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn  # noqa: PLC0415

    check_writable(options.output, options.changes, options.picture)
    with console.status("reading"):
        if options.mesh is None:
            attributes = Attributes()
            name, mesh = (
                "built-in vase, noise of 5 % of the mean edge",
                shapes.add_normal_noise(shapes.vase(), 0.05, seed=0),
            )
        else:
            name, mesh = options.mesh.name, TriangleMesh.load(options.mesh)
            attributes = read_attributes(options.mesh)

    columns = (
        TextColumn("symmetrizing"),
        BarColumn(),
        TextColumn("λ·area = {task.fields[asymmetry]:.2e}"),
        TimeElapsedColumn(),
    )
    # Drawn seldom: each drawing takes time from the optimizer.
    with Progress(*columns, console=console, transient=True, refresh_per_second=2) as progress:
        task = progress.add_task("", total=options.max_steps, asymmetry=float("nan"))

        def show(step: Step) -> None:
            asymmetry = step.dimensionless[: options.count].sum()
            progress.update(task, completed=step.evaluations, asymmetry=asymmetry)

        done = symmetrize(mesh, options.count, max_steps=options.max_steps, callback=show)
    if done.mesh is None or done.result == OUTCOMES.eigensolver_failed:
        raise RuntimeError(OUTCOMES[done.result])
    result = done.mesh
    save_mesh(result, options.output, attributes, console)

    k = options.count + 2
    before, after = killing_fields(mesh, k), killing_fields(result, k)
    console.print(_table(before, f"before ({name}: {size_of(mesh)})"))
    console.print(_table(after, "after"))
    account = symmetry_report(mesh, done)
    console.print(_account_table(account))
    if done.result != OUTCOMES.successful:
        console.print(OUTCOMES[done.result], style="yellow")
    if options.changes is not None:
        from ..viz import save_colored_mesh  # noqa: PLC0415

        vertices, faces, _ = _arrays(result, after)
        save_colored_mesh(options.changes, vertices, faces, account.displacements, account.stretches)
        console.print(f"wrote {options.changes}")

    def draw(path: Path) -> None:
        from ..viz import Scene, render  # noqa: PLC0415

        unit = float(mean_edge_length(edge_lengths(mesh.vertices, mesh.topology)))
        (x0, faces, field0), (x1, _, field1) = _arrays(mesh, before), _arrays(result, after)

        def title(when: str, fields: KillingFields) -> str:
            return f"{when}: λ₀·area = {float(fields.dimensionless[0]):.2g}"

        moved = np.asarray(normal_displacements(mesh.vertices, result.vertices, mesh.topology)) / unit
        scenes = [
            Scene(x0, faces, title("before", before), vectors=field0[0]),
            Scene(
                x1,
                faces,
                title("after", after),
                vectors=field1[0],
                values=moved,
                signed=True,
                color_bar="normal displacement / mean edge length",
            ),
        ]
        render(path, scenes, size=(1600, 800), view=upright(options, result, after))

    drawn = draw_picture(draw, options.picture or options.output.with_suffix(".png"), options, console)
    return {
        "mesh": None if options.mesh is None else str(options.mesh),
        "output": str(options.output),
        **account.as_dict(),
        "before": _describe(mesh, before),
        "after": _describe(result, after),
        "history": [np.asarray(step.dimensionless).tolist() for step in done.history],
        "changes": None if options.changes is None else str(options.changes),
        "picture": drawn,
    }


def _enable_float64_and_cache() -> None:
    jax.config.update("jax_enable_x64", True)
    caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    jax.config.update("jax_compilation_cache_dir", str(caches / "jaxkvf"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def _arrays(mesh: TriangleMesh, found: KillingFields) -> tuple[Any, Any, Any]:
    return np.asarray(mesh.vertices), np.asarray(mesh.faces), np.asarray(found.vectors)


def _table(found: KillingFields, title: str) -> "Table":
    from rich.table import Table  # noqa: PLC0415

    table = Table(title=title, title_justify="left")
    for column in ("field", "λ", "λ·area", "multiplicity", "residual"):
        table.add_column(column, justify="right")
    clusters = np.asarray(found.clusters)
    rows = zip(
        np.asarray(found.eigenvalues),
        np.asarray(found.dimensionless),
        clusters,
        np.asarray(found.residuals),
        strict=True,
    )
    for i, (value, dimensionless, cluster, residual) in enumerate(rows):
        size = int((clusters == cluster).sum())
        # The last cluster may go on beyond the fields that were asked for.
        multiplicity = f"≥ {size}" if cluster == clusters[-1] else str(size)
        table.add_row(str(i), f"{value:.6g}", f"{dimensionless:.6g}", multiplicity, f"{residual:.1e}")
    return table


def _account_table(account: SymmetryReport) -> "Table":
    """What symmetrizing has done."""
    from rich.table import Table  # noqa: PLC0415

    table = Table(title="changes", title_justify="left")
    for column in ("", "before", "after"):
        table.add_column(column, justify="right")
    table.add_row("exact fields", str(account.exact_before), str(account.exact_after))
    pairs = zip(account.dimensionless_before, account.dimensionless_after, strict=True)
    for i, (before, after) in enumerate(pairs):
        table.add_row(f"λ·area of field {i}", f"{before:.3g}", f"{after:.3g}")
    table.add_row("smallest angle", *(f"{angle:.1f}°" for angle in account.smallest_angles))
    table.add_row("moved, mean edges (RMS)", "", f"{account.rms_displacement:.3f}")
    table.add_row("moved, mean edges (most)", "", f"{account.largest_displacement:.3f}")
    worst = account.most_changed_faces[:3]
    named = ", ".join(f"{face} (×{account.stretches[face]:.2f})" for face in worst)
    table.add_row("most stretched faces", "", named)
    table.add_row("flipped faces", "", str(account.flipped_faces))
    table.add_row("evaluations", "", str(account.evaluations))
    return table


def _describe(mesh: TriangleMesh, found: KillingFields) -> dict[str, Any]:
    return {
        "vertices": mesh.topology.n_vertices,
        "faces": mesh.topology.n_faces,
        "area": float(found.area),
        "eigenvalues": np.asarray(found.eigenvalues).tolist(),
        "eigenvalues_times_area": np.asarray(found.dimensionless).tolist(),
        "clusters": np.asarray(found.clusters).tolist(),
        "residuals": np.asarray(found.residuals).tolist(),
    }


def _message(failure: BaseException) -> str:
    """What a failure says, without the stacks and the advice for debugging that compiled code wraps around it."""
    text = str(failure).strip() or type(failure).__name__
    _, _, inner = text.rpartition("EquinoxRuntimeError: ")
    return inner.split("\n\n")[0]
