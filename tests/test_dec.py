"""What `dec` does beyond the paper: curvature at vertices, free and tangential boundaries, ⋆₁ ≤ 0 on a boundary."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from jaxkvf import TriangleMesh, killing_eigenvalues, reference, shapes
from jaxkvf import geometry as g
from jaxkvf.eigen import ScipyEigsh
from jaxkvf.killing import Dec
from jaxkvf.sparse import matmat, to_scipy

PAPER = Dec(curvature="edge")
TANGENTIAL = Dec(boundary="tangential")


@functools.cache
def rough_disk() -> TriangleMesh:
    """A stretched disk with vertices moved at random in its plane, some of its boundary angles obtuse."""
    mesh = shapes.disk(7)
    x = np.array(mesh.vertices)
    x[:, :2] += 0.25 * np.random.default_rng(0).uniform(-1, 1, (len(x), 2)) / 7
    x[:, 0] *= 3
    return mesh.with_vertices(jnp.asarray(x))


@eqx.filter_jit
def problem_of(discretization, mesh):
    return discretization.eigenproblem(g.edge_lengths(mesh.vertices, mesh.topology), mesh.topology)


@eqx.filter_jit
def form_of(mesh, field):
    tangent = g.project(field, g.vertex_frames(mesh.vertices, mesh.topology))
    return Dec(delaunay=False).from_vertex_vectors(
        tangent, g.edge_lengths(mesh.vertices, mesh.topology), mesh.topology
    )


def planar_killing_fields(mesh: TriangleMesh) -> jax.Array:
    x, y, _ = mesh.vertices.T
    one, zero = jnp.ones_like(x), jnp.zeros_like(x)
    return jnp.stack([jnp.stack(f, axis=1) for f in ([one, zero, zero], [zero, one, zero], [-y, x, zero])])


def test_planar_motions_are_in_the_kernel_whatever_the_triangles():
    mesh = rough_disk()
    A = problem_of(Dec(delaunay=False), mesh).A
    forms = jnp.stack([form_of(mesh, field) for field in planar_killing_fields(mesh)], axis=1)
    residual = matmat(A, forms)
    scale = abs(to_scipy(A)).sum(axis=1).max()
    assert float(jnp.abs(residual).max()) < 1e-13 * scale


def test_a_flat_boundary_has_three_zero_eigenvalues_and_no_negative_one():
    for mesh in (rough_disk(), shapes.annulus(5)):
        problem = problem_of(Dec(), mesh)
        A, B = (to_scipy(operator).toarray() for operator in (problem.A, problem.B))
        values = scipy.linalg.eigh(A, B, eigvals_only=True)
        assert np.abs(values[:3]).max() < 1e-12 * values[-1] and values[3] > 0.2


def test_the_mass_stays_positive_beside_obtuse_boundary_angles():
    mesh = rough_disk()
    found = g.intrinsic_delaunay(mesh)
    assert float(found.least_cotan_weight) < -0.02
    B = problem_of(Dec(), mesh).B
    assert np.linalg.eigvalsh(to_scipy(B).toarray()).min() > 0
    # Constant fields have no curl, and feel nothing of what makes it so.
    form = eqx.filter_jit(Dec(delaunay=False).from_vertex_vectors)(
        g.project(planar_killing_fields(mesh)[0], g.vertex_frames(mesh.vertices, mesh.topology)),
        g.edge_lengths(mesh.vertices, mesh.topology),
        mesh.topology,
    )
    B = problem_of(Dec(delaunay=False), mesh).B
    area = g.surface_area(g.edge_lengths(mesh.vertices, mesh.topology), mesh.topology)
    np.testing.assert_allclose(float(form @ B.mv(form)), float(area), rtol=1e-12)


def test_the_tangential_field_of_a_disk_converges_with_second_order():
    low = [
        float(killing_eigenvalues(shapes.disk(n), 1, discretization=TANGENTIAL, solver=ScipyEigsh())[0])
        for n in (6, 12, 24)
    ]
    assert low[-1] * np.pi < 0.01
    assert 1.8 < np.log2(low[0] / low[1]) < 2.2 and 1.8 < np.log2(low[1] / low[2]) < 2.2


def test_free_boundaries_against_the_reference():
    """A spherical band, whose natural boundary circles the 1-D solver knows."""
    low, high = -0.5, 0.5
    exact = reference.surface_of_revolution_spectrum(
        np.sin, np.cos, 6, interval=(np.pi / 2 - high, np.pi / 2 - low)
    )
    errors = []
    for n in (24, 48):
        mesh = shapes.spherical_band(n)
        found = np.asarray(killing_eigenvalues(mesh, 6, discretization="dec", solver=ScipyEigsh()))
        errors.append(np.abs(found - exact).max() / exact[-1])
    assert errors[1] < 0.1 and errors[0] / errors[1] > 1.7


def test_curvature_at_vertices_converges_on_bad_triangles_where_the_papers_stalls():
    exact = reference.surface_of_revolution_spectrum(np.sin, lambda t: 2.5 * np.cos(t), 10)
    mesh = shapes.random_sphere(2562, seed=1, radii=(1.0, 1.0, 2.5))
    error = {
        name: np.linalg.norm(np.asarray(killing_eigenvalues(mesh, 10, discretization=d)) - exact)
        / np.linalg.norm(exact)
        for name, d in (("vertex", "dec"), ("edge", PAPER))
    }
    assert error["vertex"] < 1.5e-3 and error["edge"] > 1e-2


def test_a_form_of_a_name_is_refused():
    with pytest.raises(ValueError, match="curvature must be one of vertex, edge"):
        Dec(curvature="face")
    with pytest.raises(ValueError, match="boundary must be one of natural, tangential"):
        Dec(boundary="free")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["spot", "fish", "penguin", "wingnut", "boat", "plane_holes", "hammer"])
def test_dec_agrees_with_regge_on_every_real_mesh(real_mesh_folder, name):
    """Both on the intrinsic Delaunay triangulation; nothing is below zero."""
    mesh = TriangleMesh.load(real_mesh_folder / f"{name}.obj")
    dec, regge = (
        np.asarray(killing_eigenvalues(mesh, 6, discretization=d, solver=ScipyEigsh()))
        for d in ("dec", "regge-delaunay")
    )
    assert dec[0] > -1e-3 * dec[5]
    np.testing.assert_allclose(dec[:5], regge[:5], rtol=0.1)
