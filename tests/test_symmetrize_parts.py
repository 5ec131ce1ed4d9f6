"""The parts of a symmetrization by themselves: unknowns, what a minimiser may do, and the account given of the result."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

import jaxkvf
from jaxkvf import geometry as g
from jaxkvf import shapes
from jaxkvf.symmetrization import OUTCOMES, Configuration, Displacements, EdgeLengths, symmetry_report


def test_smooth_displacements_solve_their_equation():
    """(M + s²L) x = M θ by SciPy, on triangles of different sizes."""
    mesh = shapes.add_normal_noise(shapes.ellipsoid(4), 0.2, seed=1)
    original = Configuration.of(mesh)
    theta = jnp.asarray(np.random.default_rng(0).standard_normal(mesh.vertices.shape))
    moved = Displacements(smoothing=3.0).surface(theta, original)
    tail, head = np.asarray(mesh.topology.edges).T
    weights = np.asarray(g.cotan_weights(original.lengths, mesh.topology))
    n = mesh.topology.n_vertices
    adjacency = sp.coo_array((weights, (tail, head)), shape=(n, n)).tocsr()
    adjacency = adjacency + adjacency.T
    laplacian = sp.diags_array(adjacency.sum(axis=1)) - adjacency
    mass = sp.diags_array(np.asarray(g.barycentric_vertex_areas(original.lengths, mesh.topology)))
    unit = float(np.asarray(original.lengths).mean())
    smooth = spsolve((mass + (3.0 * unit) ** 2 * laplacian).tocsc(), mass @ np.asarray(theta))
    found = (moved.vertices - mesh.vertices) / unit
    np.testing.assert_allclose(found, smooth, atol=1e-9 * np.abs(smooth).max())
    assert np.abs(smooth).max() < 0.2 * float(jnp.abs(theta).max())


def test_where_a_minimiser_may_go():
    mesh = shapes.icosphere(2)
    original, unknowns = Configuration.of(mesh), Displacements()
    theta = unknowns.start(mesh)
    assert bool(unknowns.is_valid(unknowns.surface(theta, original), original))
    through = theta.at[0].set(
        -3 * mesh.vertices[0] / original.unit
    )  # pushed through the other side: faces turn over
    assert not bool(unknowns.is_valid(unknowns.surface(through, original), original))
    lengths = EdgeLengths()
    impossible = lengths.start(mesh).at[0].set(jnp.log(3.0))  # longer than the two others together
    assert bool(lengths.is_valid(lengths.surface(lengths.start(mesh), original), original))
    assert not bool(lengths.is_valid(lengths.surface(impossible, original), original))


def test_the_account_of_a_known_change(tmp_path):
    """A flat square of two triangles whose corner is pulled: displacement, stretch and turned faces by hand."""
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    mesh = jaxkvf.TriangleMesh.from_arrays(square, [[0, 1, 2], [0, 2, 3]])
    done = jaxkvf.symmetrize(mesh, max_steps=1)
    assert done.result == OUTCOMES.successful  # a flat piece has three symmetries
    moved = mesh.with_vertices(mesh.vertices.at[1].set(jnp.asarray([2.0, -1, 0])))
    unit = (4 + 2**0.5) / 5
    account = symmetry_report(mesh, eqx.tree_at(lambda d: d.mesh, done, moved))
    np.testing.assert_allclose(account.displacements, np.array([0, 2**0.5, 0, 0]) / unit, rtol=1e-12)
    np.testing.assert_allclose(account.rms_displacement, 2**0.5 / unit / 2, rtol=1e-12)
    # Along the diagonal nothing changes, across it the height grows threefold.
    np.testing.assert_allclose(account.stretches, [3, 1], rtol=1e-12)
    assert account.flipped_faces == 0 and account.most_changed_faces.tolist() == [0, 1]
    over = mesh.with_vertices(mesh.vertices.at[1].set(jnp.asarray([0.25, 0.75, 0])))
    account = symmetry_report(mesh, eqx.tree_at(lambda d: d.mesh, done, over))
    assert account.flipped_faces == 1
    np.testing.assert_allclose(account.stretches, [2, 1], rtol=1e-12)
    with pytest.raises(ValueError, match="of another mesh"):
        symmetry_report(shapes.icosphere(1), done)


def test_it_does_not_go_further_than_asked():
    """Noise of 20 % cannot be removed within a hundredth of an edge."""
    noisy = shapes.add_normal_noise(shapes.ellipsoid(2), 0.2, seed=0)
    done = jaxkvf.symmetrize(noisy, reach=0.01)
    assert done.result == OUTCOMES.out_of_reach and "reach" in OUTCOMES[done.result]
    assert done.history[-2].rms_displacement <= 0.01 < done.history[-1].rms_displacement
