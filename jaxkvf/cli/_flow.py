"""The commands `jaxkvf flow MESH` and `jaxkvf pattern MESH -o OUT`."""

import argparse
import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..fields import KillingFields, killing_fields
from ..files import write_whole
from ..flows import NoPeriodError, Period, closed_field, integral_curves, isometry_error, period
from ..geometry import edge_lengths, mean_edge_length, vertex_points
from ..mesh import TriangleMesh
from ..patterns import (
    emboss,
    fastest_vertex,
    paint,
    pattern,
    read_image,
    save_colored,
    save_textured,
    stripes,
    texture,
    texture_coordinates,
)
from ._options import READABLE, add_json, add_picture, count, finite, positive, with_suffix
from ._terminal import check_writable, draw_picture, size_of, upright

if TYPE_CHECKING:
    from rich.console import Console

_CURVES = 24


def add_to(commands: Any) -> None:
    flow = commands.add_parser(
        "flow", help="follow a Killing field: curves, period, isometry", description=_flow.__doc__
    )
    decorate = commands.add_parser(
        "pattern", help="decorate a mesh along a Killing field", description=_pattern.__doc__
    )
    for command in (flow, decorate):
        command.add_argument("mesh", type=Path, metavar="MESH", help=f"a {READABLE} file")
        command.add_argument(
            "--field", type=count, default=0, help="number of the Killing field, from 0 (default: 0)"
        )
        command.add_argument(
            "--closed",
            action="store_true",
            help="of the fields whose λ equals that one's, take the combination whose curves close",
        )
    flow.add_argument(
        "-t", "--time", type=finite, help="time to go, for a field of unit norm (default: the period)"
    )
    flow.add_argument(
        "--curves", type=positive, default=_CURVES, help=f"how many curves (default: {_CURVES})"
    )
    flow.add_argument(
        "-o",
        "--output",
        type=with_suffix(".npz"),
        metavar="NPZ",
        help="write curves and advected vertices here",
    )
    flow.set_defaults(run=_flow)

    decorate.add_argument(
        "-o",
        "--output",
        type=with_suffix(".glb", ".obj", ".ply"),
        required=True,
        metavar="OUT",
        help="textured .glb or .obj (with .mtl and .png), vertex-coloured .ply",
    )
    decorate.add_argument(
        "-m", "--copies", type=positive, default=12, help="copies of each disk (default: 12)"
    )
    decorate.add_argument(
        "--at",
        type=count,
        nargs="+",
        metavar="VERTEX",
        help="centres of the disks (default: where the field is fastest, a radius from the boundary)",
    )
    decorate.add_argument(
        "--radius", type=finite, help="of the disks, in time: radius / speed (default: 0.4 T / m)"
    )
    decorate.add_argument(
        "--image", type=Path, metavar="FILE", help="image to put on each disk (default: rings)"
    )
    decorate.add_argument(
        "--relief", type=finite, metavar="HEIGHT", help="raise each disk by this many mean edges"
    )
    decorate.add_argument(
        "--stripes",
        choices=("across", "along"),
        help="stripes (as many as copies) instead of disks; .ply only",
    )
    decorate.add_argument("--subdivide", type=positive, default=1, help="parts of each edge (default: 1)")
    decorate.set_defaults(run=_pattern)
    for command in (flow, decorate):
        add_json(command)
        add_picture(command)


def _solved(options: argparse.Namespace, console: "Console") -> tuple[TriangleMesh, KillingFields, Any]:
    """The mesh, its fields, and the one that was asked for or all of its cluster, `[d, V, 3]`."""
    with console.status("reading"):
        mesh = TriangleMesh.load(options.mesh)
    wanted = options.field
    with console.status(f"solving for field {wanted} on {mesh.topology.n_vertices} vertices"):
        found = killing_fields(mesh, wanted + 1)
        k, most = wanted + 4, min(wanted + 64, mesh.topology.n_vertices // 2)
        while options.closed and k <= most:
            found, k = killing_fields(mesh, k), 2 * k
            if found.clusters[-1] != found.clusters[wanted]:
                break
    value = float(found.dimensionless[wanted])
    console.print(f"{options.mesh.name}: {size_of(mesh)}; field {wanted}: λ·area = {value:.6g}")
    if not options.closed:
        return mesh, found, found.vectors[wanted]
    same = np.flatnonzero(np.asarray(found.clusters == found.clusters[wanted]))
    console.print(f"fields of this λ: {', '.join(map(str, same))}")
    return mesh, found, found.vectors[same]


def _with_period(
    options: argparse.Namespace, console: "Console"
) -> tuple[TriangleMesh, KillingFields, Any, Period | NoPeriodError, list[str]]:
    """The mesh, its fields, the one to follow, its period or why it has none, and warnings."""
    mesh, fields, vectors = _solved(options, console)
    with console.status("looking for the period"), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found: Period | NoPeriodError
        try:
            if options.closed:
                closed = closed_field(mesh, vectors)
                vectors, found = closed.vectors, closed.period
            else:
                found = period(mesh, vectors)
        except NoPeriodError as failure:
            vectors, found = (vectors[0] if options.closed else vectors), failure
    for warning in caught:
        console.print(f"warning: {warning.message}", style="yellow")
    return mesh, fields, vectors, found, [str(warning.message) for warning in caught]


def _why(failure: NoPeriodError, options: argparse.Namespace) -> str:
    remedy = (
        "take a field of a smaller λ: --field NUMBER"
        if options.closed
        else "if other fields have the same λ (jaxkvf fields tells), try --closed, which combines them"
    )
    return f"{failure.what}; {remedy}"


def _flow(options: argparse.Namespace, console: "Console") -> dict[str, Any]:
    """Follows a Killing field: its period, its integral curves, and how nearly its flow keeps lengths."""
    check_writable(options.output, options.picture)
    mesh, fields, vectors, result, said = _with_period(options, console)
    found = None if isinstance(result, NoPeriodError) else result
    if isinstance(result, NoPeriodError):
        if options.time is None:
            raise ValueError(f"{_why(result, options)}, or say how far to go: -t TIME")
        console.print(_why(result, options), style="yellow")
    else:
        closed = int(result.closed.sum())
        console.print(
            f"period T = {result.period:.6g} (spread {result.spread:.1e}), {closed} of {len(result.closed)} curves closed, "
            f"gaps up to {np.nanmax(result.gaps):.1e} of their length"
        )
    time = options.time if found is None or options.time is not None else found.period
    with console.status("following all vertices"):
        change = isometry_error(mesh, vectors, time)
    console.print(
        f"after t = {time:.6g}: edge lengths changed by {change.relative_rms:.2e} (relative RMS; Err = {change.err:.1e}), "
        f"{100 * change.finished:.1f} % of the vertices went all the way"
    )
    here = np.flatnonzero(mesh.topology.components()[1] == result.component)
    speeds = np.linalg.norm(np.asarray(vectors), axis=1)[here]
    chosen = here[np.argsort(speeds)[_spread(speeds, options.curves)]]
    curves = integral_curves(mesh, vectors, time, vertex_points(mesh, chosen))
    if options.output is not None:
        content = io.BytesIO()
        np.savez(
            content,
            time=time,
            vectors=np.asarray(vectors),
            vertices=np.asarray(change.vertices),
            curves=curves.positions,
            curve_times=curves.times,
        )
        write_whole(options.output, content.getvalue())
        console.print(f"wrote {options.output}")

    def draw(path: Path) -> None:
        from ..viz import Scene, render  # noqa: PLC0415

        x, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        scene = Scene(x, faces, vectors=np.asarray(vectors), curves=curves.polylines())
        render(path, scene, view=upright(options, mesh, fields))

    drawn = draw_picture(draw, options.picture or Path(f"{options.mesh.stem}-flow.png"), options, console)
    return {
        "mesh": str(options.mesh),
        "field": options.field,
        "time": time,
        "period": None if found is None else found.period,
        "period_spread": None if found is None else found.spread,
        "closed_curves": None if found is None else int(found.closed.sum()),
        "relative_rms_edge_error": change.relative_rms,
        "err": change.err,
        "warnings": said,
        "picture": drawn,
    }


def _spread(speeds: np.ndarray, count: int) -> np.ndarray:
    """Ranks spread evenly from the slow to the fast."""
    return np.linspace(0.02 * len(speeds), len(speeds) - 1, min(count, len(speeds))).astype(int)


def _pattern(options: argparse.Namespace, console: "Console") -> dict[str, Any]:
    """Decorates a mesh along a Killing field: an image, a relief or stripes, repeated so that the flow keeps them."""
    output = options.output
    beside = (
        (output.with_suffix(".png"), output.with_suffix(".mtl")) if output.suffix.lower() == ".obj" else ()
    )
    check_writable(output, *beside, options.picture)
    if options.stripes is not None and output.suffix.lower() != ".ply":
        raise ValueError(f"stripes are colours at vertices: write them to a .ply, not {output.suffix}")
    image = _rings() if options.image is None else read_image(options.image)
    mesh, fields, vectors, found, said = _with_period(options, console)
    if isinstance(found, NoPeriodError):
        raise ValueError(_why(found, options))
    report: dict[str, Any] = {"mesh": str(options.mesh), "output": str(output), "period": found.period}
    made = None
    if options.stripes is not None:
        with console.status("stripes"):
            values = stripes(mesh, vectors, options.copies, direction=options.stripes, period=found.period)
        shape = mesh
        dark, light = np.array([0.16, 0.35, 0.55]), np.array([0.96, 0.92, 0.80])
        colors = dark + (0.5 + 0.5 * np.tanh(4 * values))[:, None] * (light - dark)
        save_colored(output, shape, colors)
    else:
        reach = 0.4 * found.period / options.copies if options.radius is None else options.radius
        centers = [fastest_vertex(mesh, vectors, reach)] if options.at is None else options.at
        with console.status("following the disks"), warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            made = pattern(
                mesh,
                vectors,
                np.asarray(centers),
                options.copies,
                radius=options.radius,
                period=found.period,
                subdivide=options.subdivide,
            )
        for warning in caught:
            console.print(f"warning: {warning.message}", style="yellow")
        shape = made.mesh
        if options.relief is not None:
            unit = float(mean_edge_length(edge_lengths(mesh.vertices, mesh.topology)))
            shape = emboss(made, options.relief * unit)
        colors = paint(made, image)
        if output.suffix.lower() == ".ply":
            save_colored(output, shape, colors)
        else:
            save_textured(output, made, image, mesh=shape)
        report |= {"centers": centers, "copies": len(made.coordinates), "radius": made.radius}
        said += [str(warning.message) for warning in caught]
    console.print(f"period T = {found.period:.6g}; wrote {', '.join(map(str, (output, *beside)))}")

    def draw(path: Path) -> None:
        from ..viz import Scene, Texture, render  # noqa: PLC0415

        x, faces = np.asarray(shape.vertices), np.asarray(shape.faces)
        on_it = None if made is None else Texture(*texture_coordinates(made), texture(image))
        scene = Scene(x, faces, colors=colors, texture=on_it)
        render(path, scene, view=upright(options, mesh, fields))

    picture = options.picture or output.with_name(f"{output.stem}-pattern.png")
    return report | {"warnings": said, "picture": draw_picture(draw, picture, options, console)}


def _rings(pixels: int = 256) -> np.ndarray:
    """Concentric rings with an arrow's worth of asymmetry: which way the field goes can be seen."""
    axis = (np.arange(pixels) + 0.5) / pixels * 2 - 1
    u, v = axis[None, :], -axis[:, None]
    ring = np.floor(4 * np.hypot(u, v)) % 2
    ahead = (np.abs(np.arctan2(v, u)) < np.pi / 6) & (ring > 0)
    colors = np.where(ring[..., None] > 0, np.array([0.16, 0.35, 0.55]), np.array([0.96, 0.92, 0.80]))
    return np.where(ahead[..., None], np.array([0.85, 0.40, 0.20]), colors)
