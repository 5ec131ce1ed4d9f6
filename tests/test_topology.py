"""Connectivity: counts, incidences, rings, and every refusal with its message."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxkvf import MeshError, Topology, TriangleMesh, shapes

TETRAHEDRON = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
CORNERS = np.array([[1.0, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]])


def strip(count: int, *, twisted: bool) -> np.ndarray:
    """Faces of a closed band of `2 count` triangles, with a half twist (Möbius) or without."""
    low, high = 2 * np.arange(count), 2 * np.arange(count) + 1
    next_low, next_high = np.roll(low, -1), np.roll(high, -1)
    if twisted:
        next_low[-1], next_high[-1] = 1, 0
    return np.concatenate([np.stack([low, next_low, high], 1), np.stack([next_low, next_high, high], 1)])


CLOSED_AND_OPEN = {
    "sphere": (lambda: shapes.icosphere(4), 2, [0], 0),
    "torus": (lambda: shapes.torus(12, 8), 0, [1], 0),
    "cylinder": (lambda: shapes.cylinder(9, 4), 0, [0], 2),
    "disk": (lambda: shapes.disk(4), 1, [0], 1),
    "random": (lambda: shapes.random_sphere(50, seed=3), 2, [0], 0),
}


@pytest.mark.parametrize("name", CLOSED_AND_OPEN)
def test_counts_and_genus(name):
    make, euler, genus, loops = CLOSED_AND_OPEN[name]
    topology = make().topology
    assert topology.euler_characteristic == euler
    assert topology.components()[0] == 1
    assert topology.genus().tolist() == genus
    assert topology.boundary_loops()[0] == loops
    assert int(topology.is_boundary_edge.sum()) == int(topology.is_boundary_vertex.sum())


def test_two_components_are_told_apart():
    sphere, torus = shapes.icosphere(2), shapes.torus(9, 6)
    n = sphere.topology.n_vertices
    both = Topology.from_faces(np.concatenate([np.asarray(sphere.faces), np.asarray(torus.faces) + n]))
    count, label = both.components()
    assert count == 2
    assert (label[:n] == 0).all() and (label[n:] == 1).all()
    assert both.genus().tolist() == [0, 1]


@pytest.mark.parametrize("name", CLOSED_AND_OPEN)
def test_incidences_agree_with_each_other(name):
    t = CLOSED_AND_OPEN[name][0]().topology
    faces, edges = np.asarray(t.faces), np.asarray(t.edges)
    tail = np.where(np.asarray(t.face_edge_signs) > 0, 0, 1)
    ends = edges[np.asarray(t.face_edges)]
    np.testing.assert_array_equal(np.take_along_axis(ends, tail[..., None], 2)[..., 0], faces)
    np.testing.assert_array_equal(
        np.take_along_axis(ends, 1 - tail[..., None], 2)[..., 0], np.roll(faces, -1, 1)
    )
    assert (edges[:, 0] < edges[:, 1]).all()
    left, right = np.asarray(t.edge_faces).T
    assert (np.asarray(t.face_edges)[left[left >= 0]] == np.flatnonzero(left >= 0)[:, None]).any(1).all()
    assert (np.asarray(t.face_edges)[right[right >= 0]] == np.flatnonzero(right >= 0)[:, None]).any(1).all()


@pytest.mark.parametrize("name", CLOSED_AND_OPEN)
def test_spokes_walk_counter_clockwise(name):
    """Between a spoke and the next lies the corner of a face with both far ends, in the face's own order."""
    t = CLOSED_AND_OPEN[name][0]().topology
    faces, starts = np.asarray(t.faces), np.asarray(t.spoke_starts)
    neighbours, corners = np.asarray(t.spoke_neighbours), np.asarray(t.spoke_corners)
    vertex = np.asarray(t.spoke_vertices)
    following = np.arange(len(vertex)) + 1
    following[starts[1:] - 1] = starts[:-1]
    inside = corners >= 0
    f, c = corners[inside] // 3, corners[inside] % 3
    np.testing.assert_array_equal(faces[f, c], vertex[inside])
    np.testing.assert_array_equal(faces[f, (c + 1) % 3], neighbours[inside])
    np.testing.assert_array_equal(faces[f, (c + 2) % 3], neighbours[following[inside]])
    assert int((~inside).sum()) == int(t.is_boundary_vertex.sum())
    np.testing.assert_array_equal(
        np.asarray(t.spoke_edges)[np.asarray(t.edge_spokes)], np.arange(t.n_edges)[:, None].repeat(2, 1)
    )


def test_padded_rings():
    rings = Topology.from_faces(TETRAHEDRON).vertex_rings()
    assert rings.shape == (4, 3)
    for v, ring in enumerate(rings):
        assert sorted(ring) == [i for i in range(4) if i != v]
    disk = shapes.disk(2).topology
    rings = disk.vertex_rings()
    np.testing.assert_array_equal((rings >= 0).sum(1), np.asarray(disk.vertex_degrees))


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31 - 1))
def test_relabelling_and_corner_rotation_change_nothing(seed):
    """Same surface under other vertex numbers, face order and first corners."""
    rng = np.random.default_rng(seed)
    mesh = shapes.cylinder(7, 3)
    faces = np.asarray(mesh.faces)
    number = rng.permutation(mesh.topology.n_vertices)
    other = number[faces][rng.permutation(len(faces))]
    shift = rng.integers(0, 3, len(other))
    other = np.take_along_axis(other, (np.arange(3) + shift[:, None]) % 3, axis=1)
    one, two = mesh.topology, Topology.from_faces(other)
    np.testing.assert_array_equal(np.asarray(two.vertex_degrees)[number], np.asarray(one.vertex_degrees))
    as_sets = {frozenset(e) for e in number[np.asarray(one.edges)].tolist()}
    assert as_sets == {frozenset(e) for e in np.asarray(two.edges).tolist()}
    rings_one, rings_two = one.vertex_rings(), two.vertex_rings()
    for v in range(one.n_vertices):
        ring = [int(number[i]) for i in rings_one[v] if i >= 0]
        theirs = [int(i) for i in rings_two[number[v]] if i >= 0]
        turn = theirs.index(ring[0])
        assert theirs[turn:] + theirs[:turn] == ring


def test_crosses_jit_as_data():
    mesh = shapes.icosphere(2)
    total = jax.jit(lambda m: m.topology.edges.sum() + m.faces.sum())(mesh)
    assert int(total) == int(np.asarray(mesh.topology.edges).sum() + np.asarray(mesh.faces).sum())


MISTAKES = {
    "a non-manifold edge": (
        np.concatenate([CORNERS, [[5.0, 5, 5]]]),
        np.concatenate([TETRAHEDRON, [[0, 1, 4]]]),
        r"non-manifold edge: 3 faces \(0, 1, 4\) share the edge between vertices 0 and 1",
    ),
    "inconsistent orientation": (
        CORNERS,
        np.array([[0, 1, 2], [0, 1, 3], [1, 3, 2], [2, 3, 0]]),
        r"inconsistently oriented faces: faces 0 and 1 traverse the edge between vertices 0 and 1 .* flip",
    ),
    "a Möbius strip": (
        np.random.default_rng(0).standard_normal((10, 3)),
        strip(5, twisted=True),
        r"non-orientable surface: .* Möbius",
    ),
    "a vertex twice in a face": (
        CORNERS,
        np.concatenate([TETRAHEDRON, [[1, 1, 2]]]),
        r"degenerate face 4: a vertex appears twice \(face 4 is \[1, 1, 2\]\)",
    ),
    "zero area": (
        np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]]),
        np.array([[0, 1, 3], [0, 2, 1]]),
        r"degenerate face 1: zero area",
    ),
    "an index too large": (
        CORNERS,
        TETRAHEDRON + 1,
        r"faces 1, 2, 3: vertex index out of range 0…3 .*count from 0",
    ),
    "a negative index": (CORNERS, np.array([[0, 1, -1]]), r"face 0: vertex index out of range"),
    "an unreferenced vertex": (
        np.concatenate([CORNERS, [[9.0, 9, 9]]]),
        TETRAHEDRON,
        r"unreferenced vertex 4: no face uses it",
    ),
    "NaN": (
        np.where(np.arange(4)[:, None] == 2, np.nan, CORNERS),
        TETRAHEDRON,
        r"vertex 2: position is not finite",
    ),
    "infinity": (
        np.where(np.arange(4)[:, None] == 1, np.inf, CORNERS),
        TETRAHEDRON,
        r"vertex 1: position is not",
    ),
    "no faces": (CORNERS, np.zeros((0, 3), int), r"no faces"),
    "no vertices": (np.zeros((0, 3)), TETRAHEDRON, r"no vertices"),
    "quads": (CORNERS, np.array([[0, 1, 2, 3]]), r"quads: triangulate them first"),
    "floating faces": (CORNERS, TETRAHEDRON.astype(float), r"integer dtype, got float64"),
    "flat faces": (CORNERS, TETRAHEDRON.ravel(), r"shape \[F, 3\], got shape \[12\]"),
    "planar vertices": (CORNERS[:, :2], TETRAHEDRON, r"shape \[V, 3\], got shape \[4, 2\]"),
    "complex vertices": (CORNERS.astype(complex), TETRAHEDRON, r"floating dtype, got complex128"),
    "text vertices": (CORNERS.astype(str), TETRAHEDRON, r"floating dtype"),
    "two sheets touching in a vertex": (
        np.random.default_rng(0).standard_normal((7, 3)),
        np.concatenate([TETRAHEDRON, np.array([0, 4, 5, 6])[TETRAHEDRON]]),
        r"non-manifold vertex 0: its faces do not form one fan",
    ),
    "two open fans in a vertex": (
        np.random.default_rng(0).standard_normal((5, 3)),
        np.array([[0, 1, 2], [0, 3, 4]]),
        r"non-manifold vertex 0",
    ),
    "coinciding vertices": (np.ones((4, 3)), TETRAHEDRON, r"all vertices coincide"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_bad_input_is_refused(mistake):
    vertices, faces, message = MISTAKES[mistake]
    with pytest.raises(MeshError, match=message):
        TriangleMesh.from_arrays(vertices, faces)


def test_an_untwisted_strip_is_fine():
    assert Topology.from_faces(strip(5, twisted=False)).boundary_loops()[0] == 2


def test_many_offenders_are_counted():
    bad = np.concatenate([TETRAHEDRON, np.tile([[1, 1, 2]], (9, 1))])
    with pytest.raises(MeshError, match=r"faces 4, 5, 6, 7, 8, … \(9 in all\)"):
        TriangleMesh.from_arrays(CORNERS, bad)


def test_thin_but_valid_triangles_pass():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-12, 0]])
    assert TriangleMesh.from_arrays(vertices, [[0, 1, 2]]).topology.n_faces == 1


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_scale_does_not_matter(scale):
    assert TriangleMesh.from_arrays(CORNERS * scale, TETRAHEDRON).topology.n_faces == 4


def test_with_vertices_checks_the_shape():
    mesh = TriangleMesh.from_arrays(CORNERS, TETRAHEDRON)
    moved = mesh.with_vertices(jnp.asarray(CORNERS) + 1)
    assert moved.topology is mesh.topology
    with pytest.raises(ValueError, match=r"\[4, 3\], got \[3, 3\]"):
        mesh.with_vertices(jnp.zeros((3, 3)))


def test_a_pole_of_high_valence():
    n = 500
    angle = 2 * np.pi * np.arange(n) / n
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    fan = np.stack([np.zeros(n, int), 1 + np.arange(n), 1 + (np.arange(n) + 1) % n], 1)
    mesh = TriangleMesh.from_arrays(np.concatenate([[[0.0, 0, 1]], rim]), fan)
    ring = mesh.topology.vertex_rings()[0]
    assert sorted(ring) == list(range(1, n + 1))
    assert set(np.diff(ring)) <= {1, 1 - n}
