"""The two Killing operators: symmetry, energy, scaling, invariance, boundaries, exact fields."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxkvf
from jaxkvf import Topology, TriangleMesh, shapes
from jaxkvf import geometry as g
from jaxkvf.killing import Dec, Regge
from jaxkvf.sparse import matmat, to_scipy

MESHES = {
    "sphere": lambda: shapes.icosphere(5),
    "torus": lambda: shapes.torus(18, 12),
    "disk": lambda: shapes.disk(4),
    "random": lambda: shapes.random_sphere(90, seed=1, radii=(1.0, 1.0, 2.0)),
}


def problem_on(mesh, discretization):
    lengths = g.edge_lengths(mesh.vertices, mesh.topology)
    return discretization.eigenproblem(lengths, mesh.topology)


def rotation_about_z(mesh):
    x = mesh.vertices
    return jnp.stack([-x[:, 1], x[:, 0], jnp.zeros_like(x[:, 0])], axis=1)


@pytest.mark.parametrize("discretization", [Regge(), Dec()], ids=["regge", "dec"])
@pytest.mark.parametrize("name", ["sphere", pytest.param("torus", marks=pytest.mark.slow)])
def test_matrices_are_symmetric_and_agree_with_products(name, discretization):
    problem = problem_on(MESHES[name](), discretization)
    rng = np.random.default_rng(0)
    block = rng.standard_normal((problem.size, 3))
    for operator in (problem.A, problem.B):
        matrix = to_scipy(operator)
        scale = abs(matrix).sum(axis=1).max()
        assert abs(matrix - matrix.T).max() <= 1e-13 * scale
        np.testing.assert_allclose(matmat(operator, jnp.asarray(block)), matrix @ block, atol=1e-12 * scale)
        np.testing.assert_allclose(
            operator.mv(jnp.asarray(block[:, 0])), matrix @ block[:, 0], atol=1e-12 * scale
        )
    assert np.linalg.eigvalsh(to_scipy(problem.B).toarray())[0] > 0


@pytest.mark.parametrize("name", MESHES)
def test_regge_is_positive_semi_definite(name):
    values = np.linalg.eigvalsh(to_scipy(problem_on(MESHES[name](), Regge()).A).toarray())
    assert values[0] >= -1e-12 * values[-1]


def squared_length_rates(vectors, lengths, topology):
    """h = 2ℓℓ̇ of each edge along the flow of a vertex field."""
    coefficients = np.asarray(Regge().eigenproblem(lengths, topology).A.rate_coefficients)
    rates = (coefficients * np.asarray(vectors)[np.asarray(topology.edges)]).sum(axis=(1, 2))
    return 2 * np.asarray(lengths) * rates


@pytest.mark.slow
def test_regge_energy_is_its_definition():
    """Against area · ‖Σ h_e S_e‖² with the tensors written out in each face's plane."""
    mesh = shapes.random_sphere(30, seed=3)
    t = mesh.topology
    lengths = g.edge_lengths(mesh.vertices, t)
    u = np.random.default_rng(1).standard_normal((t.n_vertices, 2))
    h = squared_length_rates(u, lengths, t)
    frames = np.asarray(g.face_frames(mesh.vertices, t))
    corners = np.einsum("fcd,fad->fca", np.asarray(mesh.vertices)[np.asarray(t.faces)], frames)
    total = 0.0
    for f, p in enumerate(corners):
        gradient = np.linalg.inv(np.concatenate([p, np.ones((3, 1))], axis=1))[:2]  # columns ∇λ
        tensor = np.zeros((2, 2))
        for side in range(3):
            a, b = gradient[:, side], gradient[:, (side + 1) % 3]
            tensor -= h[t.face_edges[f, side]] * 0.5 * (np.outer(a, b) + np.outer(b, a))
        # The tensor reproduces the rates along its own sides: that is what the Regge element is.
        for side in range(3):
            edge = p[(side + 1) % 3] - p[side]
            np.testing.assert_allclose(edge @ tensor @ edge, h[t.face_edges[f, side]], atol=1e-10)
        total += float(g.face_areas(lengths, t)[f]) * (tensor**2).sum()
    problem = Regge().eigenproblem(lengths, t)
    x = jnp.asarray(u.ravel())
    np.testing.assert_allclose(float(x @ problem.A.mv(x)), total, rtol=1e-11)
    np.testing.assert_allclose(float(Regge().energy(x, lengths, t)), total, rtol=1e-11)


def test_length_rates_are_the_rates_of_lengths():
    """In the plane the flow moves vertices, and h is the derivative of the squared lengths."""
    mesh = shapes.disk(3)
    t = mesh.topology
    field = np.random.default_rng(2).standard_normal((t.n_vertices, 3)) * [1, 1, 0]
    frames = g.vertex_frames(mesh.vertices, t)
    lengths = g.edge_lengths(mesh.vertices, t)
    h = squared_length_rates(g.project(jnp.asarray(field), frames), lengths, t)
    x = np.asarray(mesh.vertices)
    tail, head = np.asarray(t.edges).T
    np.testing.assert_allclose(h, 2 * ((x[head] - x[tail]) * (field[head] - field[tail])).sum(1), atol=1e-12)


def test_energy_of_a_plane_strain_is_exact():
    """U = (αx, βy) in the plane: KU = 2 diag(α, β), so E = 4 (α² + β²) · area, and the density is constant."""
    mesh = shapes.disk(5)
    x = mesh.vertices
    field = jnp.stack([0.3 * x[:, 0], -0.7 * x[:, 1], jnp.zeros_like(x[:, 0])], axis=1)
    area = float(g.surface_area(g.edge_lengths(x, mesh.topology), mesh.topology))
    expected = 4 * (0.3**2 + 0.7**2)
    np.testing.assert_allclose(float(jaxkvf.killing_energy(mesh, field)), expected * area, rtol=1e-11)
    np.testing.assert_allclose(jaxkvf.killing_energy_density(mesh, field), expected, rtol=1e-10)


@pytest.mark.parametrize("discretization", ["regge", "dec"])
def test_energy_of_a_stretch_of_the_sphere_converges(discretization):
    """The gradient field of z on the unit sphere has λ = 4, ∫|∇z|² = 8π/3, so E = 32π/3; error of order h²."""
    errors = []
    for frequency in (8, 16):
        mesh = shapes.icosphere(frequency)
        x = np.asarray(mesh.vertices)
        field = np.array([0, 0, 1.0]) - x[:, 2:] * x
        energy = float(jaxkvf.killing_energy(mesh, jnp.asarray(field), discretization=discretization))
        errors.append(abs(energy / (32 * np.pi / 3) - 1))
    assert errors[1] < 0.01 and errors[0] / errors[1] > 3.5


def test_rotation_of_a_surface_of_revolution_has_little_energy():
    """Fourth order for `regge`: the energy of the exact Killing field of a spheroid, over its norm."""
    energies = []
    for frequency in (8, 16):
        mesh = shapes.ellipsoid(frequency)
        energies.append(float(jaxkvf.killing_energy(mesh, rotation_about_z(mesh))))
    assert energies[1] < 1e-3 and energies[0] / energies[1] > 8


def test_energy_ignores_the_normal_part():
    mesh = shapes.icosphere(6)
    normals = g.vertex_normals(mesh.vertices, mesh.topology)
    field = rotation_about_z(mesh)
    np.testing.assert_allclose(
        jaxkvf.killing_energy(mesh, field + 3 * normals),
        jaxkvf.killing_energy(mesh, field),
        rtol=1e-9,
        atol=1e-12,
    )


@pytest.mark.parametrize("discretization", ["regge", "dec"])
def test_eigenvalues_scale_and_are_intrinsic(discretization):
    mesh = shapes.icosphere(4)
    values = jaxkvf.killing_eigenvalues(mesh, 8, discretization=discretization)
    rotation, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    moved = mesh.with_vertices(5.0 * mesh.vertices @ jnp.asarray(rotation).T + jnp.asarray([[7.0, 8, 9]]))
    theirs = jaxkvf.killing_eigenvalues(moved, 8, discretization=discretization)
    np.testing.assert_allclose(25 * theirs, values, atol=1e-9)


def test_relabelling_changes_nothing():
    mesh = shapes.random_sphere(120, seed=8)
    rng = np.random.default_rng(0)
    number = rng.permutation(mesh.topology.n_vertices)
    vertices = np.empty_like(np.asarray(mesh.vertices))
    vertices[number] = np.asarray(mesh.vertices)
    faces = number[np.asarray(mesh.faces)]
    faces = np.take_along_axis(faces, (np.arange(3) + rng.integers(0, 3, len(faces))[:, None]) % 3, axis=1)
    other = TriangleMesh.from_arrays(vertices, faces[rng.permutation(len(faces))])
    np.testing.assert_allclose(
        jaxkvf.killing_eigenvalues(mesh, 6), jaxkvf.killing_eigenvalues(other, 6), atol=1e-9
    )


EXACT = {
    "annulus": (lambda: shapes.annulus(6), 3, 1e-10),
    "disk": (lambda: shapes.disk(8), 3, 1e-10),
    "cylinder": (lambda: shapes.cylinder(24), 2, 1e-10),
    "cone over an ellipse": (lambda: shapes.elliptic_cone(60), 1, 1e-6),
    "cone": (lambda: shapes.cone(30), 1, 1e-10),
}


@pytest.mark.parametrize("name", EXACT)
def test_natural_boundary_conditions_keep_exact_fields(name):
    make, count, bound = EXACT[name]
    values = np.asarray(jaxkvf.killing_eigenvalues(make(), count + 1))
    assert (np.abs(values[:count]) < bound).all()
    assert values[count] > 0.05


def test_a_spherical_band_keeps_three_fields_in_the_limit():
    values = [np.asarray(jaxkvf.killing_eigenvalues(shapes.spherical_band(n), 4)) for n in (24, 48)]
    assert (np.abs(values[1][:3]) < 0.3 * np.abs(values[0][:3]) + 1e-9).all()
    assert (values[1][:3] < 2e-3).all() and values[1][3] > 0.1


def test_intrinsic_eigenvalues_need_only_lengths():
    """A cylinder cut open and bent another way has the same lengths, so the same eigenvalues."""
    mesh = shapes.cylinder(20)
    lengths = g.edge_lengths(mesh.vertices, mesh.topology)
    ours = jaxkvf.intrinsic_killing_eigenvalues(lengths, mesh.topology, 4)
    np.testing.assert_allclose(ours, jaxkvf.killing_eigenvalues(mesh, 4), atol=1e-12)
    with pytest.raises(ValueError, match="one an edge"):
        jaxkvf.intrinsic_killing_eigenvalues(lengths[:-1], mesh.topology, 4)


def test_wrong_names_and_shapes_are_refused():
    mesh = shapes.icosphere(2)
    with pytest.raises(ValueError, match="must be one of regge, dec, regge-delaunay, got 'rege'"):
        jaxkvf.killing_fields(mesh, 2, discretization="rege")
    with pytest.raises(ValueError, match=r"shape \[42, 3\], one a vertex, got \[41, 3\]"):
        jaxkvf.killing_energy(mesh, jnp.zeros((41, 3)))
    for k in (0, -1, 85, True):
        with pytest.raises(ValueError, match="k must be an integer between 1 and the number of unknowns 84"):
            jaxkvf.killing_fields.__wrapped__(mesh, k) if hasattr(
                jaxkvf.killing_fields, "__wrapped__"
            ) else None


def test_float32_gives_float32():
    mesh = shapes.icosphere(6)
    half = mesh.with_vertices(mesh.vertices.astype(jnp.float32))
    fields = jaxkvf.killing_fields(half, 4)
    assert fields.eigenvalues.dtype == jnp.float32 and fields.vectors.dtype == jnp.float32
    np.testing.assert_allclose(fields.eigenvalues, jaxkvf.killing_eigenvalues(mesh, 4), atol=2e-4)


def test_degenerate_positions_inside_a_pipeline_say_so():
    mesh = shapes.icosphere(3)
    with pytest.raises(Exception, match="NaN or infinity"):
        jaxkvf.killing_eigenvalues(mesh.with_vertices(mesh.vertices * jnp.nan), 1)
    silent = jaxkvf.killing_fields(mesh.with_vertices(mesh.vertices * jnp.nan), 1, throw=False)
    assert silent.result == jaxkvf.eigen.RESULTS.nonfinite_input


def test_topology_alone_is_enough_for_two_metrics():
    topology = Topology.from_faces(shapes.icosphere(3).faces)
    one = jaxkvf.intrinsic_killing_eigenvalues(jnp.ones(topology.n_edges), topology, 3)
    two = jaxkvf.intrinsic_killing_eigenvalues(2 * jnp.ones(topology.n_edges), topology, 3)
    np.testing.assert_allclose(one, 4 * two, rtol=1e-9, atol=1e-12)
