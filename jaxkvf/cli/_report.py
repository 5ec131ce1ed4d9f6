"""The command `jaxkvf report MESH -o OUT.html`."""

import argparse
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files import check_can_be_written
from ..mesh import TriangleMesh
from ..report import Contents, write_report
from ..symmetrization import OUTCOMES, Step, symmetrize
from ._messages import spoken
from ._options import add_count, add_json, add_mesh, add_output, add_solve, add_up
from ._terminal import size_of

if TYPE_CHECKING:
    from rich.console import Console


def add_to(commands: Any) -> None:
    command = commands.add_parser("report", help="a web page about a mesh", description=_report.__doc__)
    add_mesh(command)
    add_output(command, ".html", metavar="HTML", text="the page to write", required=True)
    add_solve(command)
    add_up(command)
    command.add_argument("--symmetrize", action="store_true", help="show the symmetrized mesh beside it")
    add_count(command)
    add_json(command)
    command.set_defaults(run=_report)


def _report(options: argparse.Namespace, console: "Console") -> dict[str, Any]:
    """Writes one web page that works without a network: the mesh and its Killing fields in 3-D, flow lines, the spectrum."""
    check_can_be_written(options.output)
    with console.status("reading") as status:
        mesh = TriangleMesh.load(options.mesh)
        moved, remark = None, ""
        if options.symmetrize:

            def show(step: Step) -> None:
                asymmetry = step.dimensionless[: options.count].sum()
                status.update(f"symmetrizing: λ·area = {asymmetry:.2e} after {step.steps} steps")

            done = symmetrize(mesh, options.count, callback=show)
            if done.mesh is None or done.result in (OUTCOMES.eigensolver_failed, OUTCOMES.below_zero):
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
        console.print(spoken(remark), style="yellow")
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
        "periods": [None if found is None else found.period for found in told.periods],
    }
