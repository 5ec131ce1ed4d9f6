"""The command `jaxkvf report MESH -o OUT.html`."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files import check_can_be_written
from ..mesh import TriangleMesh
from ..report import Contents, write_report
from ..symmetrization import OUTCOMES, Step, symmetrize
from ._terminal import READABLE, add_up_option, positive, size_of, with_suffix

if TYPE_CHECKING:
    from rich.console import Console


def add_report_command(commands: Any) -> None:
    """Adds `report` to the subparsers `commands`."""
    report = commands.add_parser("report", help="a web page about a mesh", description=_report.__doc__)
    report.add_argument("mesh", type=Path, metavar="MESH", help=f"a {READABLE} file")
    report.add_argument(
        "-o", "--output", type=with_suffix(".html"), required=True, metavar="HTML", help="the page to write"
    )
    report.add_argument("-k", type=positive, default=6, help="number of fields (default: 6)")
    report.add_argument("--discretization", choices=("regge", "regge-delaunay", "dec"), default="regge")
    add_up_option(report)
    report.add_argument("--symmetrize", action="store_true", help="show the symmetrized mesh beside it")
    report.add_argument(
        "--count", type=positive, default=1, help="number of symmetries to make exact (default: 1)"
    )
    report.add_argument("--json", action="store_true", help="print the result as JSON")
    report.set_defaults(run=_report)


def _report(options: argparse.Namespace, console: "Console") -> dict[str, Any]:
    """Writes one web page that works without a network: the mesh and its Killing fields in 3-D, flow lines, the spectrum."""
    check_can_be_written(options.output)
    with console.status("reading") as status:
        mesh = TriangleMesh.load(options.mesh)
        moved, remark = None, ""
        if options.symmetrize:

            def show(step: Step) -> None:
                asymmetry = step.dimensionless[: options.count].sum()
                status.update(f"symmetrizing: λ·area = {asymmetry:.2e} after {step.evaluations} evaluations")

            done = symmetrize(mesh, options.count, callback=show)
            if done.mesh is None or done.result == OUTCOMES.eigensolver_failed:
                raise RuntimeError(OUTCOMES[done.result])
            moved, remark = done.mesh, OUTCOMES[done.result]
        told = write_report(
            options.output,
            mesh,
            options.k,
            symmetrized=moved,
            discretization=options.discretization,
            title=options.mesh.name,
            up=options.up,
            callback=status.update,
        )
    if remark:
        console.print(remark, style="yellow")
    names = ("mesh", "symmetrized")[: len(told)]
    for name, each in zip(names, told, strict=True):
        values = ", ".join(f"{value:.3g}" for value in np.asarray(each.fields.dimensionless))
        console.print(f"{name}: {size_of(each.mesh)}; λ·area = {values}")
    size = options.output.stat().st_size
    console.print(f"wrote {options.output} ({size / 1e6:.1f} MB)")
    return {
        "mesh": str(options.mesh),
        "output": str(options.output),
        "bytes": size,
        "surfaces": {name: _describe(each) for name, each in zip(names, told, strict=True)},
    }


def _describe(told: Contents) -> dict[str, Any]:
    return {
        "vertices": told.mesh.topology.n_vertices,
        "area": float(told.fields.area),
        "eigenvalues_times_area": np.asarray(told.fields.dimensionless).tolist(),
        "clusters": np.asarray(told.fields.clusters).tolist(),
        "periods": [None if found is None else found.time for found in told.periods],
    }
