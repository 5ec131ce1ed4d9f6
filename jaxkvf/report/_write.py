"""A report as a file."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..arguments import Integer, checked_choice
from ..files import check_can_be_written, write_whole
from ..killing import AbstractDiscretization
from ..mesh import TriangleMesh
from ._contents import Contents, contents
from ._page import page, three_js


def write_report(
    path: str | os.PathLike[str],
    mesh: TriangleMesh,
    k: Integer = 6,
    *,
    symmetrized: TriangleMesh | None = None,
    discretization: str | AbstractDiscretization = "regge",
    title: str | None = None,
    up: str = "auto",
    callback: Callable[[str], object] | None = None,
) -> tuple[Contents, ...]:
    """Writes one HTML page that works from disk and without a network: the mesh in 3-D, its fields, flow lines, spectrum.

    About 0.6 MB for three.js, and 1.4 MB for each 10,000 vertices with 6 fields (`python benchmarks/report.py` prints it).

    Args:
        path: the file, ending in `.html`.
        mesh: the surface.
        k: number of fields.
        symmetrized: a mesh of the same connectivity to show beside it.
        discretization: as for `killing_fields`.
        title: of the page; by default the name of the file.
        up: what is up in the picture at first: `"x"`, `"y"`, `"z"`, or `"auto"`, the axis of symmetry (see `symmetry_axis`),
            and y without one.
        callback: called with what is done next, in words.

    Returns:
        what the page shows: of the mesh, and of the symmetrized one where there is one.

    Raises:
        ValueError: not an `.html` file, another axis or connectivity, or as for `killing_fields`.
        ImportError: `pip install "jaxkvf[report]"`.
        OSError: the file cannot be written.
        equinox.EquinoxRuntimeError: the eigensolver failed.
    """
    file = Path(path)
    if file.suffix.lower() != ".html":
        raise ValueError(f"{file}: reports are written as .html, not {file.suffix!r}")
    checked_choice("up", up, ("auto", "x", "y", "z"))
    check_can_be_written(file)
    if symmetrized is not None and not np.array_equal(symmetrized.faces, mesh.faces):
        raise ValueError("symmetrized must have the faces of mesh: it is the same mesh, its vertices moved")
    library = three_js()
    surfaces = [mesh] if symmetrized is None else [mesh, symmetrized]
    told = tuple(contents(each, k, discretization=discretization, callback=callback) for each in surfaces)
    if callback is not None:
        callback("writing the page")
    write_whole(file, page(told, library, title=file.stem if title is None else title, up=up).encode())
    return told
