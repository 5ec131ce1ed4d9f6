"""The flow against exact motions, its group property, isometric copies, boundaries, singular points; nothing stalls."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from jaxkvf import SurfacePoints, TriangleMesh, closest_points, shapes, surface_positions, vertex_points
from jaxkvf import geometry as g
from jaxkvf.flows import FlowStatus, flow


def random_points(mesh, n, seed=0):
    rng = np.random.default_rng(seed)
    return SurfacePoints(rng.integers(0, mesh.topology.n_faces, n), rng.dirichlet((1, 1, 1), n))


def positions(mesh, points):
    return np.asarray(surface_positions(mesh, points))


def turning(mesh):
    """Rotation around z with angular velocity 1."""
    x = np.asarray(mesh.vertices)
    return np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1)


def mean_edge(mesh):
    return float(g.edge_lengths(mesh.vertices, mesh.topology).mean())


@pytest.fixture(scope="module")
def disk():
    return shapes.disk(6)


@pytest.fixture(scope="module")
def swirl():
    """A smooth field far from Killing, with sources, sinks and saddles, on a surface without symmetry."""
    mesh = shapes.bumpy_sphere(8)
    x, y, z = np.asarray(mesh.vertices).T
    return mesh, np.stack([np.sin(3 * y) + z, np.cos(2 * z) * x, y * x + 0.3], axis=1)


@pytest.mark.parametrize(
    "matrix",
    [[[0, -1], [1, 0]], [[0.3, -2.0], [0.5, -0.6]], [[1.0, 0], [0, -1.0]]],
    ids=["turn", "spiral", "saddle"],
)
def test_linear_fields_in_the_plane_are_followed_exactly(disk, matrix):
    matrix = np.array(matrix, float)
    x = np.asarray(disk.vertices)
    vectors = np.pad(x[:, :2] @ matrix.T, ((0, 0), (0, 1)))
    points = random_points(disk, 200)
    start = positions(disk, points)[:, :2]
    end = flow(disk, vectors, 0.7, points)
    times = np.linspace(0, 0.7, 200)
    furthest = np.max([np.linalg.norm(start @ expm(t * matrix).T, axis=1) for t in times], axis=0)
    stays = (
        furthest < 5 / 6
    )  # in the outermost faces the boundary counts as a flow line where as much comes in as goes out
    assert stays.sum() > 60 and (np.asarray(end.status)[stays] == FlowStatus.ARRIVED).all()
    exact = start @ expm(0.7 * matrix).T
    np.testing.assert_allclose(positions(disk, end.points)[stays, :2], exact[stays], atol=1e-12)
    np.testing.assert_array_equal(np.asarray(end.time)[stays], 0.7)


def test_a_tracer_that_leaves_says_where_and_when(disk):
    vectors = np.tile([2.0, 0.0, 0.0], (disk.topology.n_vertices, 1))
    points = random_points(disk, 200)
    start = positions(disk, points)
    for sign in (1, -1):
        end = flow(disk, vectors, sign * 10.0, points)
        there = positions(disk, end.points)
        assert (np.asarray(end.status) == FlowStatus.LEFT).all()
        corner = np.pi / 36  # half the angle of a side of the boundary, a regular polygon of 36
        angle = np.arctan2(there[:, 1], there[:, 0])
        apothem = np.hypot(there[:, 0], there[:, 1]) * np.cos(np.mod(angle, 2 * corner) - corner)
        np.testing.assert_allclose(apothem, np.cos(corner), rtol=1e-12)
        np.testing.assert_allclose(there[:, 1], start[:, 1], atol=1e-12)
        np.testing.assert_allclose(2 * np.asarray(end.time), there[:, 0] - start[:, 0], atol=1e-12)


def test_singular_points_stay(disk):
    middle = vertex_points(disk, [0])
    for vectors in (turning(disk), np.asarray(disk.vertices), -np.asarray(disk.vertices)):
        end = flow(disk, vectors, 5.0, middle)
        assert end.status.tolist() == [FlowStatus.STATIONARY] and end.time.tolist() == [5.0]
        np.testing.assert_allclose(positions(disk, end.points), 0, atol=1e-15)
    # A sink draws tracers in for ever; none stalls on the way.
    points = random_points(disk, 200)
    end = flow(disk, -np.asarray(disk.vertices), 3.0, points)
    assert (np.asarray(end.status) == FlowStatus.ARRIVED).all()
    start = positions(disk, points)
    np.testing.assert_allclose(positions(disk, end.points), np.exp(-3) * start, atol=1e-12)


def test_group_property_and_inverse(swirl):
    mesh, vectors = swirl
    points = random_points(mesh, 200)
    scale = mean_edge(mesh)
    once = flow(mesh, vectors, 0.9, points)
    assert np.isin(once.status, [FlowStatus.ARRIVED]).all()
    half = flow(mesh, vectors, 0.4, points)
    twice = flow(mesh, vectors, 0.5, half.points)
    gap = np.abs(positions(mesh, once.points) - positions(mesh, twice.points)).max(axis=1)
    assert gap.max() <= 1e-8 * scale
    back = flow(mesh, vectors, -0.9, once.points)
    start = positions(mesh, flow(mesh, vectors, 0.0, points).points)
    assert np.abs(positions(mesh, back.points) - start).max() <= 1e-7 * scale
    each = flow(mesh, vectors, np.where(np.arange(200) % 2, 0.9, -0.9), points)
    np.testing.assert_allclose(
        positions(mesh, each.points)[1::2], positions(mesh, once.points)[1::2], atol=1e-12
    )


@pytest.mark.slow
def test_second_order_on_the_sphere():
    """A Killing field and a gradient on the round sphere, whose flows are known: turns, and z = tanh(t + t₀)."""
    errors = []
    for frequency in (8, 16):
        mesh = shapes.icosphere(frequency)
        x = np.asarray(mesh.vertices)
        towards_pole = np.array([0, 0, 1.0]) - x[:, 2:] * x
        points = random_points(mesh, 200)
        start = flow(mesh, turning(mesh), 0.0, points)
        p = positions(mesh, start.points)
        p = p / np.linalg.norm(p, axis=1, keepdims=True)
        turned = positions(mesh, flow(mesh, turning(mesh), 1.0, points).points)
        c, s = np.cos(1), np.sin(1)
        exact_turn = np.stack([c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1], p[:, 2]], axis=1)
        risen = positions(mesh, flow(mesh, towards_pole, 1.0, points).points)
        height = np.tanh(1 + np.arctanh(p[:, 2]))
        ring = np.sqrt((1 - height**2) / (1 - p[:, 2] ** 2))
        exact_rise = np.stack([ring * p[:, 0], ring * p[:, 1], height], axis=1)
        directions = [y / np.linalg.norm(y, axis=1, keepdims=True) for y in (turned, risen)]
        errors.append([np.abs(directions[0] - exact_turn).max(), np.abs(directions[1] - exact_rise).max()])
    order = np.log2(np.array(errors[0]) / np.array(errors[1]))
    assert max(errors[1]) < 5e-3 and (order > 1.6).all(), (errors, order)


def bent_cylinder():
    """A cylinder of unstaggered rows, and the same with a dent: a part of its cross-section mirrored in a chord."""
    n, rows = 24, 8
    angle, row = 2 * np.pi * np.arange(n) / n, np.arange(rows + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    dented = ring.copy()
    beyond = ring[:, 0] > 0.5
    dented[beyond, 0] = 1 - ring[beyond, 0]
    a, b = np.arange(n), (np.arange(n) + 1) % n
    faces = np.concatenate(
        [
            np.concatenate(
                [
                    np.stack([a + n * k, b + n * k, b + n * (k + 1)], 1),
                    np.stack([a + n * k, b + n * (k + 1), a + n * (k + 1)], 1),
                ]
            )
            for k in row[:-1]
        ]
    )
    return [
        TriangleMesh.from_arrays(
            np.concatenate([np.pad(r, ((0, 0), (0, 1)), constant_values=0.25 * k) for k in row]), faces
        )
        for r in (ring, dented)
    ]


def test_isometric_surfaces_have_the_same_flow():
    meshes = bent_cylinder()
    intrinsic = g.project(
        jnp.asarray(turning(meshes[0]) + np.array([0, 0, 0.3])),
        g.vertex_frames(meshes[0].vertices, meshes[0].topology),
    )
    points = random_points(meshes[0], 200)
    ends = [flow(m, g.embed(intrinsic, g.vertex_frames(m.vertices, m.topology)), 2.0, points) for m in meshes]
    np.testing.assert_array_equal(ends[0].points.faces, ends[1].points.faces)
    np.testing.assert_array_equal(ends[0].status, ends[1].status)
    np.testing.assert_allclose(ends[0].points.barycentric, ends[1].points.barycentric, atol=1e-10)
    assert 20 < (np.asarray(ends[0].status) == FlowStatus.LEFT).sum() < 180


def test_a_tangential_boundary_is_a_flow_line():
    mesh = shapes.spherical_band(24, 6)
    end = flow(mesh, turning(mesh), 2 * np.pi, vertex_points(mesh))
    assert (np.asarray(end.status) == FlowStatus.ARRIVED).all()
    there = positions(mesh, end.points)
    edge = np.asarray(mesh.topology.is_boundary_vertex)
    np.testing.assert_allclose(there[edge, 2], np.asarray(mesh.vertices)[edge, 2], atol=1e-12)
    assert np.linalg.norm(there - np.asarray(mesh.vertices), axis=1).max() < 0.2 * mean_edge(mesh)


@pytest.mark.parametrize("seed", range(3))
def test_nothing_stalls_on_rough_fields(seed):
    """Random vectors on bad triangles: every tracer arrives, or rests where the field leads nowhere."""
    mesh = shapes.random_sphere(642, seed, radii=(1, 1, 2.5))
    vectors = np.random.default_rng(seed).standard_normal((642, 3))
    end = flow(mesh, vectors, 1.0, vertex_points(mesh), max_steps=20_000)
    status = np.asarray(end.status)
    assert not (status == FlowStatus.UNFINISHED).any()
    assert (status == FlowStatus.ARRIVED).mean() > 0.97, np.bincount(status)


@pytest.mark.slow
def test_closest_points():
    mesh = shapes.random_sphere(100, radii=(1, 2, 3))
    points = random_points(mesh, 200)
    on = positions(mesh, points)
    found = closest_points(mesh, on)
    np.testing.assert_allclose(positions(mesh, found), on, atol=1e-12)
    away = 3 * np.random.default_rng(1).standard_normal((50, 3))
    gap = np.linalg.norm(positions(mesh, closest_points(mesh, away)) - away, axis=1)
    many = jax.random.dirichlet(jax.random.key(0), jnp.ones(3), (mesh.topology.n_faces, 200))
    dense = np.einsum("fnc,fcx->fnx", many, np.asarray(mesh.vertices)[np.asarray(mesh.faces)]).reshape(-1, 3)
    sampled = np.linalg.norm(dense[None] - away[:, None], axis=2).min(axis=1)
    assert (gap <= sampled + 1e-12).all() and (sampled - gap).max() < 0.05


def test_bad_input_is_named(disk):
    turn, points = turning(disk), random_points(disk, 2)
    faces, b = points.faces, points.barycentric
    for arguments, message in (
        ((0 * turn, 1.0, points), "zero everywhere"),
        ((turn[:-1], 1.0, points), "vectors must have shape"),
        ((turn * np.nan, 1.0, points), "vectors must be finite; at vertex 0"),
        ((turn, np.nan, points), "time must be finite, got nan"),
        ((turn, np.array([1.0, 2, 3]), points), "time must be a number"),
        ((turn, 1.0, SurfacePoints([0, 10_000], b)), "point 1 is in face 10000"),
        ((turn, 1.0, SurfacePoints(faces, 2 * b)), "point 0 is off the mesh"),
        ((turn, 1.0, SurfacePoints(faces, [[0.5, 0.6, -0.1], [1, 0, 0]])), "point 0 is off the mesh"),
        ((turn, 1.0, SurfacePoints(faces, b[:, :2])), "points need integer faces"),
    ):
        with pytest.raises(ValueError, match=message):
            flow(disk, *arguments)
    with pytest.raises(ValueError, match="max_steps must be an integer of at least 1"):
        flow(disk, turn, 1.0, points, max_steps=0)
    with pytest.raises(ValueError, match="vertex 999 does not exist"):
        vertex_points(disk, [999])
    with pytest.raises(ValueError, match="positions must be finite"):
        closest_points(disk, [[0, 0, np.nan]])
