"""The ever coarser sets of vertices behind the vector multigrid: what each is promised to be."""

import numpy as np
import pytest
import scipy.sparse as sp

import jaxkvf
from jaxkvf import geometry as g
from jaxkvf import shapes
from jaxkvf.killing import vector_hierarchy

MESHES = {
    "closed": lambda: shapes.bumpy_sphere(8),
    "boundary": lambda: shapes.annulus(9),
    "thin triangles": lambda: shapes.random_sphere(700, seed=0, radii=(1.0, 1.0, 2.5)),
}


def finest(mesh):
    """The interpolation of the mesh, and which vertices are coarse."""
    interpolation = vector_hierarchy(g.edge_lengths(mesh.vertices, mesh.topology), mesh.topology)[
        0
    ].interpolation
    vertices = np.arange(mesh.topology.n_vertices)
    return interpolation, np.flatnonzero(np.asarray(interpolation.parents) == vertices)


def steps_between(mesh):
    edges, n = np.asarray(mesh.topology.edges), mesh.topology.n_vertices
    graph = sp.coo_array((np.ones(len(edges)), tuple(edges.T)), shape=(n, n))
    return sp.csgraph.shortest_path(graph, directed=False, unweighted=True)


@pytest.mark.parametrize("name", MESHES)
def test_coarse_vertices_are_a_maximal_set_two_steps_apart(name):
    mesh = MESHES[name]()
    interpolation, coarse = finest(mesh)
    steps = steps_between(mesh)
    between = steps[np.ix_(coarse, coarse)]
    if name != "thin triangles":  # there the steps do not go along long edges
        assert between[~np.eye(len(coarse), dtype=bool)].min() > 2
    assert steps[:, coarse].min(axis=1).max() <= 2
    assert len(coarse) == interpolation.n_coarse < mesh.topology.n_vertices / 4


@pytest.mark.parametrize("name", MESHES)
def test_weights_sum_to_one_and_keep_coarse_vertices(name):
    interpolation, coarse = finest(MESHES[name]())
    weights, columns = np.asarray(interpolation.weights), np.asarray(interpolation.columns)
    np.testing.assert_allclose(weights.sum(axis=0), 1, atol=1e-12)
    np.testing.assert_array_equal(weights[:, coarse], np.eye(len(weights))[:, :1] * np.ones(len(coarse)))
    np.testing.assert_array_equal(columns[0, coarse], np.arange(len(coarse)))


def test_interpolation_is_exact_for_linear_functions_in_the_plane():
    mesh = shapes.annulus(24)
    interpolation, coarse = finest(mesh)
    x = np.asarray(mesh.vertices)[:, :2]
    weights, columns = np.asarray(interpolation.weights), np.asarray(interpolation.columns)
    interpolated = np.einsum("sn,snx->nx", weights, x[coarse][columns])
    spacing = float(g.mean_edge_length(g.edge_lengths(mesh.vertices, mesh.topology)))
    error = np.linalg.norm(interpolated - x, axis=1) / spacing
    inner = np.abs(weights).sum(axis=0) < 1.5  # nothing is extrapolated there
    assert inner.mean() > 0.8
    assert error[inner].max() < 0.05  # the ridge of the fit; coarse vertices are three edges and more apart
    assert error[inner].mean() < 0.01


def test_owners_are_the_nearest_along_the_graph():
    mesh = shapes.annulus(9)
    interpolation, coarse = finest(mesh)
    parents = np.asarray(interpolation.parents)
    owner, steps = parents[parents], steps_between(mesh)
    assert np.isin(owner, coarse).all()
    vertices = np.arange(len(parents))
    np.testing.assert_array_equal(steps[vertices, owner], steps[:, coarse].min(axis=1))


@pytest.mark.parametrize("corners", [3, 4])
def test_pieces_of_a_node_do_not_make_the_coarsest_level_large(corners):
    """1,000 loose triangles or tetrahedra: each is a node on the coarsest level, that stands alone there."""
    mesh, count = shapes.bumpy_sphere(10), 1000
    speck = np.eye(4, 3, -1)[:corners]
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])[: 4 if corners == 4 else 1]
    places = np.random.default_rng(0).uniform(-5, 5, (count, 1, 3))
    vertices = np.concatenate([np.asarray(mesh.vertices), (places + 0.01 * speck).reshape(-1, 3)])
    pieces = mesh.topology.n_vertices + corners * np.arange(count)[:, None, None] + faces
    specked = jaxkvf.TriangleMesh.from_arrays(
        vertices, np.concatenate([np.asarray(mesh.faces), pieces.reshape(-1, 3)])
    )
    lengths = g.edge_lengths(specked.vertices, specked.topology)
    hierarchy = vector_hierarchy(lengths, specked.topology)
    assert len(hierarchy) == 1
    assert len(hierarchy[-1].alone) == count
    assert 1 < len(hierarchy[-1].joined) <= 200
    assert len(hierarchy[-1].joined) + count == hierarchy[-1].interpolation.n_coarse
