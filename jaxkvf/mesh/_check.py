"""Everything that is wrong with a mesh, listed: with counts, first offenders and remedies."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, Int

from . import _defects
from ._errors import MeshError
from ._io import read_raw
from ._outward import inside_out
from ._raw import RawMesh
from ._seams import closing
from ._triangle_mesh import TriangleMesh
from ._validation import name_first, polygon_arrays, vertex_array

MeshSource = TriangleMesh | str | os.PathLike[str] | tuple[Any, Any]

Steps = dict[str, bool | int | float]

_THIN_ANGLE = 1.0  # degrees
_SPECK = 0.01
_FAR = 1e6  # sizes from the origin: then half of float64's digits are left for the shape


@dataclass(frozen=True)
class Finding:
    """One kind of thing that was found."""

    kind: str
    """In the field's words: `"non-manifold edges"`."""
    count: int
    where: str
    """The first of them: `"faces 3, 8"`; empty where places make no sense."""
    first: tuple[int, ...]
    """The first indices, at most five, of faces, vertices or whatever `where` names."""
    remedy: str
    """What to do; the arguments of `repair` where there are some."""
    steps: Steps = field(default_factory=dict)
    """These arguments: `repair(mesh, **finding.steps)` mends it. Empty where it cannot, or need not."""

    def __str__(self) -> str:
        return f"{self.count} {self.kind}" + (f" ({self.where})" if self.where else "") + f": {self.remedy}"


@dataclass(frozen=True)
class MeshReport:
    """What `check` found."""

    n_vertices: int
    n_faces: int
    errors: tuple[Finding, ...]
    """What `TriangleMesh` refuses; empty if and only if `TriangleMesh.from_arrays` takes the mesh."""
    remarks: tuple[Finding, ...]
    """What it takes, but you may want to know; looked for once there are no errors."""
    notes: tuple[str, ...] = ()
    """What reading the file did: corners of STL merged, precision."""

    @property
    def ok(self) -> bool:
        """Whether the mesh can be used as it is."""
        return not self.errors

    def __str__(self) -> str:
        verdict = "can be used as it is" if self.ok else "cannot be used as it is"
        lines = [f"{self.n_vertices} vertices, {self.n_faces} faces: {verdict}"]
        lines += [f"error: {finding}" for finding in self.errors]
        lines += [f"remark: {finding}" for finding in self.remarks]
        lines += [f"note: {note}" for note in self.notes]
        return "\n".join(lines)


def check(mesh: MeshSource) -> MeshReport:
    """Lists everything wrong with a mesh; changes nothing.

    Args:
        mesh: a `TriangleMesh`, the path of a file, or a pair of arrays `(vertices, faces)`.

    Raises:
        OSError: the file cannot be read. (Content that is no triangle mesh at all is an error in the report.)
    """
    try:
        raw = raw_mesh(mesh)
    except MeshError as error:
        unreadable = Finding("unreadable mesh", 1, "", (), str(error))
        return MeshReport(0, 0, (unreadable,), ())
    vertices = as_jax_sees(raw.vertices)
    errors = _no_triangles(raw.polygons.sizes)
    remarks: list[Finding] = []
    if not errors:
        faces = raw.triangles
        errors = _errors(vertices, faces)
        remarks = [] if errors else _remarks(vertices, faces)
    return MeshReport(len(vertices), len(raw.polygons.sizes), tuple(errors), tuple(remarks), raw.notes)


def as_jax_sees(vertices: np.ndarray) -> np.ndarray:
    """In the dtype that they will be computed with: float32 where float64 is switched off."""
    with np.errstate(over="ignore"):
        return vertices.astype(jax.dtypes.canonicalize_dtype(vertices.dtype))


def raw_mesh(mesh: MeshSource) -> RawMesh:
    """Vertices and faces of whatever a mesh may be given as, as they are.

    Raises:
        MeshError: not arrays of numbers of the right shape, or a file that is damaged or holds nothing.
        OSError: the file cannot be read.
    """
    if isinstance(mesh, TriangleMesh):
        vertices, faces = mesh.vertices, mesh.faces
    elif isinstance(mesh, tuple):
        vertices, faces = mesh
    else:
        raw = read_raw(mesh)
        if not len(raw.vertices) or not len(raw.polygons.sizes):
            raise MeshError(f"{mesh}: there are no {'faces' if len(raw.vertices) else 'vertices'}")
        return raw
    return RawMesh(vertex_array(vertices), polygon_arrays(faces))


def _no_triangles(sizes: Int[np.ndarray, " F"]) -> list[Finding]:
    """Faces of other than three corners; what else is wrong is seen once there are none."""
    found: list[Finding] = []
    few, many = np.flatnonzero(sizes < 3), np.flatnonzero(sizes > 3)
    _add(found, "faces of fewer than three corners", "face", few, {"drop_degenerate": True})
    _add(found, "faces of more than three corners", "face", many, {"triangulate": True})
    return found


def _errors(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> list[Finding]:
    """What `TriangleMesh` refuses. What is no triangle at all is left out when its neighbours are looked at."""
    found: list[Finding] = []
    lost, outside = _defects.not_finite(vertices), _defects.out_of_range(faces, len(vertices))
    _add(found, "positions that are not finite", "vertex", lost, {"drop_invalid": True})
    _add(found, "faces with a corner that is no vertex", "face", outside, {"drop_invalid": True})
    invalid = np.union1d(outside, invalid_faces(vertices, faces))
    valid = np.setdiff1d(np.arange(len(faces)), invalid)
    repeated = valid[_defects.with_repeated_corner(faces[valid])]
    _add(found, "faces with a repeated corner", "face", repeated, {"drop_degenerate": True})
    usable = np.setdiff1d(valid, repeated)
    again, usable = _doubled(faces, usable, len(vertices))
    _add(found, "faces over the same vertices as another", "face", again, {"drop_duplicate_faces": True})
    flat = usable[_defects.flat_faces(vertices, faces[usable])]
    gluing = _defects.Gluing.of(faces[usable], len(vertices))
    pinched = _pinched(gluing, len(vertices))
    seam = None
    if gluing.crowded.size or pinched.size or (flat.size and (gluing.uses == 1).any()):
        seam = closing(vertices, faces[np.setdiff1d(usable, flat)])
    sewing: Steps = {} if seam is None else {"merge_duplicates": seam.distance or True}
    beyond = usable[_defects.beyond_range(vertices, faces[usable])]
    if len(flat) < len(usable) or len(beyond) == 0:
        _add(found, "faces of zero area", "face", flat, sewing | {"drop_degenerate": True})
    _add(
        found,
        "faces beyond the range of the dtype",
        "face",
        beyond,
        "rescale the mesh, or compute in float64",
    )
    in_range = np.setdiff1d(np.arange(len(faces)), outside)
    unused = _defects.unreferenced(faces[in_range], len(vertices))
    _add(found, "unreferenced vertices", "vertex", unused, {"drop_unreferenced": True})
    remedy = sewing or {"split_nonmanifold": True}
    _add(found, "edges of more than two faces", "vertex", gluing.crowded, remedy, _ends_of(gluing))
    _add(found, "vertices where sheets touch", "vertex", pinched, remedy)
    turned, one_sided = gluing.flips()
    _add(
        found,
        "faces on one-sided pieces",
        "face",
        usable[one_sided],
        "no orientation exists; cut the surface open",
    )
    _add(found, "faces that look the other way", "face", usable[turned & ~one_sided], {"orient": True})
    return found


def _pinched(gluing: _defects.Gluing, n_vertices: int) -> Int[np.ndarray, " n"]:
    """Vertices of several fans, where no edge has too many faces."""
    _, owner = gluing.fans()
    several = np.flatnonzero(np.bincount(owner, minlength=n_vertices) > 1)
    return np.setdiff1d(several, gluing.edges[gluing.crowded])


def _doubled(
    faces: Int[np.ndarray, "F 3"], usable: Int[np.ndarray, " u"], n_vertices: int
) -> tuple[Int[np.ndarray, " d"], Int[np.ndarray, " r"]]:
    """Those of the usable faces that repeat another at an edge of more than two faces, and the rest."""
    gluing = _defects.Gluing.of(faces[usable], n_vertices)
    if not gluing.crowded.size:
        return usable[:0], usable
    crowded = (gluing.uses[gluing.halfedge_edges] > 2).reshape(-1, 3).any(axis=1)
    again = _defects.repeated_faces(faces[usable])
    again = again[np.asarray(crowded)[again]]
    return usable[again], np.delete(usable, again)


def _ends_of(gluing: _defects.Gluing) -> Callable[[Int[np.ndarray, " n"]], str]:
    return lambda first: "between vertices " + ", ".join(f"{i}–{j}" for i, j in gluing.edges[first].tolist())


def invalid_faces(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, " n"]:
    """Faces with a corner that is no vertex, or one without a position."""
    outside = _defects.out_of_range(faces, len(vertices))
    bad = np.zeros(len(vertices), bool)
    bad[_defects.not_finite(vertices)] = True
    within = np.where((faces < 0) | (faces >= len(vertices)), 0, faces)
    return np.union1d(outside, np.flatnonzero(bad[within].any(axis=1)))


def _remarks(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> list[Finding]:
    found: list[Finding] = []
    gluing = _defects.Gluing.of(faces, len(vertices))
    _add_seam_remark(found, vertices, faces)
    again = _defects.repeated_faces(faces)
    remedy = f"{_call({'drop_duplicate_faces': True})} keeps one"
    _add(found, "faces over the same vertices as another", "face", again, remedy)
    n_pieces, piece = gluing.face_components()
    if n_pieces > 1:
        found.append(_components_remark(vertices, faces, n_pieces, piece))
    inwards = np.flatnonzero(inside_out(vertices, faces, gluing))
    if inwards.size:
        _, representative = np.unique(piece[inwards], return_index=True)
        first = inwards[np.sort(representative)]
        _add(found, "closed pieces turned inside out", "face", first, {"orient": True})
    boundary = np.flatnonzero(gluing.uses == 1)
    if boundary.size:
        ends = gluing.edges[boundary[:5]]
        where = "between vertices " + ", ".join(f"{i}–{j}" for i, j in ends.tolist())
        found.append(
            Finding(
                "boundary edges",
                len(boundary),
                where,
                tuple(ends[:, 0].tolist()),
                "left free, which is allowed",
            )
        )
    cotangents, angles = _corner_shapes(vertices, faces)
    needles = np.flatnonzero(_thickness(vertices, faces) < _needle(vertices.dtype))
    _add(
        found,
        f"faces thinner than {_needle(vertices.dtype):.0e} of their longest side",
        "face",
        needles,
        "at the edge of what floating point holds; remesh, or merge their short sides",
    )
    thin = np.flatnonzero(angles.min(axis=1) < _THIN_ANGLE)
    smallest = float(angles.min())
    _add(
        found,
        f"faces with an angle below {_THIN_ANGLE:g}°",
        "face",
        thin,
        f"the smallest is {smallest:.2g}°; see the discretization regge-delaunay, or remesh",
    )
    opposite = np.roll(cotangents, 1, axis=1).ravel()
    weight = np.bincount(gluing.halfedge_edges, opposite, minlength=len(gluing.edges))
    _add(
        found,
        "edges that are not Delaunay",
        "edge",
        np.flatnonzero(weight < -1e-8),
        "the discretizations dec and regge-delaunay flip what can be flipped",
        _ends_of(gluing),
    )
    size, distance = np.ptp(vertices, axis=0).max(), np.abs(vertices).max()
    if distance > _FAR * size:
        remedy = f"at {distance:.2g} for a size of {size:.2g}: digits are lost; {_call({'to_origin': True})}"
        found.append(Finding("mesh far from the origin", 1, "", (), remedy))
    return found


def _add_seam_remark(
    found: list[Finding], vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> None:
    """Copies of vertices at the same place, or nearly so along boundaries."""
    copies = np.flatnonzero(_defects.coincident(vertices) != np.arange(len(vertices)))
    seam = closing(vertices, faces)
    if seam is not None and seam.distance:
        kind = f"vertices within {seam.distance:g} of another along a seam"
        remedy = f"{_call({'merge_duplicates': seam.distance})} if seams should close"
        _add(found, kind, "vertex", seam.vertices, remedy)
    else:
        remedy = f"{_call({'merge_duplicates': True})} if seams should close"
        _add(found, "vertices at the position of another", "vertex", copies, remedy)


def _components_remark(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], count: int, piece: np.ndarray
) -> Finding:
    """How many pieces, how large, and how small the specks among them are."""
    areas = piece_areas(vertices, faces, piece, count)
    order = np.argsort(-areas, kind="stable")
    sizes = np.bincount(piece)[order]
    where = f"of {', '.join(map(str, sizes[:5]))}{' …' if count > 5 else ''} faces"
    specks = int((areas < _SPECK * areas.max()).sum())
    if specks:
        smallest = areas.min() / areas.sum()
        where += f"; {specks} below {100 * _SPECK:g} % of the largest's area, the smallest {smallest:.1g} of the whole"
    keep = count - specks
    remedy = (
        f"{_call({'keep_largest': keep if specks else 1})} drops {'the specks' if specks else 'all but one'}"
    )
    return Finding("components", count, where, (), remedy)


def piece_areas(
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    piece: Int[np.ndarray, " F"],
    count: int,
) -> Float[np.ndarray, " count"]:
    """Area of each piece, in units of the square of the size of all."""
    corner = vertices[faces].astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        corner = (corner - corner[0, 0]) / np.abs(corner - corner[0, 0]).max()
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return np.bincount(piece, np.linalg.norm(np.nan_to_num(across), axis=1) / 2, minlength=count)


def _needle(dtype: np.dtype) -> float:
    return float(np.sqrt(np.finfo(dtype).eps))


def _thickness(vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> Float[np.ndarray, " F"]:
    """Height over the longest side, as a part of that side."""
    corner = vertices[faces].astype(np.float64)
    sides = np.roll(corner, -1, axis=1) - corner
    longest = np.abs(sides).max(axis=(1, 2), keepdims=True)
    sides = sides / longest
    squares = (sides**2).sum(axis=2).max(axis=1)
    return np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / squares


def _corner_shapes(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
) -> tuple[Float[np.ndarray, "F 3"], Float[np.ndarray, "F 3"]]:
    """Cotangent and angle (degrees) at each corner, from the embedding."""
    corner = vertices[faces].astype(np.float64)
    size = np.abs(corner - corner[:, :1]).max()
    after = (np.roll(corner, -1, axis=1) - corner) / size
    before = (np.roll(corner, 1, axis=1) - corner) / size
    cross = np.linalg.norm(np.cross(after, before), axis=2)
    dot = (after * before).sum(axis=2)
    return dot / cross, np.degrees(np.arctan2(cross, dot))


def _call(steps: Steps) -> str:
    return f"repair(…, {', '.join(f'{name}={value!r}' for name, value in steps.items())})"


def _add(  # noqa: PLR0917
    found: list[Finding],
    kind: str,
    what: str,
    indices: Int[np.ndarray, " n"],
    remedy: str | Steps,
    where: Callable[[Int[np.ndarray, " n"]], str] | None = None,
) -> None:
    if not indices.size:
        return
    first = indices[:5]
    named = where(first) if where else name_first(what, indices)
    steps = {} if isinstance(remedy, str) else remedy
    text = remedy if isinstance(remedy, str) else _call(remedy)
    found.append(Finding(kind, len(indices), named, tuple(first.tolist()), text, steps))
