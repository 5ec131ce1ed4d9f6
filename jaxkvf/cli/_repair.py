"""The command `jaxkvf repair MESH -o OUT`."""

import argparse
from typing import TYPE_CHECKING, Any

from ..files import check_can_be_written
from ..mesh import repair
from ._check import described
from ._messages import as_options
from ._options import WRITABLE, add_json, add_mesh, add_output, positive
from ._terminal import save_mesh

if TYPE_CHECKING:
    from rich.console import Console

_STEPS = {
    "triangulate": "cut quads and other polygons into triangles",
    "drop_invalid": "drop vertices without a finite position, their faces, and faces of missing vertices",
    "drop_duplicate_faces": "of faces over the same three vertices keep the first",
    "drop_degenerate": (
        "drop faces of fewer than three different corners; take flat faces out so that the surface stays closed"
    ),
    "split_nonmanifold": "cut along edges of more than two faces, split vertices where sheets touch",
    "orient": "turn faces over until neighbours agree and closed pieces look outwards",
    "drop_unreferenced": "drop vertices of no face",
}


def add_to(commands: Any) -> None:
    command = commands.add_parser(
        "repair", help="mend what you name, and nothing else", description=_repair.__doc__
    )
    add_mesh(command)
    add_output(command, *WRITABLE, metavar="OUT", text="the mesh to write", required=True)
    command.add_argument(
        "--merge-duplicates",
        type=float,
        nargs="?",
        const=True,
        default=False,
        metavar="DISTANCE",
        help="merge vertices at equal positions, or closer than this; `check` says how close",
    )
    for step, explanation in _STEPS.items():
        command.add_argument(f"--{step.replace('_', '-')}", action="store_true", help=explanation)
    command.add_argument("--all", action="store_true", help="all of these; merge only equal positions")
    command.add_argument(
        "--keep-largest",
        type=positive,
        default=0,
        metavar="N",
        help="keep the N connected pieces of the largest area",
    )
    command.add_argument("--to-origin", action="store_true", help="move the middle of the mesh to the origin")
    add_json(command)
    command.set_defaults(run=_repair)


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
        **described(left),
    }
