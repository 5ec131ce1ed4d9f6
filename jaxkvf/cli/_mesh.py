"""The commands that need no eigensolver: `jaxkvf check MESH` and `jaxkvf repair MESH -o OUT`."""

import argparse
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files import check_can_be_written
from ..mesh import MeshReport, check, repair
from ._terminal import as_options, positive, save_mesh

if TYPE_CHECKING:
    from rich.console import Console

_STEPS = {
    "triangulate": "cut quads and other polygons into triangles",
    "drop_invalid": "drop vertices without a finite position, their faces, and faces of missing vertices",
    "drop_degenerate": (
        "drop faces of fewer than three different corners; take flat faces out so that the surface stays closed"
    ),
    "drop_duplicate_faces": "of faces over the same three vertices keep the first",
    "split_nonmanifold": "cut along edges of more than two faces, split vertices where sheets touch",
    "orient": "turn faces over until neighbours agree and closed pieces look outwards",
    "drop_unreferenced": "drop vertices of no face",
}


def add_mesh_commands(commands: Any, readable: str, writable: Callable[[str], Path]) -> None:
    """Adds `check` and `repair` to the subparsers `commands`."""
    checking = commands.add_parser(
        "check", help="what is wrong with a mesh; exit code 1 if anything", description=_check.__doc__
    )
    checking.add_argument("mesh", type=Path, metavar="MESH", help=f"a {readable} file")
    checking.set_defaults(run=_check)

    repairing = commands.add_parser(
        "repair", help="mend what you name, and nothing else", description=_repair.__doc__
    )
    repairing.add_argument("mesh", type=Path, metavar="MESH", help=f"a {readable} file")
    repairing.add_argument(
        "-o", "--output", type=writable, required=True, metavar="OUT", help="the mesh to write"
    )
    repairing.add_argument(
        "--merge-duplicates",
        type=float,
        nargs="?",
        const=True,
        default=False,
        metavar="DISTANCE",
        help="merge vertices at equal positions, or closer than this; `check` says how close",
    )
    for step, explanation in _STEPS.items():
        repairing.add_argument(f"--{step.replace('_', '-')}", action="store_true", help=explanation)
    repairing.add_argument("--all", action="store_true", help="all of these; merge only equal positions")
    repairing.add_argument(
        "--keep-largest",
        type=positive,
        default=0,
        metavar="N",
        help="keep the N connected pieces of the largest area",
    )
    repairing.add_argument(
        "--to-origin", action="store_true", help="move the middle of the mesh to the origin"
    )
    repairing.set_defaults(run=_repair)
    for command in (checking, repairing):
        command.add_argument("--json", action="store_true", help="print the result as JSON")


def _check(options: argparse.Namespace, console: "Console") -> dict[str, Any]:
    """Lists what is wrong with a mesh: errors, which every other command refuses, and remarks."""
    with console.status("checking"):
        report = check(options.mesh)
    console.print(f"{options.mesh}: {as_options(str(report))}", markup=False, highlight=False, soft_wrap=True)
    return {"mesh": str(options.mesh), **_describe(report)}


def _repair(options: argparse.Namespace, console: "Console") -> dict[str, Any]:
    """Mends what you name in a mesh and writes the result, if that is then a mesh; says what it did."""
    check_can_be_written(options.output)
    steps = {step: options.all or getattr(options, step) for step in _STEPS}
    with console.status("repairing"):
        done = repair(
            options.mesh,
            merge_duplicates=options.merge_duplicates or options.all,
            keep_largest=options.keep_largest,
            to_origin=options.to_origin,
            **steps,
        )
        left = done.report
    for action in done.actions or ("nothing to do",):
        console.print(action, markup=False, highlight=False, soft_wrap=True)
    console.print(as_options(str(left)), markup=False, highlight=False, soft_wrap=True)
    if left.ok:
        save_mesh(done.mesh, options.output, done.attributes, console)
    return {
        "mesh": str(options.mesh),
        "actions": list(done.actions),
        "written": str(options.output) if left.ok else None,
        **_describe(left),
    }


def _describe(report: MeshReport) -> dict[str, Any]:
    described = asdict(report)
    for finding in (*described["errors"], *described["remarks"]):
        finding["remedy"] = as_options(finding["remedy"])
    return {**described, "ok": report.ok}
