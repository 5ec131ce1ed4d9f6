"""Lengths, areas, angles, curvatures, frames and transport, against identities and closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxkvf import TriangleMesh, shapes
from jaxkvf import geometry as g

MESHES = {
    "sphere": lambda: shapes.icosphere(5),
    "random": lambda: shapes.random_sphere(80, seed=1, radii=(1.0, 1.0, 2.5)),
    "torus": lambda: shapes.torus(14, 9),
    "disk": lambda: shapes.disk(4),
    "cylinder": lambda: shapes.cylinder(9, 4),
}


def one_triangle(*points):
    mesh = TriangleMesh.from_arrays(np.asarray(points, float), [[0, 1, 2]])
    return g.edge_lengths(mesh.vertices, mesh.topology), mesh.topology


@pytest.mark.parametrize("name", MESHES)
def test_areas_add_up_and_gauss_bonnet_holds(name):
    mesh = MESHES[name]()
    topology = mesh.topology
    lengths = g.edge_lengths(mesh.vertices, topology)
    area = float(g.surface_area(lengths, topology))
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(area, 0.5 * np.linalg.norm(cross, axis=1).sum(), rtol=1e-12)
    for parts in (g.barycentric_vertex_areas, g.circumcentric_vertex_areas, g.edge_areas):
        np.testing.assert_allclose(float(parts(lengths, topology).sum()), area, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(g.corner_angles(lengths, topology)).sum(1), np.pi, rtol=1e-13)
    curvature = g.angle_defects(lengths, topology).sum() + g.geodesic_curvatures(lengths, topology).sum()
    np.testing.assert_allclose(float(curvature), 2 * np.pi * topology.euler_characteristic, atol=1e-11)


def test_angles_and_cotangents_of_a_known_triangle():
    lengths, topology = one_triangle([0, 0, 0], [1, 0, 0], [0, 1, 0])
    np.testing.assert_allclose(
        g.corner_angles(lengths, topology), [[np.pi / 2, np.pi / 4, np.pi / 4]], rtol=1e-15
    )
    np.testing.assert_allclose(g.corner_cotangents(lengths, topology), [[0, 1, 1]], atol=1e-15)
    np.testing.assert_allclose(g.face_areas(lengths, topology), [0.5], rtol=1e-15)


@pytest.mark.parametrize("height", [1e-3, 1e-6, 1e-9])
def test_thin_triangles_keep_their_digits(height):
    """A needle with exactly representable lengths: sides 1, 1 and a base b; area = b/2 √(1 − b²/4)."""
    _, topology = one_triangle([0, 0, 0], [1, 0, 0], [0, 1, 0])
    base = float(np.float64(2.0) ** np.round(np.log2(height)))
    # edges are (0,1), (0,2), (1,2)
    lengths = jnp.asarray([1.0, 1.0, base])
    exact = 0.5 * base * np.sqrt((1 - base / 2) * (1 + base / 2))
    np.testing.assert_allclose(g.face_areas(lengths, topology), [exact], rtol=4e-16)
    np.testing.assert_allclose(
        np.asarray(g.corner_angles(lengths, topology))[0, 0], 2 * np.arcsin(base / 2), rtol=1e-12
    )
    gradient = jax.grad(lambda x: g.face_areas(x, topology).sum())(lengths)
    slope = (1 - base**2 / 2) / (2 * np.sqrt((1 - base / 2) * (1 + base / 2)))  # d area / d base
    np.testing.assert_allclose(gradient[2], slope, rtol=1e-12)


def test_second_derivative_of_area_at_a_tie():
    """An equilateral triangle: all three lengths tie in the sort, and the Hessian must still be that of Heron."""
    _, topology = one_triangle([0, 0, 0], [1, 0, 0], [0, 1, 0])

    def heron(x):
        a, b, c = x
        return 0.25 * jnp.sqrt((a + b + c) * (b + c - a) * (c + a - b) * (a + b - c))

    x = jnp.ones(3)
    ours = jax.hessian(lambda x: g.face_areas(x, topology).sum())(x)
    np.testing.assert_allclose(ours, jax.hessian(heron)(x), atol=1e-13)


def test_vertex_areas_on_a_regular_hexagon():
    mesh = shapes.disk(3)
    topology = mesh.topology
    lengths = g.edge_lengths(mesh.vertices, topology)
    centre = int(np.argmin(np.linalg.norm(np.asarray(mesh.vertices), axis=1)))
    side = float(lengths[topology.spoke_edges[topology.spoke_starts[centre]]])
    hexagon = 6 * np.sqrt(3) / 4 * side**2
    ours = float(g.barycentric_vertex_areas(lengths, topology)[centre])
    np.testing.assert_allclose(ours, hexagon / 3, rtol=1e-12)


def test_boundary_of_a_disk_turns_once():
    mesh = shapes.disk(6)
    lengths = g.edge_lengths(mesh.vertices, mesh.topology)
    np.testing.assert_allclose(
        float(g.geodesic_curvatures(lengths, mesh.topology).sum()), 2 * np.pi, rtol=1e-12
    )
    np.testing.assert_allclose(g.angle_defects(lengths, mesh.topology), 0, atol=1e-12)


@pytest.mark.parametrize("name", MESHES)
def test_spoke_angles_fill_the_circle_inside_and_the_corners_at_the_boundary(name):
    mesh = MESHES[name]()
    t = mesh.topology
    lengths = g.edge_lengths(mesh.vertices, t)
    angles, total = np.asarray(g.spoke_angles(lengths, t)), np.asarray(g.cone_angles(lengths, t))
    corner = np.asarray(g.corner_angles(lengths, t)).ravel()
    starts, behind = np.asarray(t.spoke_starts), np.asarray(t.spoke_corners)
    boundary = np.asarray(t.is_boundary_vertex)
    for v in range(t.n_vertices):
        ring = slice(starts[v], starts[v + 1])
        inside = behind[ring][behind[ring] >= 0]
        scale = 1.0 if boundary[v] else 2 * np.pi / total[v]
        expected = np.concatenate([[0], np.cumsum(corner[inside])])[: starts[v + 1] - starts[v]] * scale
        np.testing.assert_allclose(angles[ring], expected, atol=1e-12)


def test_rotations_between_an_edges_two_directions_transport():
    mesh = shapes.random_sphere(200, seed=0)
    lengths, topology = g.edge_lengths(mesh.vertices, mesh.topology), mesh.topology
    tail, head = jnp.moveaxis(g.edge_directions(lengths, topology), 1, 0)
    turns = g.rotations_between(tail, head)
    np.testing.assert_allclose(jnp.einsum("eij,ej->ei", turns, tail), head, atol=1e-14)
    expected = g.rotations(g.transport_angles(lengths, topology))
    np.testing.assert_allclose(turns, expected, atol=1e-13)


def test_transport_around_a_face_turns_by_its_curvature():
    """Counter-clockwise around a face the rotations compose to the excess of its rescaled angles, as on a sphere."""
    mesh = shapes.random_sphere(60, seed=2)
    t = mesh.topology
    lengths = g.edge_lengths(mesh.vertices, t)
    turn = np.asarray(g.transport_angles(lengths, t))
    signed = np.asarray(t.face_edge_signs) * turn[np.asarray(t.face_edges)]
    holonomy = np.exp(1j * signed.sum(1))
    scaled = (
        np.asarray(g.corner_angles(lengths, t))
        * (2 * np.pi / np.asarray(g.cone_angles(lengths, t)))[np.asarray(t.faces)]
    )
    np.testing.assert_allclose(holonomy, np.exp(1j * (scaled.sum(1) - np.pi)), atol=1e-10)
    assert abs(scaled.sum() - np.pi * t.n_faces - 4 * np.pi) < 1e-9  # face curvatures add up to 2πχ


def test_transport_carries_and_returns():
    mesh = shapes.torus(11, 7)
    t = mesh.topology
    lengths = g.edge_lengths(mesh.vertices, t)
    vectors = jnp.asarray(np.random.default_rng(0).standard_normal((t.n_vertices, 2)))
    carried = np.asarray(g.transport(vectors, lengths, t))
    direction = np.asarray(g.edge_directions(lengths, t))
    ends = np.asarray(vectors)[np.asarray(t.edges)]
    along = (ends * direction).sum(-1)
    np.testing.assert_allclose((carried[:, 0] * direction[:, 1]).sum(-1), along[:, 0], atol=1e-13)
    np.testing.assert_allclose((carried[:, 1] * direction[:, 0]).sum(-1), along[:, 1], atol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(carried, axis=-1), np.linalg.norm(ends, axis=-1), rtol=1e-13)


def test_ambient_frames_are_orthonormal_and_tangent():
    mesh = shapes.torus(20, 12)
    frames = np.asarray(g.vertex_frames(mesh.vertices, mesh.topology))
    normals = np.asarray(g.vertex_normals(mesh.vertices, mesh.topology))
    full = np.concatenate([frames, normals[:, None]], axis=1)
    np.testing.assert_allclose(
        full @ full.transpose(0, 2, 1), np.eye(3)[None].repeat(len(full), 0), atol=1e-13
    )
    np.testing.assert_allclose(np.linalg.det(full), 1, rtol=1e-12)


@pytest.mark.parametrize("make", [shapes.icosphere, shapes.disk])
def test_ambient_frames_agree_with_the_intrinsic_directions(make):
    """The spokes' intrinsic directions, embedded, point along the projected edges; better on finer meshes."""
    errors = []
    for n in (8, 16):
        mesh = make(n)
        t = mesh.topology
        lengths = g.edge_lengths(mesh.vertices, t)
        directions = g.unit_vectors(g.spoke_angles(lengths, t))
        frames = g.vertex_frames(mesh.vertices, t)
        vertex = np.asarray(t.spoke_vertices)
        embedded = np.einsum("sc,scd->sd", np.asarray(directions), np.asarray(frames)[vertex])
        x = np.asarray(mesh.vertices)
        edge = x[np.asarray(t.spoke_neighbours)] - x[vertex]
        normal = np.asarray(g.vertex_normals(mesh.vertices, t))[vertex]
        edge -= (edge * normal).sum(1, keepdims=True) * normal
        edge /= np.linalg.norm(edge, axis=1, keepdims=True)
        errors.append(np.sqrt(((embedded - edge) ** 2).sum(1).mean()))
    assert errors[1] < 1e-12 or errors[0] / errors[1] > 3.0


def test_embed_and_project_are_inverse():
    mesh = shapes.icosphere(4)
    frames = g.vertex_frames(mesh.vertices, mesh.topology)
    u = jnp.asarray(np.random.default_rng(0).standard_normal((2, mesh.topology.n_vertices, 2)))
    np.testing.assert_allclose(g.project(g.embed(u, frames), frames), u, atol=1e-14)


def test_everything_is_invariant_under_rigid_motion_and_scales():
    mesh = shapes.random_sphere(60, seed=5)
    rotation, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    moved = mesh.with_vertices(3.0 * mesh.vertices @ jnp.asarray(rotation).T + jnp.asarray([[1.0, 2, 3]]))
    lengths, scaled = (g.edge_lengths(m.vertices, m.topology) for m in (mesh, moved))
    np.testing.assert_allclose(scaled, 3 * lengths, rtol=1e-12)
    t = mesh.topology
    np.testing.assert_allclose(g.face_areas(scaled, t), 9 * g.face_areas(lengths, t), rtol=1e-11)
    np.testing.assert_allclose(g.cotan_weights(scaled, t), g.cotan_weights(lengths, t), atol=1e-9)
    np.testing.assert_allclose(g.spoke_angles(scaled, t), g.spoke_angles(lengths, t), atol=1e-10)


def test_impossible_lengths_give_nan_not_a_clamp():
    _, topology = one_triangle([0, 0, 0], [1, 0, 0], [0, 1, 0])
    assert bool(jnp.isnan(g.face_areas(jnp.asarray([1.0, 1.0, 3.0]), topology)).all())
