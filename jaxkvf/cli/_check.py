"""The command `jaxkvf check MESH`."""

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ..mesh import MeshReport, check
from ._messages import as_options
from ._options import add_json, add_mesh

if TYPE_CHECKING:
    from rich.console import Console


def add_to(commands: Any) -> None:
    command = commands.add_parser(
        "check", help="what is wrong with a mesh; exit code 1 if anything", description=_check.__doc__
    )
    add_mesh(command)
    add_json(command)
    command.set_defaults(run=_check)


def _check(options: argparse.Namespace, console: "Console") -> dict[str, Any]:
    """Lists what is wrong with a mesh: errors, which every other command refuses, and remarks."""
    with console.status("checking"):
        report = check(options.mesh)
    console.print(f"{options.mesh}: {as_options(str(report))}", markup=False, highlight=False, soft_wrap=True)
    return {"mesh": str(options.mesh), **described(report)}


def described(report: MeshReport) -> dict[str, Any]:
    """The report for `--json`, with remedies in the words of the command line."""
    described = asdict(report)
    for finding in (*described["errors"], *described["remarks"]):
        finding["remedy"] = as_options(finding["remedy"])
    return {**described, "ok": report.ok}
