"""Patterns: as many copies as asked for, invariant under the group, in files that other programs read."""

import math
import struct

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

import jaxkvf
from jaxkvf import TriangleMesh, patterns, shapes, vertex_points
from jaxkvf import geometry as g
from jaxkvf.flows import flow
from jaxkvf.patterns import (
    bump,
    emboss,
    fastest_vertex,
    heights,
    paint,
    pattern,
    save_colored,
    save_textured,
    stripes,
)
from jaxkvf.patterns._subdivision import subdivided


def turning(mesh):
    x = np.asarray(mesh.vertices)
    return np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1)


def at_height(mesh, z):
    """The vertex of the outer surface nearest to the height z."""
    x = np.asarray(mesh.vertices)
    return int(np.argmin(np.abs(x[:, 2] - z) - 0.1 * np.hypot(x[:, 0], x[:, 1])))


def pieces(mesh, where):
    """Number of connected pieces of the set of vertices `where`."""
    edges = np.asarray(mesh.topology.edges)
    inner = edges[where[edges].all(axis=1)]
    n = len(where)
    _, label = connected_components(
        coo_array((np.ones(len(inner)), tuple(inner.T)), shape=(n, n)), directed=False
    )
    return len(np.unique(label[where]))


def change(mesh, values, time):
    """RMS of f∘φ^q − f, relative to that of f."""
    end = flow(mesh, turning(mesh), time, vertex_points(mesh))
    corners = values[np.asarray(mesh.faces)[np.asarray(end.points.faces)]]
    moved = (np.asarray(end.points.barycentric) * corners).sum(axis=1)
    return np.sqrt(((moved - values) ** 2).mean() / (values**2).mean())


@pytest.fixture(scope="module")
def spheroid():
    mesh = shapes.ellipsoid(16)
    at = np.array([at_height(mesh, 0.2)])
    return pattern(mesh, turning(mesh), at, 5, period=2 * np.pi, edge=math.inf)


def test_copies_are_counted_and_the_group_keeps_them(spheroid):
    mesh, values = spheroid.mesh, heights(spheroid)
    assert spheroid.coordinates.shape == (5, 2562, 2)
    assert pieces(mesh, values > 0.3) == 5
    sizes = np.bincount(spheroid.copy + 1)[1:]
    assert len(sizes) == 5 and np.ptp(sizes) <= 0.1 * sizes.mean()
    assert change(mesh, values, 2 * np.pi / 5) <= 0.02
    assert change(mesh, values, np.pi / 5) > 0.5  # half a step is no symmetry


@pytest.mark.slow
def test_a_vase_finely_divided():
    mesh = shapes.vase(96)
    found = jaxkvf.period(mesh, turning(mesh)).period
    made = pattern(
        mesh, turning(mesh), np.array([at_height(mesh, 1.1)]), 9, period=found, subdivide=2, edge=math.inf
    )
    assert pieces(made.mesh, heights(made) > 0.3) == 9
    assert change(made.mesh, heights(made), found / 9) <= 0.02


@pytest.mark.slow
def test_the_disk_is_a_normal_chart_along_the_field():
    """On a cylinder the log map unrolls it: u is the angle, v the height."""
    mesh = shapes.cylinder(48, height=3.0)
    x = np.asarray(mesh.vertices)
    p = int(np.argmin(np.abs(x[:, 2]) + np.abs(np.arctan2(x[:, 1], x[:, 0]))))
    made = pattern(mesh, turning(mesh), np.array([p]), 4, period=2 * np.pi, radius=0.6, edge=math.inf)
    chart = made.coordinates[0]
    inside = ~np.isnan(chart[:, 0])
    angle = np.angle(np.exp(1j * (np.arctan2(x[:, 1], x[:, 0]) - np.arctan2(x[p, 1], x[p, 0]))))
    exact = np.stack([angle, x[:, 2] - x[p, 2]], axis=1) / 0.6
    assert inside.sum() > 100 and np.abs(chart[inside] - exact[inside]).max() < 0.03


def test_disks_are_round_on_a_coarse_mesh():
    """Faces as large as a disk: the surface is refined around the disks, and there only."""
    mesh = shapes.ellipsoid(4)
    x = np.asarray(mesh.vertices)
    center = fastest_vertex(mesh, turning(mesh))
    made = pattern(mesh, turning(mesh), [center], 3, period=2 * np.pi, radius=0.4)
    np.testing.assert_array_equal(made.mesh.vertices[: len(x)], mesh.vertices)
    areas = [g.surface_area(g.edge_lengths(m.vertices, m.topology), m.topology) for m in (mesh, made.mesh)]
    assert float(areas[0]) == pytest.approx(float(areas[1]), rel=1e-12)
    assert made.mesh.topology.n_faces < 12_000
    at = made.coordinates[:, np.asarray(made.mesh.faces)]
    inside = np.isfinite(at).all(axis=(2, 3)) & (np.linalg.norm(at, axis=3) <= 1).all(axis=2)
    for copy in range(3):
        a, b, c = np.moveaxis(at[copy][inside[copy]], 1, 0)
        covered = np.linalg.det(np.stack([b - a, c - a], axis=1)) / 2
        assert covered.min() > 0 and covered.sum() > 0.8 * np.pi
        sides = np.linalg.norm(np.stack([b - a, c - b, a - c]), axis=2)
        assert sides.max() < 0.16


def test_centres_keep_away_from_a_boundary():
    mesh = shapes.cylinder(24, height=3.0)
    x = np.asarray(mesh.vertices)
    speed = np.linalg.norm(turning(mesh), axis=1)
    rim = x[np.asarray(mesh.topology.is_boundary_vertex)]
    assert len(rim)
    center = fastest_vertex(mesh, turning(mesh), 0.2)
    assert np.linalg.norm(rim - x[center], axis=1).min() >= 0.2 * speed[center]
    on_rim = int(np.flatnonzero(np.asarray(mesh.topology.is_boundary_vertex))[0])
    with pytest.warns(UserWarning, match="reaches over the boundary"):
        pattern(mesh, turning(mesh), [on_rim], 4, period=2 * np.pi, radius=0.2, edge=0.5)


def test_relief_and_colours(spheroid):
    relief = emboss(spheroid, 0.1)
    moved = np.linalg.norm(np.asarray(relief.vertices - spheroid.mesh.vertices), axis=1)
    np.testing.assert_allclose(moved, 0.1 * heights(spheroid), atol=1e-14)
    assert moved.max() == pytest.approx(0.1, rel=0.05)
    image = np.zeros((64, 64, 3))
    image[:, 32:, 0] = 1.0  # red ahead, black behind
    colors = paint(spheroid, image, background=(0.0, 0.0, 1.0))
    u = np.nan_to_num(spheroid.disk[:, 0])
    ahead, outside = u > 0.05, spheroid.copy < 0
    np.testing.assert_allclose(colors[outside], [[0, 0, 1]] * outside.sum())
    assert (colors[ahead, 0] == 1).all() and (colors[u < -0.05, 0] == 0).all()
    np.testing.assert_array_equal(bump(np.array([0.0, 1.0, 2.0]), np.zeros(3)), [1, 0, 0])


def test_subdivision_is_the_same_surface():
    mesh = shapes.torus(12, 6)
    fine, points = subdivided(mesh, 3)
    assert fine.topology.n_faces == 9 * mesh.topology.n_faces and fine.topology.euler_characteristic == 0
    np.testing.assert_array_equal(fine.vertices[: mesh.topology.n_vertices], mesh.vertices)
    areas = [g.surface_area(g.edge_lengths(m.vertices, m.topology), m.topology) for m in (mesh, fine)]
    assert float(areas[0]) == pytest.approx(float(areas[1]), rel=1e-12)
    assert (np.asarray(points.barycentric) >= 0).all()


def test_textured_files_are_read_by_others(spheroid, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    image = np.zeros((64, 64, 3))
    image[..., 1] = 1.0
    save_textured(tmp_path / "p.glb", spheroid, image)
    data = (tmp_path / "p.glb").read_bytes()
    assert data[:4] == b"glTF" and struct.unpack("<I", data[8:12])[0] == len(data)
    (loaded,) = trimesh.load(tmp_path / "p.glb").geometry.values()
    assert len(loaded.faces) == spheroid.mesh.topology.n_faces
    picture = np.asarray(loaded.visual.material.baseColorTexture.convert("RGB")) / 255
    column, row = (loaded.visual.uv * [1, -1] + [0, 1]).T * (len(picture) - 1)
    shown = picture[np.clip(row.round().astype(int), 0, None), np.clip(column.round().astype(int), 0, None)]
    _, nearest = KDTree(np.asarray(spheroid.mesh.vertices)).query(loaded.vertices)
    radius = np.linalg.norm(np.nan_to_num(spheroid.disk, nan=9), axis=1)[nearest]
    assert (shown[radius < 0.9] == [0, 1, 0]).all() and (shown[radius > 1.1][:, 0] > 0.5).all()

    save_textured(tmp_path / "p.obj", spheroid, image)
    back = TriangleMesh.load(tmp_path / "p.obj")
    np.testing.assert_array_equal(back.vertices, spheroid.mesh.vertices)
    np.testing.assert_array_equal(back.faces, spheroid.mesh.faces)
    assert "map_Kd p.png" in (tmp_path / "p.mtl").read_text()
    assert patterns.read_image(tmp_path / "p.png").shape == (84, 84, 3)

    save_colored(tmp_path / "p.ply", spheroid.mesh, paint(spheroid, image))
    colors = trimesh.load(tmp_path / "p.ply", process=False).visual.vertex_colors
    assert (colors[spheroid.copy >= 0, :3] == [0, 255, 0]).all()
    np.testing.assert_array_equal(TriangleMesh.load(tmp_path / "p.ply").vertices, spheroid.mesh.vertices)
    assert sorted(f.name for f in tmp_path.iterdir()) == ["p.glb", "p.mtl", "p.obj", "p.ply", "p.png"]


@pytest.mark.slow
def test_stripes_follow_the_group():
    mesh = shapes.ellipsoid(16)
    x = np.asarray(mesh.vertices)
    away = np.hypot(x[:, 0], x[:, 1]) > 0.4
    across = stripes(mesh, turning(mesh), 4, period=2 * np.pi)
    phase = 4 * np.arctan2(x[:, 1], x[:, 0])
    fit = np.linalg.lstsq(np.stack([np.cos(phase), np.sin(phase)], 1)[away], across[away])[0]
    rest = np.stack([np.cos(phase), np.sin(phase)], 1) @ fit - across
    assert np.linalg.norm(fit) == pytest.approx(1, abs=0.01) and np.sqrt((rest[away] ** 2).mean()) < 0.05
    along = stripes(mesh, turning(mesh), 2, direction="along")
    turned = flow(mesh, turning(mesh), 1.0, vertex_points(mesh))
    moved = (
        np.asarray(turned.points.barycentric) * along[np.asarray(mesh.faces)[np.asarray(turned.points.faces)]]
    ).sum(axis=1)
    assert np.sqrt(((moved - along) ** 2).mean()) < 0.02 and along.min() < -0.9
    torus = shapes.torus(24, 12)
    with pytest.raises(ValueError, match="no single-valued stream function"):
        stripes(torus, turning(torus), 3, direction="along")


def test_bad_input_is_named(spheroid, tmp_path):
    mesh = spheroid.mesh
    turn, at = turning(mesh), np.array([at_height(mesh, 0.2)])
    for arguments, options, message in (
        ((turn, at, 0), {}, "m must be an integer of at least 1, got 0"),
        ((turn, np.array([9999]), 3), {"period": 1.0}, "vertex 9999 does not exist"),
        ((turn, at, 3), {"period": 6.0, "radius": -1.0}, "radius must be positive and finite, got -1.0"),
        ((turn, at, 3), {"period": 6.0, "subdivide": 0}, "subdivide must be an integer"),
        (
            (turn, np.array([int(np.argmax(mesh.vertices[:, 2]))]), 3),
            {"period": 6.0},
            "the field vanishes at vertex",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            pattern(mesh, *arguments, **options)
    with pytest.warns(UserWarning, match="m ≤ 6 of this radius would fit"):
        pattern(mesh, turn, at, 8, period=2 * np.pi, radius=0.5, edge=math.inf)
    with pytest.raises(ValueError, match=r"written as \.glb or \.obj, not '\.stl'"):
        save_textured(tmp_path / "x.stl", spheroid, np.zeros((4, 4, 3)))
    with pytest.raises(ValueError, match=r"written as \.ply"):
        save_colored(tmp_path / "x.obj", mesh, np.zeros((2562, 3)))
    with pytest.raises(ValueError, match="direction must be 'across' or 'along'"):
        patterns.stripes(mesh, turn, 3, direction="up")
