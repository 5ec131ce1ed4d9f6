"""Killing fields as a table, and as JSON."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..fields import KillingFields, component_shares
from ..mesh import TriangleMesh
from ..trust import TOO_COARSE

if TYPE_CHECKING:
    from rich.table import Table

_NEARLY_ALL = 0.99
"""Share of ∫|U|² on a component from which on a field is said to live there."""


def fields_table(mesh: TriangleMesh, found: KillingFields, title: str) -> "Table":
    from rich.table import Table  # noqa: PLC0415

    homes = _components(mesh, found)
    table = Table(title=title, title_justify="left")
    for column in ("field", "λ", "λ·area", "multiplicity", "residual", *(["component"] if homes else [])):
        table.add_column(column, justify="right")
    clusters = np.asarray(found.clusters)
    rows = zip(
        np.asarray(found.eigenvalues),
        np.asarray(found.dimensionless),
        clusters,
        np.asarray(found.residuals),
        np.asarray(found.trusted),
        strict=True,
    )
    for i, (value, dimensionless, cluster, residual, trusted) in enumerate(rows):
        size = int((clusters == cluster).sum())
        # The last cluster may go on beyond the fields that were asked for.
        multiplicity = f"≥ {size}" if cluster == clusters[-1] else str(size)
        home = [_spoken(homes[i])] if homes else []
        row = (f"{value:.6g}", judged(dimensionless, trusted, ".6g"), multiplicity, f"{residual:.1e}", *home)
        table.add_row(str(i), *row)
    return table


def judged(dimensionless: float, trusted: bool | np.bool_, digits: str) -> str:
    """λ · area, with a word where the mesh is too coarse for it."""
    return f"{dimensionless:{digits}}" + ("" if trusted else f" ({TOO_COARSE})")


def described(mesh: TriangleMesh, found: KillingFields) -> dict[str, Any]:
    """The same for `--json`."""
    return {
        "vertices": mesh.topology.n_vertices,
        "faces": mesh.topology.n_faces,
        "area": float(found.area),
        "eigenvalues": np.asarray(found.eigenvalues).tolist(),
        "eigenvalues_times_area": np.asarray(found.dimensionless).tolist(),
        "clusters": np.asarray(found.clusters).tolist(),
        "residuals": np.asarray(found.residuals).tolist(),
        "trusted": np.asarray(found.trusted).tolist(),
        "components": _components(mesh, found),
    }


def _components(mesh: TriangleMesh, found: KillingFields) -> list[list[int]] | None:
    """For each field the components that it lives on, the strongest first; None where the surface has one only."""
    if mesh.topology.components()[0] == 1:
        return None
    homes = []
    for shares in component_shares(mesh, found):
        order = np.argsort(-shares, kind="stable")
        needed = int(np.searchsorted(np.cumsum(shares[order]), _NEARLY_ALL)) + 1
        homes.append(order[:needed].tolist())
    return homes


def _spoken(components: list[int]) -> str:
    shown = ", ".join(map(str, components[:3]))
    return shown if len(components) <= 3 else f"{shown} and {len(components) - 3} more"
