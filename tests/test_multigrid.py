"""The vector multigrid preconditioner: symmetric, positive, independent of size, on all kinds of meshes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkvf
from jaxkvf import geometry as g
from jaxkvf import shapes
from jaxkvf.eigen import LOBPCG, GeneralizedEigenproblem, ScipyEigsh, eigsolve
from jaxkvf.killing import Dec, Regge, vector_hierarchy
from jaxkvf.preconditioning import AuxiliarySpace, Multigrid
from jaxkvf.sparse import assembled


def joined(*parts):
    """One mesh of several, each given by vertices and faces."""
    counts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    faces = [np.asarray(faces) + first for (_, faces), first in zip(parts, counts[:-1], strict=True)]
    return jaxkvf.TriangleMesh.from_arrays(
        np.concatenate([np.asarray(v) for v, _ in parts]), np.concatenate(faces)
    )


def two_spheres():
    one, other = shapes.icosphere(7), shapes.icosphere(6)
    return joined((one.vertices, one.faces), (3 + other.vertices, other.faces))


def with_specks(mesh, count, size):
    """Beside the mesh, this many small tetrahedra, none like another."""
    rng, faces = np.random.default_rng(0), np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    corners = size * np.eye(4, 3, -1)
    specks = [(rng.uniform(-5, 5, 3) + corners * rng.uniform(0.5, 1, 3), faces) for _ in range(count)]
    return joined((mesh.vertices, mesh.faces), *specks)


MESHES = {
    "closed": lambda: shapes.bumpy_sphere(8),
    "boundary": lambda: shapes.annulus(9),
    "two components": two_spheres,
    "thin triangles": lambda: shapes.random_sphere(700, seed=0, radii=(1.0, 1.0, 2.5)),
    "specks": lambda: with_specks(shapes.bumpy_sphere(8), 300, 0.01),
}
CASES = ["specks", *(pytest.param(name, marks=pytest.mark.slow) for name in MESHES if name != "specks")]


def problem_and_multigrid(mesh, levels, direct_below=200, **options):
    """The problem, and a multigrid that has this many levels above the coarsest."""
    lengths = g.edge_lengths(mesh.vertices, mesh.topology)
    problem = Regge().eigenproblem(lengths, mesh.topology)
    problem = GeneralizedEigenproblem(assembled(problem.A), assembled(problem.B))
    hierarchy = vector_hierarchy(lengths, mesh.topology, direct_below=direct_below)
    assert len(hierarchy) == levels
    return problem, Multigrid(hierarchy, **options)


@eqx.filter_jit
def cycle(multigrid, problem, block):
    return multigrid.prepare(problem).apply(block)


@pytest.mark.parametrize("name", CASES)
def test_the_cycle_is_symmetric_positive_definite(name):
    problem, multigrid = problem_and_multigrid(MESHES[name](), 2, direct_below=40, dtype=None)
    x = np.random.default_rng(0).standard_normal((problem.size, 8))
    gram = x.T @ np.asarray(cycle(multigrid, problem, jnp.asarray(x)))
    np.testing.assert_allclose(gram, gram.T, atol=1e-10 * np.abs(gram).max())
    assert np.linalg.eigvalsh(gram)[0] > 0


@pytest.mark.parametrize(
    "name", ["closed", *(pytest.param(n, marks=pytest.mark.slow) for n in list(MESHES)[1:4])]
)
def test_lobpcg_with_it_takes_few_steps_and_is_right(name):
    problem, multigrid = problem_and_multigrid(MESHES[name](), 2, direct_below=40)
    solution = eigsolve(problem, 6, LOBPCG(preconditioner=multigrid))
    reference = eigsolve(problem, 6, ScipyEigsh())
    assert 1 <= int(solution.stats["steps"]) <= 30
    assert 0 < float(solution.residuals.max()) <= 1e-8
    largest = float(reference.eigenvalues[-1])
    np.testing.assert_allclose(solution.eigenvalues, reference.eigenvalues, rtol=1e-9, atol=1e-9 * largest)


@pytest.mark.slow
def test_steps_do_not_grow_with_the_mesh_and_a_warm_start_pays():
    steps = []
    for frequency, levels in ((10, 1), (20, 2)):
        problem, multigrid = problem_and_multigrid(shapes.bumpy_sphere(frequency), levels)
        solution = eigsolve(problem, 6, LOBPCG(preconditioner=multigrid))
        steps.append(int(solution.stats["steps"]))
    assert steps[1] <= 1.3 * steps[0] + 1

    # The same hierarchy serves the moved mesh.
    moved = shapes.add_normal_noise(shapes.bumpy_sphere(20), 0.01, seed=0)
    near, _ = problem_and_multigrid(moved, 2)
    solver = LOBPCG(preconditioner=multigrid)
    warm = eigsolve(near, 6, solver, guess=solution.eigenvectors)
    reference = eigsolve(near, 6, ScipyEigsh())
    np.testing.assert_allclose(warm.eigenvalues, reference.eigenvalues, rtol=1e-9)
    assert 1 <= int(warm.stats["steps"]) <= steps[1]


@pytest.mark.slow
def test_nested_iteration_starts_near_the_lowest_eigenvectors():
    problem, multigrid = problem_and_multigrid(shapes.bumpy_sphere(20), 2)
    start = eqx.filter_jit(lambda m, p: m.prepare(p).starting_vectors(8))(multigrid, problem)
    x = np.asarray(start, dtype=float)
    lowest = np.asarray(eigsolve(problem, 6, ScipyEigsh()).eigenvectors)
    B = np.asarray(problem.B.as_matrix())
    basis = x @ np.linalg.inv(np.linalg.cholesky(x.T @ B @ x)).T
    outside = lowest - basis @ (basis.T @ B @ lowest)
    np.testing.assert_array_less(
        np.sqrt(np.einsum("ij,ij->j", outside, B @ outside)), 0.05
    )  # sines of angles


@pytest.mark.slow
def test_the_default_solver_of_a_mesh():
    mesh = shapes.bumpy_sphere(7)
    fields = jaxkvf.killing_fields(mesh, 3, solver=jaxkvf.multigrid_solver(mesh))
    np.testing.assert_allclose(fields.eigenvalues, jaxkvf.killing_eigenvalues(mesh, 3), rtol=1e-9)
    assert not bool(fields.stats["fell_back"]) and fields.solver == "the caller's"
    assert "fewer than" in jaxkvf.killing_fields(mesh, 3).solver


@pytest.mark.slow
@pytest.mark.parametrize("name", ["closed", "two components"])
def test_dec_through_the_vectors(name):
    mesh = MESHES[name]()
    solver = jaxkvf.multigrid_solver(mesh, discretization="dec")
    fields = jaxkvf.killing_fields(mesh, 6, discretization="dec", solver=solver)
    assert not bool(fields.stats["fell_back"]) and 1 <= int(fields.stats["steps"]) <= 12
    reference = jaxkvf.killing_eigenvalues(mesh, 6, discretization="dec", solver=ScipyEigsh())
    np.testing.assert_allclose(fields.eigenvalues, reference, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_the_auxiliary_cycle_is_symmetric_positive_definite():
    mesh = MESHES["thin triangles"]()
    lengths = g.edge_lengths(mesh.vertices, mesh.topology)
    related, multigrid = problem_and_multigrid(mesh, 1, dtype=None)
    transfer = Dec().vertex_vector_operator(lengths, mesh.topology)
    auxiliary = AuxiliarySpace(related, transfer, multigrid)
    problem = Dec().eigenproblem(lengths, mesh.topology)
    x = np.random.default_rng(0).standard_normal((problem.size, 8))
    gram = x.T @ np.asarray(cycle(auxiliary, problem, jnp.asarray(x)))
    np.testing.assert_allclose(gram, gram.T, atol=1e-10 * np.abs(gram).max())
    assert np.linalg.eigvalsh(gram)[0] > 0
    with pytest.raises(ValueError, match="the transfer leads to 2094 unknowns, the problem has 1400"):
        auxiliary.prepare(related)


def test_it_is_deterministic():
    mesh = shapes.bumpy_sphere(6)
    one, two = (problem_and_multigrid(mesh, 1)[1] for _ in range(2))
    assert jax.tree.all(jax.tree.map(lambda a, b: bool((a == b).all()), one, two))


@pytest.mark.slow
def test_a_foreign_hierarchy_is_refused():
    problem, _ = problem_and_multigrid(shapes.bumpy_sphere(6), 1)
    _, foreign = problem_and_multigrid(shapes.bumpy_sphere(7), 1)
    with pytest.raises(ValueError, match="hierarchy was built for 492 nodes"):
        eigsolve(problem, 2, LOBPCG(preconditioner=foreign))


def test_a_hierarchy_is_kept_for_shapes_that_are_close():
    """And built anew for others; no more than two are kept, as long as the connectivity lives."""
    mesh = shapes.bumpy_sphere(6)

    def hierarchy(stretch):
        stretched = mesh.with_vertices(mesh.vertices * jnp.asarray([[1.0, 1.0, stretch]]))
        return jaxkvf.multigrid_preconditioner(stretched).hierarchy

    first, long = hierarchy(1.0), hierarchy(12.0)
    assert hierarchy(1.2) is first and hierarchy(11.0) is long
    assert long is not first
    hierarchy(100.0)
    assert hierarchy(12.0) is long
    assert hierarchy(1.0) is not first


@pytest.mark.slow
def test_a_stretched_shape_takes_as_few_steps():
    mesh = shapes.bumpy_sphere(20)
    jaxkvf.multigrid_solver(mesh)
    stretched = mesh.with_vertices(mesh.vertices * jnp.asarray([[1.0, 1.0, 12.0]]))
    fields = jaxkvf.killing_fields(stretched, 6, solver=jaxkvf.multigrid_solver(stretched))
    assert 1 <= int(fields.stats["steps"]) <= 15


def test_it_prints_its_levels():
    mesh = shapes.bumpy_sphere(6)
    _, multigrid = problem_and_multigrid(mesh, 1)
    first, finest, coarsest = str(multigrid).splitlines()
    n, m = mesh.topology.n_vertices, mesh.topology.n_edges
    coarsening = multigrid.hierarchy[0]
    counts = n + 2 * m, coarsening.interpolation.n_coarse + 2 * len(coarsening.coarse_edges)
    assert first == f"Multigrid of 2 levels, operator complexity {sum(counts) / counts[0]:.2f}"
    for line, count in zip((finest, coarsest), counts, strict=True):
        assert f"{count:,} blocks" in line
    assert str(Multigrid(())) == "Multigrid of one level: a direct solve"
