"""The intrinsic Delaunay triangulation: what flips keep, what they reach, their derivatives."""

import functools

import equinox as eqx
import igl
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bad_triangles import (
    central_difference,
    differentiated,
    doubled_triangle,
    grid_torus,
    random_spheroid,
    sheared_torus,
    spindle,
    stretched_plane,
    surface,
    thin_strip,
)
from scipy.spatial import Delaunay

from jaxkvf import (
    Topology,
    TriangleMesh,
    intrinsic_killing_eigenvalues,
    shapes,
)
from jaxkvf.exterior import sharp
from jaxkvf.geometry import (
    angle_defects,
    circumcentric_vertex_areas,
    cone_angles,
    cotan_weights,
    delaunay_tolerance,
    edge_angles,
    edge_lengths,
    geodesic_curvatures,
    intrinsic_delaunay,
    surface_area,
)
from jaxkvf.killing import Dec
from jaxkvf.sparse import to_scipy

DEC = Dec()


SURFACES = {
    "spheroid": lambda: surface(random_spheroid(700)),
    "needle": lambda: surface(shapes.random_sphere(300, seed=2, radii=(1.0, 3.0, 40.0))),
    "plane": lambda: surface(stretched_plane(400)),
    "spindle": lambda: surface(spindle(6)),
    "doubled triangle": doubled_triangle,
    "strip": lambda: surface(thin_strip(40)),
}

ROUNDING = {"needle": 1e-10, "strip": 1e-10, "spindle": 1e-11}
"""Angles of needles are lost in the rounding of their sides before anything is flipped."""


def read(folder, name: str) -> TriangleMesh:
    vertices, _, _, faces, _, _ = igl.readOBJ(str(folder / f"{name}.obj"))
    return TriangleMesh.from_arrays(vertices, faces)


@eqx.filter_jit
def before_and_after(lengths: jax.Array, topology: Topology):
    """The triangulation found, how often it flips again, and what describes it and the given one alike."""

    def described(lengths, topology):
        return (
            cotan_weights(lengths, topology),
            surface_area(lengths, topology),
            cone_angles(lengths, topology),
            edge_angles(lengths, topology),
        )

    found = intrinsic_delaunay(lengths, topology)
    again = intrinsic_delaunay(found.lengths, found.topology)
    before, after = described(lengths, topology), described(found.lengths, found.topology)
    boundaries = [(t.is_boundary_edge, t.is_boundary_vertex) for t in (topology, found.topology)]
    return (
        found,
        again.flips,
        found.least_cotan_weight,
        found.topology.is_tail_spoke,
        before,
        after,
        boundaries,
    )


def check_delaunay(lengths: jax.Array, topology: Topology, rtol: float = 1e-12) -> None:
    """Everything that must hold whatever the surface."""
    results = jax.tree.map(np.asarray, before_and_after(lengths, topology))
    found, flips_again, least_weight, is_tail_spoke, before, after, boundaries = results
    assert int(found.flips) > 0
    assert int(flips_again) == 0
    (_, area, cones, directions), (weights, new_area, new_cones, new_directions) = before, after
    assert weights[~boundaries[1][0]].min() >= -delaunay_tolerance(lengths.dtype)
    assert least_weight == weights.min()
    np.testing.assert_allclose(new_area, area, rtol=rtol)
    np.testing.assert_allclose(new_cones, cones, rtol=rtol, atol=rtol)
    for given, new in zip(*boundaries, strict=True):
        np.testing.assert_array_equal(new, given)
    check_topology(found.topology, is_tail_spoke)
    # Edges that were not flipped leave their vertices in the directions that they had.
    edges, new_edges = np.asarray(topology.edges), found.topology.edges
    kept = (found.lengths == np.asarray(lengths)) & (edges == new_edges).all(axis=1)
    turn = (new_directions + found.frame_rotations[new_edges] - directions)[kept]
    assert np.abs(np.angle(np.exp(1j * turn))).max(initial=0.0) < 1e-9


def check_topology(t: Topology, is_tail_spoke: np.ndarray) -> None:
    """The incidences (in NumPy) agree with each other, edges told apart by number and not by their ends."""
    halfedge = np.arange(3 * len(t.faces))
    edge, along = t.face_edges.ravel(), t.face_edge_signs.ravel() > 0
    heads = np.roll(t.faces, -1, axis=1).ravel()
    np.testing.assert_array_equal(t.edge_halfedges[edge, np.where(along, 0, 1)], halfedge)
    np.testing.assert_array_equal(t.edges[edge, np.where(along, 0, 1)], t.faces.ravel())
    np.testing.assert_array_equal(t.edges[edge, np.where(along, 1, 0)], heads)
    np.testing.assert_array_equal(np.sort(t.edge_spokes.ravel()), np.arange(2 * len(t.edges)))
    owner = np.repeat(np.arange(t.n_vertices), np.diff(t.spoke_starts))
    np.testing.assert_array_equal(owner[t.edge_spokes], t.edges)
    np.testing.assert_array_equal(t.spoke_neighbours[t.edge_spokes], t.edges[:, ::-1])
    tail_spokes = np.zeros(2 * len(t.edges), bool)
    tail_spokes[t.edge_spokes[:, 0]] = True
    np.testing.assert_array_equal(is_tail_spoke, tail_spokes)
    corners = t.spoke_corners[t.spoke_corners >= 0]
    np.testing.assert_array_equal(np.sort(corners), halfedge)
    potential = np.random.default_rng(0).integers(1000, size=t.n_vertices)
    circulation = t.face_edge_signs * np.diff(potential[t.edges], axis=1)[:, 0][t.face_edges]
    assert not circulation.sum(axis=1).any()  # d₁ d₀ = 0


@pytest.mark.parametrize("name", SURFACES)
def test_flips_reach_delaunay_and_keep_the_surface(name):
    lengths, topology = SURFACES[name]()
    check_delaunay(lengths, topology, ROUNDING.get(name, 1e-12))


slow = functools.partial(pytest.param, marks=pytest.mark.slow)


@pytest.mark.parametrize(
    "name", ["wingnut", "boat", "plane_holes", *map(slow, ["spot", "fish", "penguin", "hammer"])]
)
def test_flips_on_real_meshes(real_mesh_folder, name):
    check_delaunay(*surface(read(real_mesh_folder, name)), rtol=1e-10)


ALREADY_DELAUNAY = {
    "icosphere": lambda: shapes.icosphere(6),
    "grid of zero weights": lambda: grid_torus(16, 10),
    "cylinder": lambda: shapes.cylinder(9, 4),
}


@pytest.mark.parametrize("name", ALREADY_DELAUNAY)
def test_a_delaunay_mesh_is_returned_as_it_is(name):
    lengths, topology = surface(ALREADY_DELAUNAY[name]())
    found = intrinsic_delaunay(lengths, topology)
    assert eqx.tree_equal((found.lengths, found.topology), (lengths, topology))
    assert int(found.flips) == 0
    assert not np.asarray(found.frame_rotations).any()


def test_in_the_plane_it_is_the_delaunay_triangulation():
    mesh = stretched_plane(400)
    found = intrinsic_delaunay(*surface(mesh))
    points, edges = np.asarray(mesh.vertices)[:, :2], np.asarray(found.topology.edges)
    assert int(found.flips) > 400
    np.testing.assert_allclose(
        found.lengths, np.linalg.norm(np.diff(points[edges], axis=1)[:, 0], axis=1), rtol=1e-11
    )
    triangles = np.sort(Delaunay(points).simplices, axis=1)
    np.testing.assert_array_equal(
        np.unique(np.sort(np.asarray(found.topology.faces), axis=1), axis=0), np.unique(triangles, axis=0)
    )


def test_a_mesh_stands_for_its_lengths_and_topology():
    mesh = stretched_plane(400)
    assert eqx.tree_equal(intrinsic_delaunay(mesh), intrinsic_delaunay(*surface(mesh)))
    with pytest.raises(ValueError, match="a mesh alone"):
        intrinsic_delaunay(mesh, mesh.topology)
    with pytest.raises(ValueError, match="a mesh alone"):
        intrinsic_delaunay(surface(mesh)[0])


def test_a_sheared_torus_becomes_the_square_grid():
    found = intrinsic_delaunay(*sheared_torus(12, 3))
    lengths = np.sort(np.asarray(found.lengths))
    np.testing.assert_allclose(lengths, np.repeat([1, 1, np.sqrt(2)], 144), rtol=1e-12)


def test_the_long_side_of_a_doubled_triangle_becomes_a_loop_of_twice_the_height():
    lengths, topology = doubled_triangle()

    def loop(lengths):
        found = intrinsic_delaunay(lengths, topology)
        return found.lengths[0], found

    value, found = loop(lengths)
    assert int(found.flips) == 1
    assert found.topology.edges[0].tolist() == [2, 2]
    assert found.topology.vertex_degrees.tolist() == [1, 1, 4]
    np.testing.assert_allclose(value, 2 * 0.5, rtol=1e-13)
    # Moving one end of the base (both copies) outward tilts the height: h = 2 area / base.
    base, left, right = 2.0, np.hypot(0.9, 0.5), np.hypot(1.1, 0.5)
    by_base, by_left, by_right = jax.grad(lambda lengths: loop(lengths)[0])(lengths)
    foot = 0.9
    np.testing.assert_allclose(by_left, 2 * (left / 0.5) * (1 - foot / base), rtol=1e-12)
    np.testing.assert_allclose(by_right, 2 * (right / 0.5) * (foot / base), rtol=1e-12)
    np.testing.assert_allclose(by_base, -2 * foot * (base - foot) / (0.5 * base), rtol=1e-12)


def test_forms_live_on_edges_that_share_their_ends():
    lengths, topology = surface(spindle(6))
    found = intrinsic_delaunay(lengths, topology)
    edges = np.sort(np.asarray(found.topology.edges), axis=1)
    assert (edges[:, 0] == edges[:, 1]).any()
    assert len(np.unique(edges, axis=0)) < len(edges)
    assert int(found.topology.vertex_degrees.min()) == 1
    total = (
        angle_defects(found.lengths, found.topology) + geodesic_curvatures(found.lengths, found.topology)
    ).sum()
    np.testing.assert_allclose(total, 4 * np.pi, rtol=1e-12)
    assert (np.asarray(circumcentric_vertex_areas(found.lengths, found.topology)) > 0).all()
    values = intrinsic_killing_eigenvalues(lengths, topology, 2, discretization="dec")
    assert np.isfinite(values).all()
    vectors = DEC.to_vertex_vectors(jnp.ones(topology.n_edges), lengths, topology)
    assert np.isfinite(vectors).all()


def test_sharp_sees_a_loop_from_both_of_its_ends():
    lengths, topology = doubled_triangle()
    found = intrinsic_delaunay(lengths, topology)
    form = jnp.asarray([0.3, -1.0, 2.0])
    angles = np.asarray(edge_angles(found.lengths, found.topology))
    at_2 = np.asarray(found.topology.edges) == 2
    assert at_2.sum() == 4 and at_2[0].all()
    along = np.asarray(form / found.lengths)[:, None] * np.array(
        [1.0, -1.0]
    )  # outward from tail and from head
    directions = np.stack([np.cos(angles[at_2]), np.sin(angles[at_2])], axis=1)
    expected = np.linalg.lstsq(directions, along[at_2])[0]
    vectors = sharp(form, found.lengths, found.topology)
    np.testing.assert_allclose(vectors[2], expected, rtol=1e-12)
    assert np.isfinite(vectors).all()  # the other two have one spoke each


# Derivatives


def smooth_function(vertices, topology, weights):
    found = intrinsic_delaunay(edge_lengths(vertices, topology), topology)
    return weights @ jnp.log(found.lengths)


def test_derivatives_flow_through_flips():
    mesh, weights, direction = differentiated()
    step = 1e-6

    @jax.jit
    def flipped(vertices):
        return intrinsic_delaunay(edge_lengths(vertices, mesh.topology), mesh.topology)

    here, ahead, behind = (flipped(mesh.vertices + s * direction) for s in (0, step, -step))
    assert int(here.flips) >= 100
    assert eqx.tree_equal(here.topology, ahead.topology, behind.topology)
    function = jax.jit(lambda vertices: smooth_function(vertices, mesh.topology, weights))
    expected = central_difference(function, mesh.vertices, direction, step)
    gradient = jax.jit(jax.grad(function))(mesh.vertices)
    assert np.isfinite(gradient).all()
    np.testing.assert_allclose(jnp.vdot(gradient, direction), expected, rtol=1e-6)
    _, forward = jax.jvp(function, (mesh.vertices,), (direction,))
    np.testing.assert_allclose(forward, jnp.vdot(gradient, direction), rtol=1e-12)


def test_second_derivatives_flow_through_flips():
    mesh, weights, direction = differentiated()
    gradient = jax.jit(jax.grad(lambda vertices: smooth_function(vertices, mesh.topology, weights)))
    _, curvature = jax.jvp(gradient, (mesh.vertices,), (direction,))
    expected = central_difference(gradient, mesh.vertices, direction, 1e-7)
    error = np.linalg.norm(curvature - expected) / np.linalg.norm(expected)
    assert error < 1e-5


def test_a_batch_is_its_members():
    mesh, weights, direction = differentiated()
    topology = mesh.topology
    batch = mesh.vertices[None] * jnp.asarray([[[1.0, 1, 1]], [[2.0, 0.5, 1]], [[1.0, 1, 0.4]]])
    function = functools.partial(smooth_function, topology=topology, weights=weights)

    @jax.jit
    def everything(x):
        value, gradient = jax.value_and_grad(function)(x)
        _, slope = jax.jvp(function, (x,), (direction,))
        return value, slope, gradient, intrinsic_delaunay(edge_lengths(x, topology), topology).flips

    together = jax.jit(jax.vmap(everything))(batch)
    flips = together[-1].tolist()
    assert len(set(flips)) == 3 and min(flips) < 40
    for number, x in enumerate(batch):
        for member, alone in zip(together, everything(x), strict=True):
            np.testing.assert_allclose(member[number], alone, rtol=1e-9, atol=1e-11)


def test_single_precision():
    mesh = random_spheroid(700)
    lengths = edge_lengths(mesh.vertices, mesh.topology)
    single = lengths.astype(jnp.float32)
    found = intrinsic_delaunay(single, mesh.topology)
    assert found.lengths.dtype == found.frame_rotations.dtype == jnp.float32
    np.testing.assert_allclose(
        surface_area(found.lengths, found.topology), surface_area(lengths, mesh.topology), rtol=1e-5
    )
    slope = jax.grad(lambda lengths: jnp.log(intrinsic_delaunay(lengths, mesh.topology).lengths).sum())(
        single
    )
    assert slope.dtype == jnp.float32 and np.isfinite(slope).all()
    problem = eqx.filter_jit(DEC.eigenproblem)(single, mesh.topology)
    assert problem.dtype == jnp.float32
    assert to_scipy(problem.B).diagonal().min() > 0


# Refusals


def test_more_flips_than_there_is_room_for_is_an_error():
    lengths, topology = surface(thin_strip(300))
    with pytest.raises(eqx.EquinoxRuntimeError, match="Raise `capacity`, or remesh"):
        intrinsic_delaunay(lengths, topology)
    found = intrinsic_delaunay(lengths, topology, capacity=2)
    assert int(found.flips) > 10 * topology.n_edges
    np.testing.assert_allclose(
        surface_area(found.lengths, found.topology), surface_area(lengths, topology), rtol=1e-9
    )
    assert Dec(flip_capacity=2).triangulation(lengths, topology).flips == found.flips


@pytest.mark.parametrize("capacity", [0, -1, 1.5, True])
def test_capacity_is_a_positive_integer(capacity):
    lengths, topology = doubled_triangle()
    with pytest.raises((ValueError, TypeError), match="capacity"):
        intrinsic_delaunay(lengths, topology, capacity=capacity)


def test_one_length_an_edge():
    lengths, topology = doubled_triangle()
    with pytest.raises(ValueError, match=r"lengths must have shape \[3\], one an edge, got \[2\]"):
        intrinsic_delaunay(lengths[:2], topology)


def test_impossible_lengths_stay_visible():
    lengths, topology = surface(shapes.icosphere(2))
    found = intrinsic_delaunay(lengths.at[0].mul(10.0), topology)
    assert np.isnan(surface_area(found.lengths, found.topology))
