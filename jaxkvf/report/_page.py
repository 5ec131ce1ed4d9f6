"""The contents of a report as one HTML page: our page, style and script, three.js, and arrays in base64."""

import base64
import html
import importlib.resources
import json
import re
from typing import Any

import numpy as np
from jaxtyping import Float, Num

from ..extras import extra
from ..fields import EXACT
from ..geometry import edge_lengths, mean_edge_length, split_at_creases, spread_evenly
from ..mesh import TriangleMesh
from ..viz import CREASE_ANGLE, SPEED_MAP, X_UP, Y_UP, Z_UP, color_map, view_upright
from ._axis import symmetry_axis
from ._contents import CARRIED, Contents, FlowLines

_ARROWS = 300
_LIFT = 0.0012
"""How far flow lines are lifted off their faces, in diagonals of the bounding box: chords would dip into the surface."""


def three_js() -> str:
    """The source of three.js r130 with its controls and wide lines, out of the installed package `jupyter-threejs-sage`.

    Raises:
        ImportError: it is not installed; the message says what to do.
    """
    package = extra("jupyter_threejs_sage")
    return (importlib.resources.files(package) / "static/r130/three.min.js").read_text(encoding="utf-8")


def page(told: tuple[Contents, ...], library: str, *, title: str, up: str) -> str:
    """The page as text.

    Args:
        told: the surface, and perhaps another one of the same connectivity.
        library: three.js.
        title: plain text.
        up: `"x"`, `"y"`, `"z"`; or `"auto"`, the last surface's axis, and y without one.
    """
    first, others = told[0], told[1:]
    names = ("original", "symmetrized") if others else ("",)
    views = {"x": X_UP, "y": Y_UP, "z": Z_UP}
    axis = symmetry_axis(told[-1].mesh, told[-1].fields)
    if axis is not None:
        views = {"axis": view_upright(axis)} | views
    if up == "auto":
        up = "y" if axis is None else "axis"
    data = {
        "up": up,
        "views": {name: np.array(view).tolist() for name, view in views.items()},
        "faces": _encoded(np.asarray(first.mesh.faces), np.uint32),
        "exact": EXACT,
        "colors": _encoded(255 * color_map(SPEED_MAP)(np.linspace(0, 1, 256))[:, :3], np.uint8),
        "surfaces": [_shown(each, name) for each, name in zip(told, names, strict=True)],
    }
    if others:
        data["displacement"] = _scaled(_displacement(first.mesh, others[0].mesh))
    parts = {
        "title": html.escape(title),
        "style": _asset("page.css"),
        "three": library,
        "data": json.dumps(data, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c"),
        "script": "\n".join(_asset(name) for name in ("scene.js", "spectrum.js", "page.js")),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _asset("page.html"))


def _asset(name: str) -> str:
    return (importlib.resources.files("jaxkvf.report") / "assets" / name).read_text(encoding="utf-8")


def _shown(told: Contents, name: str) -> dict[str, Any]:
    mesh, fields, topology = told.mesh, told.fields, told.mesh.topology
    x, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    used = x[np.unique(faces)]
    drawn, copied = split_at_creases(x, faces, CREASE_ANGLE)
    arrows = spread_evenly(x, faces, min(_ARROWS, len(used)))
    low, high = used.min(axis=0), used.max(axis=0)
    root = np.sqrt(float(fields.area))
    return {
        "name": name,
        "vertices": _encoded(x, np.float32),
        "drawn": {"faces": _encoded(drawn, np.uint32), "copied": _encoded(copied[len(x) :], np.uint32)},
        "low": low.tolist(),
        "high": high.tolist(),
        "arrows": {
            "faces": _encoded(arrows.faces, np.uint32),
            "weights": _encoded(arrows.barycentric, np.float32),
            "spacing": arrows.spacing,
        },
        "facts": {
            "vertices": topology.n_vertices,
            "faces": topology.n_faces,
            "area": float(fields.area),
            "boundary loops": topology.boundary_loops()[0],
            "components": topology.components()[0],
            "solver": fields.solver,
        },
        "fields": [
            {
                "lambda": float(fields.eigenvalues[i]),
                "dimensionless": float(fields.dimensionless[i]),
                "cluster": int(fields.clusters[i]),
                "residual": float(fields.residuals[i]),
                "trusted": bool(fields.trusted[i]),
                "components": np.flatnonzero(told.shares[i] > CARRIED * told.shares[i].max()).tolist(),
                "period": None
                if (found := told.periods[i]) is None
                else {
                    "time": found.period,
                    "spread": found.spread,
                    "closed": int(found.closed.sum()),
                    "curves": len(found.closed),
                },
                "vectors": _scaled(root * np.asarray(fields.vectors[i])),
                "strains": _scaled(float(fields.area) * told.strains[i]),
                "lines": _lines(told.lines[i], x[faces], low, high),
            }
            for i in range(len(told.lines))
        ],
    }


def _lines(
    lines: FlowLines,
    corners: Float[np.ndarray, "F 3 3"],
    low: Float[np.ndarray, "3"],
    high: Float[np.ndarray, "3"],
) -> dict[str, Any]:
    """Lifted off the surface, in 65,535ths of the bounding box."""
    a, b, c = np.moveaxis(corners[lines.faces], 2, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    reach = float(np.linalg.norm(high - low))
    inside = (lines.positions + _LIFT * reach * normals - low + 0.01 * reach) / (1.02 * reach)
    return {
        "positions": _encoded(np.round(65535 * np.clip(inside, 0, 1)), np.uint16),
        "counts": lines.counts.tolist(),
        "origin": (low - 0.01 * reach).tolist(),
        "reach": 1.02 * reach,
        "points": lines.positions.shape[1],
        "pulses": 6,
    }


def _displacement(before: TriangleMesh, after: TriangleMesh) -> Float[np.ndarray, " V"]:
    """How far each vertex is from where it was, in mean edge lengths."""
    unit = float(mean_edge_length(edge_lengths(before.vertices, before.topology)))
    return np.linalg.norm(np.asarray(after.vertices - before.vertices), axis=1) / unit


def _scaled(values: Num[np.ndarray, "..."]) -> dict[str, Any]:
    """Numbers in 32,767ths of the largest: far below what can be seen."""
    most = float(np.abs(values).max())
    return {"most": most, "parts": _encoded(np.round(values * (32767 / most if most > 0 else 0)), np.int16)}


def _encoded(values: Num[np.ndarray, "..."], dtype: type) -> str:
    """Little-endian numbers in base64."""
    whole = np.ascontiguousarray(values, np.dtype(dtype).newbyteorder("<"))
    return base64.b64encode(whole.tobytes()).decode("ascii")
