"""The command `jaxkvf fields MESH`."""

import argparse
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..fields import killing_fields
from ..files import write_whole
from ..mesh import TriangleMesh
from ._options import add_json, add_mesh, add_output, add_picture, add_solve
from ._table import described, fields_table
from ._terminal import check_writable, draw_picture, size_of, upright

if TYPE_CHECKING:
    from rich.console import Console


def add_to(commands: Any) -> None:
    command = commands.add_parser(
        "fields", help="the approximate Killing fields of a mesh", description=_fields.__doc__
    )
    add_mesh(command)
    add_solve(command)
    add_output(command, ".npz", metavar="NPZ", text="write eigenvalues and vectors here")
    add_json(command)
    add_picture(command)
    command.set_defaults(run=_fields)


def _fields(options: argparse.Namespace, console: "Console") -> dict[str, Any]:
    """Finds the k tangent fields of smallest Killing energy; λ·area near 0 means a continuous intrinsic symmetry."""
    check_writable(options.output, options.picture)
    with console.status("reading"):
        mesh = TriangleMesh.load(options.mesh)
    with console.status(f"solving for {options.k} fields on {mesh.topology.n_vertices} vertices"):
        found = killing_fields(mesh, options.k, discretization=options.discretization)
        found.eigenvalues.block_until_ready()
    console.print(fields_table(mesh, found, f"{options.mesh.name}: {size_of(mesh)}"))

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

        vertices, faces, vectors = (
            np.asarray(mesh.vertices),
            np.asarray(mesh.faces),
            np.asarray(found.vectors),
        )
        scenes = [
            Scene(vertices, faces, f"λ·area = {value:.3g}", vectors=field)
            for value, field in zip(np.asarray(found.dimensionless)[:4], vectors[:4], strict=True)
        ]
        render(path, scenes, size=(480 * len(scenes), 540), view=upright(options, mesh, found))

    picture = options.picture or Path(f"{options.mesh.stem}-fields.png")
    drawn = draw_picture(draw, picture, options, console)
    return {"mesh": str(options.mesh), **described(mesh, found), "picture": drawn}
