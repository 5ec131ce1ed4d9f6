"""Which solver, and how much memory it is expected to take."""

import pytest

import jaxkvf
from jaxkvf import shapes
from jaxkvf.eigen import LOBPCG, Cholmod, DenseEigh, ScipyEigsh, SuperLU, WithFallback
from jaxkvf.killing import Dec, Regge
from jaxkvf.solvers import preconditioner_for_many_solves, working_memory


@pytest.fixture(scope="module")
def sphere():
    return shapes.bumpy_sphere(32)


def test_memory_is_estimated_by_solver(sphere):
    """Kilobytes a vertex; 6 for LOBPCG and CHOLMOD is what `benchmarks/eigensolvers.py` measures."""
    topology, n = sphere.topology, sphere.topology.n_vertices

    def kilobytes(solver, k=6, discretization=None):
        return working_memory(topology, discretization or Regge(), k, solver) / n / 1000

    lobpcg = kilobytes(LOBPCG())
    assert 6 < lobpcg < 9
    assert 6 < kilobytes(ScipyEigsh(Cholmod())) < 9
    assert kilobytes(ScipyEigsh(Cholmod())) < kilobytes(ScipyEigsh(SuperLU())) < 20
    assert kilobytes(DenseEigh()) > 1000
    assert kilobytes(WithFallback(LOBPCG(), ScipyEigsh(SuperLU()))) == lobpcg
    assert kilobytes(None) == kilobytes(ScipyEigsh())
    assert kilobytes(LOBPCG(), k=20) > lobpcg
    assert kilobytes(LOBPCG(), discretization=Dec()) > 1.4 * lobpcg


def test_the_default_of_a_large_mesh_is_not_charged_for_a_factorization(sphere, monkeypatch):
    monkeypatch.setattr("jaxkvf.solvers._MULTIGRID_FROM", {"SuperLU": 1_000, "CHOLMOD": 1_000})
    charged = working_memory(sphere.topology, Regge(), 6, None)
    assert charged == working_memory(sphere.topology, Regge(), 6, LOBPCG())


def test_a_solve_that_fits_one_solver_alone(sphere, monkeypatch):
    """Between what LOBPCG takes and what dense matrices take."""
    monkeypatch.setattr("jaxkvf.memory.available_memory", lambda: 200_000_000)
    monkeypatch.setattr("jaxkvf.fields.eigsolve", lambda *_, **__: pytest.fail("solved"))
    with pytest.raises(jaxkvf.MeshTooLargeError, match=r"solving on 10242 vertices takes about 12\.5 GiB"):
        jaxkvf.killing_fields(sphere, 6, solver=DenseEigh())
    with pytest.raises(pytest.fail.Exception, match="solved"):
        jaxkvf.killing_fields(sphere, 6, solver=LOBPCG())


def test_many_solves_pay_for_multigrid_on_larger_meshes(sphere):
    assert preconditioner_for_many_solves(shapes.bumpy_sphere(8)) is None
    preconditioner = preconditioner_for_many_solves(sphere)
    assert len(preconditioner.hierarchy) == 2
