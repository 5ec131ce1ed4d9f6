"""What the commands share while they run: files, pictures, words."""

import argparse
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
