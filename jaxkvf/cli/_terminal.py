"""What the commands of the command line share: arguments, files, pictures."""

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..fields import KillingFields
from ..files import check_can_be_written
from ..mesh import Attributes, TriangleMesh
from ..report import symmetry_axis

if TYPE_CHECKING:
    from rich.console import Console

    from ..viz import View

READABLE = ".obj, .ply, .off or .stl"


def positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1, got {number}")
    return number


def with_suffix(*suffixes: str) -> Callable[[str], Path]:
    def path(text: str) -> Path:
        if Path(text).suffix.lower() not in suffixes:
            raise argparse.ArgumentTypeError(f"must end in {' or '.join(suffixes)}, got {text!r}")
        return Path(text)

    return path


def add_up_option(command: argparse.ArgumentParser) -> None:
    """Declares `--up` of the commands that draw."""
    command.add_argument(
        "--up",
        choices=("auto", "x", "y", "z"),
        default="auto",
        help="what is up in the picture (default: the axis of symmetry; y where there is none)",
    )


def upright(options: argparse.Namespace, mesh: TriangleMesh, fields: KillingFields) -> "View":
    """The view that `--up` asks for."""
    from ..viz import X_UP, Y_UP, Z_UP, view_upright  # noqa: PLC0415

    axis = symmetry_axis(mesh, fields) if options.up == "auto" else None
    return {"x": X_UP, "y": Y_UP, "z": Z_UP}.get(options.up, Y_UP) if axis is None else view_upright(axis)


def check_writable(*paths: Path | None) -> None:
    """Fails before the work, not after it, where a result could not be written."""
    for path in paths:
        if path is not None:
            check_can_be_written(path)


def as_options(text: str) -> str:
    """A message in which calls of `repair` are commands: `repair(…, orient=True)` is `jaxkvf repair … --orient`."""

    def command(call: re.Match[str]) -> str:
        steps = [argument.partition("=") for argument in call[1].split(", ")]
        given = [
            f"--{name.replace('_', '-')}" + ("" if value == "True" else f" {value}")
            for name, _, value in steps
        ]
        return "`jaxkvf repair MESH -o OUT " + " ".join(given) + "`"

    return re.sub(r"repair\(…, ([^)]*)\)", command, text)


def save_mesh(mesh: TriangleMesh, path: Path, attributes: Attributes, console: "Console") -> None:
    """Writes a mesh with what its format holds of colours and texture coordinates; says what it does not."""
    held, lost = attributes.held_by(path.suffix.lower())
    mesh.save(path, held)
    console.print(f"wrote {path}", markup=False, highlight=False, soft_wrap=True)
    if lost:
        note = f"{path.suffix.lower()} files hold no {', '.join(lost)}: left out"
        console.print(note, style="yellow", markup=False, highlight=False, soft_wrap=True)


def draw_picture(
    draw: Callable[[Path], None], path: Path, options: argparse.Namespace, console: "Console"
) -> str | None:
    """Draws; where no picture was asked for by name, being unable to draw is a remark and no failure."""
    if options.no_picture:
        return None
    try:
        with console.status("drawing"):
            draw(path)
    except (ImportError, RuntimeError, OSError) as failure:
        if options.picture is not None:
            raise RuntimeError(f"no picture: {failure}") from failure
        console.print(f"no picture: {failure}", style="yellow")
        return None
    console.print(f"wrote {path}")
    return str(path)


def size_of(mesh: TriangleMesh) -> str:
    return f"{mesh.topology.n_vertices:,} vertices, {mesh.topology.n_faces:,} faces"
