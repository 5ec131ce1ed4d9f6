"""The command `jaxkvf symmetrize [MESH] -o OUT`."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..fields import KillingFields, killing_fields
from ..geometry import edge_lengths, mean_edge_length, normal_displacements
from ..mesh import Attributes, TriangleMesh, read_attributes, shapes
from ..symmetrization import OUTCOMES, Step, SymmetryReport, symmetrize, symmetry_report
from ._messages import spoken
from ._options import READABLE, WRITABLE, add_count, add_json, add_output, add_picture, positive, with_suffix
from ._table import described, fields_table, judged
from ._terminal import check_writable, draw_picture, save_mesh, size_of, upright

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


def add_to(commands: Any) -> None:
    command = commands.add_parser(
        "symmetrize",
        help="move the vertices until the symmetry is exact",
        description=_symmetrize.__doc__,
    )
    command.add_argument(
        "mesh",
        type=Path,
        nargs="?",
        metavar="MESH",
        help=f"a {READABLE} file; by default a built-in noisy vase",
    )
    add_output(command, *WRITABLE, metavar="OUT", text="the mesh to write", required=True)
    add_count(command)
    command.add_argument(
        "--max-steps", type=positive, default=500, help="most steps of the minimiser (default: 500)"
    )
    command.add_argument(
        "--changes",
        type=with_suffix(".ply"),
        metavar="PLY",
        help="write the result once more, coloured by how far vertices moved and how much triangles were stretched",
    )
    add_json(command)
    add_picture(command)
    command.set_defaults(run=_symmetrize)


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
            progress.update(task, completed=step.steps, asymmetry=asymmetry)

        done = symmetrize(mesh, options.count, max_steps=options.max_steps, callback=show)
    if done.mesh is None or done.result in (OUTCOMES.eigensolver_failed, OUTCOMES.below_zero):
        raise RuntimeError(OUTCOMES[done.result])
    result = done.mesh
    save_mesh(result, options.output, attributes, console)

    k = options.count + 2
    before, after = killing_fields(mesh, k), killing_fields(result, k)
    console.print(fields_table(mesh, before, f"before ({name}: {size_of(mesh)})"))
    console.print(fields_table(result, after, "after"))
    account = symmetry_report(mesh, done)
    console.print(_account_table(account))
    if done.result != OUTCOMES.successful:
        console.print(spoken(OUTCOMES[done.result]), style="yellow")
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
        "before": described(mesh, before),
        "after": described(result, after),
        "history": [np.asarray(step.dimensionless).tolist() for step in done.history],
        "changes": None if options.changes is None else str(options.changes),
        "picture": drawn,
    }


def _arrays(mesh: TriangleMesh, found: KillingFields) -> tuple[Any, Any, Any]:
    return np.asarray(mesh.vertices), np.asarray(mesh.faces), np.asarray(found.vectors)


def _account_table(account: SymmetryReport) -> "Table":
    """What symmetrizing has done."""
    from rich.table import Table  # noqa: PLC0415

    table = Table(title="changes", title_justify="left")
    for column in ("", "before", "after"):
        table.add_column(column, justify="right")
    table.add_row("exact fields", str(account.exact_before), str(account.exact_after))
    before, after = (
        [judged(value, ok, ".3g") for value, ok in zip(values, trusted, strict=True)]
        for values, trusted in (
            (account.dimensionless_before, account.trusted_before),
            (account.dimensionless_after, account.trusted_after),
        )
    )
    for i, pair in enumerate(zip(before, after, strict=True)):
        table.add_row(f"λ·area of field {i}", *pair)
    table.add_row("smallest angle", *(f"{angle:.1f}°" for angle in account.smallest_angles))
    table.add_row("moved, mean edges (RMS)", "", f"{account.rms_displacement:.3f}")
    table.add_row("moved, mean edges (most)", "", f"{account.largest_displacement:.3f}")
    worst = account.most_changed_faces[:3]
    named = ", ".join(f"{face} (×{account.stretches[face]:.2f})" for face in worst)
    table.add_row("most stretched faces", "", named)
    table.add_row("flipped faces", "", str(account.flipped_faces))
    table.add_row("steps", "", str(account.steps))
    return table
