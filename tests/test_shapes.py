"""Shapes: counts, orientation, areas that converge, angles, symmetry and flatness that the docstrings promise."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jaxkvf import TriangleMesh
from jaxkvf.mesh import shapes


def arrays_of(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def face_vectors(mesh: TriangleMesh) -> np.ndarray:
    """Normals of the faces, as long as the area. [F, 3]"""
    vertices, faces = arrays_of(mesh)
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a) / 2


def area(mesh: TriangleMesh) -> float:
    return float(np.linalg.norm(face_vectors(mesh), axis=1).sum())


def signed_volume(mesh: TriangleMesh) -> float:
    vertices, faces = arrays_of(mesh)
    return float((vertices[faces[:, 0]] * face_vectors(mesh)).sum() / 3)


def edge_lengths(mesh: TriangleMesh) -> np.ndarray:
    tails, heads = np.asarray(mesh.topology.edges).T
    vertices = np.asarray(mesh.vertices)
    return np.linalg.norm(vertices[heads] - vertices[tails], axis=1)


def corner_angles(mesh: TriangleMesh) -> np.ndarray:
    """[F, 3], in degrees."""
    vertices, faces = arrays_of(mesh)
    corners = vertices[faces]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    sine = np.linalg.norm(np.cross(ahead, behind), axis=2)
    return np.degrees(np.arctan2(sine, (ahead * behind).sum(axis=2)))


def boundary_edges(mesh: TriangleMesh) -> np.ndarray:
    """Vertices of the edges with one face. [B, 2]"""
    edges, halfedges = np.asarray(mesh.topology.edges), np.asarray(mesh.topology.edge_halfedges)
    return edges[(halfedges < 0).any(axis=1)]


def boundary_loops(mesh: TriangleMesh) -> int:
    vertices, ends = np.unique(boundary_edges(mesh), return_inverse=True)
    tails, heads = ends.reshape(-1, 2).T
    graph = coo_array((np.ones(len(tails)), (tails, heads)), shape=(len(vertices), len(vertices)))
    return connected_components(graph, directed=False)[0] if len(vertices) else 0


def degrees(mesh: TriangleMesh) -> np.ndarray:
    return np.bincount(np.asarray(mesh.topology.edges).ravel())


def angle_defects(mesh: TriangleMesh) -> np.ndarray:
    """2π less the angles around each inner vertex, 0 on the boundary. In radians."""
    defects = 2 * np.pi - np.bincount(np.asarray(mesh.faces).ravel(), np.radians(corner_angles(mesh)).ravel())
    defects[boundary_edges(mesh)] = 0.0
    return defects


def maps_to_itself(mesh: TriangleMesh, turn: Callable[[np.ndarray], np.ndarray]) -> bool:
    """Whether a rigid motion permutes the vertices, and the faces with them."""
    vertices, faces = arrays_of(mesh)
    distance = np.linalg.norm(turn(vertices)[:, None] - vertices, axis=2)
    image = distance.argmin(axis=1)
    turned = image[faces]
    same = {tuple(np.roll(face, k)) for face in turned for k in range(3)} >= {tuple(face) for face in faces}
    return bool(distance.min(axis=1).max() < 1e-12) and same


def around_z(angle: float) -> Callable[[np.ndarray], np.ndarray]:
    c, s = math.cos(angle), math.sin(angle)
    return lambda points: points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T


def observed_order(error: Callable[[int], float], n: int) -> float:
    return math.log2(error(n) / error(2 * n))


SPHEROID = {"r": np.sin, "z": lambda t: 1.6 * np.cos(t)}
CLOSED = {
    "icosphere": lambda: shapes.icosphere(6),
    "icosahedron": lambda: shapes.icosphere(1),
    "ellipsoid": lambda: shapes.ellipsoid(7),
    "random sphere": lambda: shapes.random_sphere(300, seed=4, radii=(1, 1, 2.5)),
    "spheroid": lambda: shapes.surface_of_revolution(**SPHEROID, n_along=20),
    "spheroid from north to south": lambda: shapes.surface_of_revolution(
        np.sin, lambda t: -1.6 * np.cos(t), 20, n_around=11
    ),
    "vase": shapes.vase,
    "squashed cone": lambda: shapes.squashed_cone(0.4, n_along=20),
    "limbed blob": lambda: shapes.limbed_blob(12),
    "bumpy sphere": lambda: shapes.bumpy_sphere(12),
    "noisy sphere": lambda: shapes.add_normal_noise(shapes.icosphere(8), 0.1, seed=1),
    "torus": lambda: shapes.torus(24, 14),
    "odd torus": lambda: shapes.torus(13, 7, 3, 0.5),
    "torus by its meridian": lambda: shapes.surface_of_revolution(
        lambda t: 2 + np.cos(t), np.sin, 14, interval=(0, 2 * np.pi)
    ),
    "torus the other way round": lambda: shapes.surface_of_revolution(
        lambda t: 2 + np.cos(t), lambda t: -np.sin(t), 15, n_around=20, interval=(0, 2 * np.pi)
    ),
}
OPEN = {  # with the number of boundary loops
    "disk": (lambda: shapes.disk(5), 1),
    "hexagon": (lambda: shapes.disk(1), 1),
    "annulus": (lambda: shapes.annulus(5), 2),
    "cylinder": (lambda: shapes.cylinder(12), 2),
    "flat prism": (lambda: shapes.cylinder(3, 1, 2, 5), 2),
    "cone": (lambda: shapes.cone(16), 2),
    "opening cone": (lambda: shapes.cone(16, bottom_radius=0.2, top_radius=1.0), 2),
    "elliptic cone": (lambda: shapes.elliptic_cone(24), 2),
    "spherical band": (lambda: shapes.spherical_band(24), 2),
    "half sphere": (lambda: shapes.surface_of_revolution(np.sin, np.cos, 9, interval=(0, np.pi / 2)), 1),
    "wavy tube": (
        lambda: shapes.surface_of_revolution(
            lambda t: 1 + 0.3 * np.cos(3 * t), lambda t: t, 20, interval=(0, 3)
        ),
        2,
    ),
}

CURVED = ("spherical band", "half sphere", "wavy tube")


@pytest.mark.parametrize("name", CLOSED)
def test_closed_shapes_are_closed_connected_and_face_outward(name: str):
    mesh = CLOSED[name]()
    assert mesh.topology.euler_characteristic == (0 if "torus" in name else 2)
    assert boundary_loops(mesh) == 0
    assert mesh.topology.components()[0] == 1
    assert signed_volume(mesh) > 0


@pytest.mark.parametrize("name", OPEN)
def test_open_shapes_have_their_boundary_and_face_outward(name: str):
    make, n_loops = OPEN[name]
    mesh = make()
    assert boundary_loops(mesh) == n_loops
    assert mesh.topology.euler_characteristic == 2 - n_loops
    assert mesh.topology.components()[0] == 1
    vertices, faces = arrays_of(mesh)
    centres, normals = vertices[faces].mean(axis=1), face_vectors(mesh)
    if np.ptp(vertices[:, 2]) == 0:
        assert (normals[:, 2] > 0).all()  # flat: seen from above
    else:
        assert ((centres[:, :2] * normals[:, :2]).sum(axis=1) > 0).all()  # away from the axis


@pytest.mark.parametrize("name", [*CLOSED, *OPEN])
def test_the_same_call_makes_the_same_mesh(name: str):
    make = CLOSED[name] if name in CLOSED else OPEN[name][0]
    one, other = make(), make()
    assert np.array_equal(one.vertices, other.vertices)
    assert np.array_equal(one.faces, other.faces)


@pytest.mark.parametrize("frequency", [1, 2, 3, 4, 5, 12, 16, 32])
def test_icosphere_counts_and_degrees(frequency: int):
    mesh = shapes.icosphere(frequency)
    assert mesh.topology.n_vertices == 10 * frequency**2 + 2
    assert mesh.topology.n_faces == 20 * frequency**2
    assert np.bincount(degrees(mesh), minlength=7).tolist() == [
        0,
        0,
        0,
        0,
        0,
        12,
        mesh.topology.n_vertices - 12,
    ]
    assert np.allclose(np.linalg.norm(mesh.vertices, axis=1), 1.0, rtol=0, atol=1e-15)


@pytest.mark.parametrize("frequency", [3, 4])
def test_icosphere_has_every_symmetry_of_the_icosahedron(frequency: int):
    mesh = shapes.icosphere(frequency)
    corners = np.asarray(mesh.vertices)[:12]
    assert maps_to_itself(mesh, around_z(2 * np.pi / 5))
    # A third of a turn around a face's middle, and half of a turn around an edge's: with the above, they generate all 60.
    third = np.linalg.solve(corners[[0, 1, 2]], corners[[1, 2, 0]])
    axis = (corners[0] + corners[1]) / np.linalg.norm(corners[0] + corners[1])
    half = 2 * np.outer(axis, axis) - np.eye(3)
    assert maps_to_itself(mesh, lambda points: points @ third)
    assert maps_to_itself(mesh, lambda points: points @ half)
    reflected = np.asarray(mesh.vertices) * [1, -1, 1]
    assert np.linalg.norm(reflected[:, None] - np.asarray(mesh.vertices), axis=2).min(axis=1).max() < 1e-12


def test_icosphere_triangles_are_well_shaped():
    angles = corner_angles(shapes.icosphere(24))
    assert angles.min() >= 54 - 1e-9
    assert angles.max() <= 72


@pytest.mark.parametrize(
    ("name", "make", "exact"),
    [
        ("sphere", lambda n: shapes.icosphere(n, radius=2.0), 16 * math.pi),
        (
            "spheroid",
            lambda n: shapes.ellipsoid(n, (1, 1, 0.5)),
            math.pi * (2 + math.log(2 + math.sqrt(3)) / math.sqrt(3)),
        ),
        ("torus", lambda n: shapes.torus(4 * n, 2 * n), 8 * math.pi**2),
        ("disk", lambda n: shapes.disk(n, 2.0), 4 * math.pi),
        ("cylinder", lambda n: shapes.cylinder(4 * n), 4 * math.pi),
        ("cone", lambda n: shapes.cone(4 * n), 1.4 * math.pi * math.hypot(0.6, 1)),
        ("band", lambda n: shapes.spherical_band(4 * n), 4 * math.pi * math.sin(0.5)),
        ("turned sphere", lambda n: shapes.surface_of_revolution(np.sin, np.cos, n), 4 * math.pi),
        ("perfect cone", lambda n: shapes.squashed_cone(1.0, 3 * n), math.pi * (1 + math.sqrt(2))),
    ],
)
def test_areas_converge_with_second_order(name: str, make: Callable[[int], TriangleMesh], exact: float):
    del name
    assert observed_order(lambda n: abs(area(make(n)) / exact - 1), 12) == pytest.approx(2, abs=0.15)


def test_scaling_by_radii():
    unit = np.asarray(shapes.icosphere(5).vertices)
    assert np.array_equal(shapes.ellipsoid(5, (1, 2, 3)).vertices, unit * np.array([1.0, 2.0, 3.0]))
    assert np.array_equal(shapes.icosphere(5, 3).vertices, unit * 3)
    points = np.asarray(shapes.random_sphere(50, seed=2).vertices)
    assert np.allclose(np.linalg.norm(points, axis=1), 1)
    assert np.array_equal(
        shapes.random_sphere(50, seed=2, radii=(1, 1, 3)).vertices, points * np.array([1.0, 1.0, 3.0])
    )


@settings(max_examples=25, deadline=None)
@given(n=st.integers(4, 300), seed=st.integers(0, 2**32 - 1))
def test_random_spheres_use_every_point(n: int, seed: int):
    mesh = shapes.random_sphere(n, seed)
    assert mesh.topology.n_faces == 2 * n - 4
    assert signed_volume(mesh) > 0
    assert (angle_defects(mesh) > 0).all()  # convex


def test_a_stretched_random_sphere_is_not_delaunay():
    mesh = shapes.random_sphere(1000, radii=(1, 1, 2.5))
    cotangents = 1 / np.tan(np.radians(corner_angles(mesh)))
    halfedges = np.asarray(mesh.topology.edge_halfedges)
    opposite = cotangents.ravel()[halfedges // 3 * 3 + (halfedges + 2) % 3].sum(axis=1)
    assert (opposite < 0).mean() > 0.1


@pytest.mark.parametrize(
    "name", ["annulus", "cylinder", "flat prism", "cone", "opening cone", "elliptic cone", "disk"]
)
def test_developable_surfaces_are_flat_inside(name: str):
    assert np.abs(angle_defects(OPEN[name][0]())).max() < 1e-12


@pytest.mark.parametrize("n_around", [3, 17, 40])
def test_elliptic_cone_is_intrinsically_a_circular_one(n_around: int):
    mesh = shapes.elliptic_cone(n_around, n_along=3, semi_axes=(1.0, 0.4), distances=(0.5, 2.0))
    vertices, faces = arrays_of(mesh)
    rings = vertices.reshape(4, n_around, 3)
    assert np.allclose(np.linalg.norm(rings, axis=2), np.geomspace(0.5, 2.0, 4)[:, None])
    assert np.allclose((rings[..., 0] / rings[..., 2]) ** 2 + (rings[..., 1] / rings[..., 2] / 0.4) ** 2, 1)
    assert np.ptp(np.linalg.norm(vertices[:, :2], axis=1)) > 0.3  # not a circular one in space
    # The turn by one generator keeps all lengths within faces.
    turned = np.arange(len(vertices)).reshape(4, n_around)
    turned = np.roll(turned, -1, axis=1).ravel()[faces]
    sides = [np.linalg.norm(vertices[f[:, [1, 2, 0]]] - vertices[f], axis=2) for f in (faces, turned)]
    assert np.allclose(sides[0], sides[1], rtol=1e-9)
    assert {tuple(np.roll(face, k)) for face in turned for k in range(3)} >= {tuple(face) for face in faces}


@pytest.mark.parametrize(
    ("mesh", "n"),
    [
        (shapes.cylinder(9, 4), 9),
        (shapes.cone(8), 8),
        (shapes.spherical_band(10), 10),
        (shapes.torus(11, 5), 11),
        (shapes.torus(10, 6), 10),
        (shapes.disk(4), 6),
        (shapes.surface_of_revolution(**SPHEROID, n_along=7, n_around=9), 9),
    ],
)
def test_a_turn_by_one_step_maps_the_mesh_to_itself(mesh: TriangleMesh, n: int):
    assert maps_to_itself(mesh, around_z(2 * np.pi / n))


def test_annulus_fills_the_ring_between_two_polygons():
    mesh = shapes.annulus(6, inner_radius=1.0, outer_radius=2.5)
    radii = np.linalg.norm(mesh.vertices, axis=1)
    inner, outer = (np.isclose(radii, radius).sum() for radius in (1.0, 2.5))
    polygons = [n * radius**2 * math.sin(2 * math.pi / n) / 2 for n, radius in ((inner, 1.0), (outer, 2.5))]
    assert area(mesh) == pytest.approx(polygons[1] - polygons[0], rel=1e-13)
    assert np.linalg.norm(mesh.vertices, axis=1).min() == pytest.approx(1.0)


def test_disk_counts():
    mesh = shapes.disk(7, radius=3.0)
    assert mesh.topology.n_vertices == 3 * 7 * 8 + 1
    assert mesh.topology.n_faces == 6 * 7**2
    radii = np.linalg.norm(mesh.vertices, axis=1)
    assert np.array_equal(np.bincount(np.rint(radii * 7 / 3).astype(int)), [1, 6, 12, 18, 24, 30, 36, 42])


@pytest.mark.parametrize(
    "mesh",
    [
        shapes.surface_of_revolution(**SPHEROID, n_along=40),
        shapes.surface_of_revolution(np.sin, lambda t: 0.4 * np.cos(t), 40),
        shapes.surface_of_revolution(lambda t: 2 + np.cos(t), np.sin, 30, interval=(0, 2 * np.pi)),
        shapes.vase(),
        shapes.annulus(9),
        shapes.disk(12),
        shapes.cylinder(20),
        shapes.cone(30),
        shapes.spherical_band(30),
    ],
)
def test_triangles_are_nearly_equilateral(mesh: TriangleMesh):
    angles = corner_angles(mesh)
    assert angles.min() > 38
    assert angles.max() < 96
    assert degrees(mesh).max() <= 8


def test_poles_have_moderate_valence():
    mesh = shapes.surface_of_revolution(**SPHEROID, n_along=60)
    assert degrees(mesh)[[0, -1]].tolist() == [6, 6]
    vertices = np.asarray(mesh.vertices)
    assert np.allclose(vertices[[0, -1]], [[0, 0, 1.6], [0, 0, -1.6]], atol=1e-12)


def test_rings_stand_at_equal_arc_length():
    mesh = shapes.surface_of_revolution(np.sin, lambda t: 3 * np.cos(t), 50, n_around=8)
    meridian = np.asarray(mesh.vertices)[[0, *range(1, 393, 8), 393]]  # the first vertex of each ring
    radii = np.linalg.norm(meridian[:, :2], axis=1)
    steps = np.hypot(np.diff(radii), np.diff(meridian[:, 2]))
    assert steps.max() / steps.min() < 1.02


def test_vertices_lie_on_the_surface():
    x, y, z = np.asarray(shapes.surface_of_revolution(**SPHEROID, n_along=17).vertices).T
    assert np.allclose(x**2 + y**2 + (z / 1.6) ** 2, 1)
    x, y, z = np.asarray(shapes.torus(12, 9, 3, 0.5).vertices).T
    assert np.allclose((np.hypot(x, y) - 3) ** 2 + z**2, 0.25)
    x, y, z = np.asarray(shapes.squashed_cone(0.3).vertices).T
    lateral = y < 1
    assert np.allclose(((x / 0.3) ** 2 + z**2)[lateral], y[lateral] ** 2)
    assert ((x / 0.3) ** 2 + z**2 <= 1 + 1e-12).all()
    assert (y <= 1).all()


def test_squashed_cones_share_their_connectivity():
    perfect, squashed = shapes.squashed_cone(1.0, 12), shapes.squashed_cone(0.2, 12)
    assert np.array_equal(perfect.faces, squashed.faces)
    assert np.allclose(np.asarray(perfect.vertices) * [0.2, 1, 1], squashed.vertices)


def test_vase_has_its_size():
    mesh = shapes.vase()
    assert 2300 < mesh.topology.n_vertices < 2700
    assert np.ptp(np.asarray(mesh.vertices)[:, 2]) == pytest.approx(2.61, abs=0.02)


@pytest.mark.parametrize("make", [shapes.limbed_blob, shapes.bumpy_sphere])
def test_blobs_are_moderately_stretched(make: Callable[[int], TriangleMesh]):
    assert corner_angles(make(24)).min() > 25


def test_limbs_stand_out():
    mesh = shapes.limbed_blob(20)
    distance = np.linalg.norm(mesh.vertices, axis=1)
    rings = mesh.topology.vertex_rings()
    neighbours = np.where(rings < 0, -np.inf, distance[rings])
    peaks = distance[(distance > neighbours.max(axis=1)) & (distance > 1.5)]
    assert len(peaks) == 4
    assert len(set(np.round(peaks, 2))) == 4
