"""d, ⋆, δ, Hodge Laplacian, flat and sharp: identities, matrices against products, convergence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxkvf import exterior as ex
from jaxkvf import geometry as g
from jaxkvf import shapes
from jaxkvf.sparse import matmat, to_scipy

MESHES = {
    "sphere": lambda: shapes.icosphere(5),
    "random": lambda: shapes.random_sphere(80, seed=1),
    "torus": lambda: shapes.torus(14, 9),
    "disk": lambda: shapes.disk(4),
}
OPERATORS = (
    ex.hodge0,
    ex.hodge1,
    ex.hodge2,
    ex.codifferential1,
    ex.codifferential2,
    ex.hodge_laplacian0,
    ex.hodge_laplacian1,
    ex.curl_curl,
    ex.grad_div,
)


def measured(mesh):
    return g.edge_lengths(mesh.vertices, mesh.topology), mesh.topology


@pytest.mark.parametrize("name", MESHES)
def test_curl_of_a_gradient_is_zero(name):
    topology = MESHES[name]().topology
    assert abs(to_scipy(ex.d1(topology) @ ex.d0(topology))).max() == 0


@pytest.mark.parametrize("operator", OPERATORS, ids=lambda o: o.__name__)
@pytest.mark.parametrize("name", MESHES)
def test_products_are_those_of_the_matrix(name, operator):
    made = operator(*measured(MESHES[name]()))
    matrix = to_scipy(made)
    x = np.random.default_rng(0).standard_normal(made.in_size())
    scale = abs(matrix).sum(axis=1).max()
    np.testing.assert_allclose(
        jax.jit(lambda m, x: m.mv(x))(made, jnp.asarray(x)), matrix @ x, atol=1e-13 * scale
    )
    np.testing.assert_allclose(made.T.mv(jnp.ones(made.out_size())), matrix.sum(axis=0), atol=1e-12 * scale)
    block = jnp.asarray(np.stack([x, 2 * x], 1))
    np.testing.assert_allclose(matmat(made, block), matrix @ np.asarray(block), atol=1e-13 * scale)


def test_laplacian_of_functions_is_the_cotangent_matrix():
    """Against the textbook assembly over corners."""
    mesh = shapes.random_sphere(60, seed=4)
    x, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    expected = np.zeros((len(x), len(x)))
    for face in faces:
        for c in range(3):
            k, i, j = face[c], face[(c + 1) % 3], face[(c + 2) % 3]
            u, v = x[i] - x[k], x[j] - x[k]
            weight = 0.5 * (u @ v) / np.linalg.norm(np.cross(u, v))
            expected[[i, j], [i, j]] += weight
            expected[[i, j], [j, i]] -= weight
    np.testing.assert_allclose(to_scipy(ex.hodge_laplacian0(*measured(mesh))).toarray(), expected, atol=1e-12)


def test_adjointness():
    """⟨δω, f⟩ in ⋆₀ is ⟨ω, df⟩ in ⋆₁, and ⟨δη, ω⟩ in ⋆₁ is ⟨η, dω⟩ in ⋆₂."""
    lengths, topology = measured(shapes.icosphere(4))
    rng = np.random.default_rng(0)
    f, w, h = (
        jnp.asarray(rng.standard_normal(n)) for n in (topology.n_vertices, topology.n_edges, topology.n_faces)
    )
    star0, star1, star2 = (hodge(lengths, topology) for hodge in (ex.hodge0, ex.hodge1, ex.hodge2))
    left = star0.mv(ex.codifferential1(lengths, topology).mv(w)) @ f
    np.testing.assert_allclose(left, star1.mv(w) @ ex.d0(topology).mv(f), rtol=1e-10)
    left = star1.mv(ex.codifferential2(lengths, topology).mv(h)) @ w
    np.testing.assert_allclose(left, star2.mv(h) @ ex.d1(topology).mv(w), rtol=1e-10)


def test_harmonic_forms_count_the_handles():
    matrix = to_scipy(ex.hodge_laplacian1(*measured(shapes.torus(12, 8)))).toarray()
    values = np.linalg.eigvalsh(matrix)
    assert (np.abs(values[:2]) < 1e-10).all() and values[2] > 1e-3


def test_scalar_laplacian_of_the_sphere():
    """Weak Laplacian over dual areas: eigenvalues 0, 2 ×3, 6 ×5 with error of order h²."""
    errors = []
    for frequency in (4, 8):
        lengths, topology = measured(shapes.icosphere(frequency))
        half = 1 / np.sqrt(np.asarray(g.circumcentric_vertex_areas(lengths, topology)))
        matrix = to_scipy(ex.hodge_laplacian0(lengths, topology)).toarray()
        values = np.linalg.eigvalsh(half[:, None] * matrix * half)[:9]
        errors.append(np.abs(values - np.array([0, 2, 2, 2, 6, 6, 6, 6, 6])).max())
    assert errors[1] < 0.1 and errors[0] / errors[1] > 3.5


def rotation_field(mesh):
    """U = e_z × x, in the intrinsic frames."""
    x = mesh.vertices
    ambient = jnp.stack([-x[:, 1], x[:, 0], jnp.zeros_like(x[:, 0])], axis=1)
    return g.project(ambient, g.vertex_frames(x, mesh.topology))


@pytest.mark.parametrize(
    "make",
    [
        pytest.param(shapes.icosphere, id="sphere"),
        pytest.param(lambda n: shapes.torus(3 * n, n), id="torus", marks=pytest.mark.slow),
    ],
)
def test_sharp_undoes_flat(make):
    errors = []
    for n in (6, 12, 24):
        mesh = make(n)
        lengths, topology = measured(mesh)
        field = rotation_field(mesh)
        back = ex.sharp(ex.flat(field, lengths, topology), lengths, topology)
        inside = np.asarray(~topology.is_boundary_vertex)
        errors.append(np.sqrt((np.asarray(back - field)[inside] ** 2).sum(1).mean()))
    assert errors[-1] < 5e-3 and errors[0] / errors[1] > 1.8 and errors[1] / errors[2] > 1.8


def test_a_constant_field_in_the_plane_is_exact_everywhere():
    mesh = shapes.disk(5)
    lengths, topology = measured(mesh)
    constant = jnp.broadcast_to(jnp.asarray([0.6, -0.8, 0.0]), mesh.vertices.shape)
    at_vertices = g.project(constant, g.vertex_frames(mesh.vertices, topology))
    x = mesh.vertices
    exact = ((x[topology.edges[:, 1]] - x[topology.edges[:, 0]]) * constant[:1]).sum(1)
    form = ex.flat(at_vertices, lengths, topology)
    np.testing.assert_allclose(form, exact, atol=1e-13)
    np.testing.assert_allclose(ex.sharp(form, lengths, topology), at_vertices, atol=1e-12)

    in_faces = ex.sharp_faces(form, lengths, topology)
    frames = g.face_frames(mesh.vertices, topology)
    np.testing.assert_allclose(
        jnp.einsum("fc,fcd->fd", in_faces, frames), np.tile(constant[:1], (topology.n_faces, 1)), atol=1e-12
    )
    np.testing.assert_allclose(ex.flat_faces(in_faces, lengths, topology), exact, atol=1e-12)


def test_face_sides_close_up_and_lie_in_the_frame():
    mesh = shapes.random_sphere(40, seed=2)
    lengths, topology = measured(mesh)
    sides = np.asarray(lengths)[np.asarray(topology.face_edges)][..., None] * np.asarray(
        ex.face_side_directions(lengths, topology)
    )
    np.testing.assert_allclose(sides.sum(1), 0, atol=1e-13)
    frames = np.asarray(g.face_frames(mesh.vertices, topology))
    corners = np.asarray(mesh.vertices)[np.asarray(topology.faces)]
    np.testing.assert_allclose(
        np.einsum("fsc,fcd->fsd", sides, frames), np.roll(corners, -1, 1) - corners, atol=1e-12
    )
