"""The main path of every public function with float64 off, JAX's default; run by `test_float32.py` in a process of its own.

Each check compares with a value that is known otherwise, to what float32 can hold. Prints JSON: what failed, and how.
"""

import json
import sys
import tempfile
import traceback
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxkvf
from jaxkvf import TriangleMesh, eigen, exterior, geometry, shapes

CHECKS = {}


def check(function):
    CHECKS[function.__name__] = function
    return function


def sphere() -> TriangleMesh:
    return shapes.icosphere(6)


def spheroid() -> TriangleMesh:
    return shapes.ellipsoid(6, (1.0, 1.0, 1.6))


def rotation(mesh: TriangleMesh) -> jax.Array:
    """Around z, once in 2π."""
    return jnp.cross(jnp.array([0.0, 0.0, 1.0]), mesh.vertices)


@check
def the_configuration_is_jax_s_default():
    assert jnp.zeros(1).dtype == jnp.float32 and sphere().vertices.dtype == jnp.float32


@check
def killing_fields():
    found = jaxkvf.killing_fields(sphere(), 6)
    assert found.vectors.dtype == jnp.float32
    np.testing.assert_allclose(found.eigenvalues[:3], 0, atol=2e-4)
    np.testing.assert_allclose(found.eigenvalues[3:], 4, rtol=0.02)


@check
def killing_eigenvalues_of_every_discretization():
    for name in ("regge", "regge-delaunay", "dec"):
        values = jaxkvf.killing_eigenvalues(sphere(), 6, discretization=name)
        np.testing.assert_allclose(values[3:], 4, rtol=0.05, err_msg=name)


@check
def eigensolvers():
    diagonal = jnp.arange(1.0, 41.0)
    A = jnp.diag(diagonal)
    problem = eigen.GeneralizedEigenproblem(dense(A), dense(jnp.eye(40)))
    for solver in (eigen.DenseEigh(), eigen.LOBPCG(), eigen.ScipyEigsh()):
        found = eigen.eigsolve(problem, 3, solver)
        np.testing.assert_allclose(found.eigenvalues, [1, 2, 3], rtol=1e-4, err_msg=type(solver).__name__)


def dense(matrix: jax.Array):
    import lineax  # noqa: PLC0415

    return lineax.MatrixLinearOperator(matrix, (lineax.symmetric_tag, lineax.positive_semidefinite_tag))


@check
def gradients():
    mesh = spheroid()

    def asymmetry(scale):
        return jaxkvf.killing_eigenvalues(mesh.with_vertices(mesh.vertices * scale), 4)[3]

    value, slope = jax.value_and_grad(asymmetry)(jnp.float32(1.0))
    np.testing.assert_allclose(slope, -2 * value, rtol=1e-3)


@check
def energies():
    mesh = sphere()
    np.testing.assert_allclose(
        jaxkvf.killing_energy(mesh, rotation(mesh)), 0, atol=1e-3
    )  # of 8π/3, and of h⁴
    along, normals = jnp.array([1.0, 0.0, 0.0]), mesh.vertices
    tangent = along - normals * (normals @ along)[:, None]
    density = jaxkvf.killing_energy_density(mesh, tangent)
    np.testing.assert_allclose(density.max(), 8, rtol=0.15)  # a gradient of height: KU = −2 x g, ‖g‖² = 2


@check
def geometry_and_exterior_calculus():
    mesh = sphere()
    lengths = geometry.edge_lengths(mesh.vertices, mesh.topology)
    np.testing.assert_allclose(geometry.surface_area(lengths, mesh.topology), 4 * np.pi, rtol=0.02)
    np.testing.assert_allclose(geometry.angle_defects(lengths, mesh.topology).sum(), 4 * np.pi, rtol=1e-5)
    twice = exterior.d1(mesh.topology).mv(exterior.d0(mesh.topology).mv(mesh.vertices[:, 0]))
    np.testing.assert_allclose(twice, 0, atol=1e-6)
    flipped = jaxkvf.intrinsic_delaunay(mesh)
    np.testing.assert_allclose(
        geometry.surface_area(flipped.lengths, flipped.topology),
        geometry.surface_area(lengths, mesh.topology),
        rtol=1e-5,
    )


@check
def harmonic_fields():
    found = jaxkvf.harmonic_fields(shapes.torus(24, 12))
    assert found.vectors.shape[0] == 2


@check
def period():
    mesh = spheroid()
    found = jaxkvf.period(mesh, rotation(mesh))
    np.testing.assert_allclose(found.period, 2 * np.pi, rtol=0.01)


@check
def flow_and_curves():
    mesh = spheroid()
    starts = geometry.vertex_points(mesh, np.array([0, 7, 50]))
    ends = jaxkvf.flow(mesh, rotation(mesh), 1.0, starts)
    turn = np.array([[np.cos(1), -np.sin(1), 0], [np.sin(1), np.cos(1), 0], [0, 0, 1]])
    wanted = np.asarray(mesh.vertices)[[0, 7, 50]] @ turn.T
    np.testing.assert_allclose(geometry.surface_positions(mesh, ends.points), wanted, atol=0.05)
    again = jaxkvf.flow(mesh, rotation(mesh), -1.0, ends.points)
    np.testing.assert_allclose(
        geometry.surface_positions(mesh, again.points), np.asarray(mesh.vertices)[[0, 7, 50]], atol=0.05
    )
    curves = jaxkvf.integral_curves(mesh, rotation(mesh), 1.0, starts)
    assert np.isfinite(curves.positions).all()


@check
def closest_points():
    mesh = spheroid()
    found = jaxkvf.closest_points(mesh, np.asarray(mesh.vertices)[:5])
    np.testing.assert_allclose(geometry.surface_positions(mesh, found), mesh.vertices[:5], atol=1e-6)
    ends = jaxkvf.flow(mesh, rotation(mesh), 0.0, found)  # the library's own points are points of the surface
    np.testing.assert_allclose(geometry.surface_positions(mesh, ends.points), mesh.vertices[:5], atol=1e-5)


@check
def advection_and_isometry():
    mesh = spheroid()
    moved = jaxkvf.advect_vertices(mesh, rotation(mesh), 0.5)
    half = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    np.testing.assert_allclose(moved, np.asarray(mesh.vertices) @ half.T, atol=0.05)
    assert jaxkvf.isometry_error(mesh, rotation(mesh), 0.5).relative_rms < 0.02


@check
def orbit():
    mesh = spheroid()
    found = jaxkvf.orbit(mesh, rotation(mesh), 4, geometry.vertex_points(mesh, np.array([3])))
    assert float(found.closure.max()) < 0.05


@check
def symmetrize():
    mesh = shapes.add_normal_noise(shapes.ellipsoid(4), 0.05, seed=0)
    done = jaxkvf.symmetrize(mesh, max_steps=100)
    assert float(done.history[-1].dimensionless[0]) < 0.2 * float(done.history[0].dimensionless[0])
    assert len(done.history) > 2


@check
def local_symmetry_and_parts():
    shares = jaxkvf.component_shares(sphere(), jaxkvf.killing_fields(sphere(), 3))
    np.testing.assert_allclose(shares, 1, rtol=1e-6)


@check
def pattern():
    mesh = spheroid()
    made = jaxkvf.pattern(
        mesh, rotation(mesh), np.array([int(np.abs(np.asarray(mesh.vertices)[:, 2]).argmin())]), 5
    )
    assert len(made.coordinates) == 5


@check
def files():
    mesh = spheroid()
    with tempfile.TemporaryDirectory() as folder:
        for suffix in ("obj", "ply", "off"):
            mesh.save(Path(folder) / f"a.{suffix}")
            again = TriangleMesh.load(Path(folder) / f"a.{suffix}")
            np.testing.assert_array_equal(np.asarray(again.vertices, np.float32), np.asarray(mesh.vertices))


@check
def checks_and_repair():
    x, f = np.asarray(sphere().vertices), np.asarray(sphere().faces)
    assert (
        jaxkvf.check((x, f)).ok
        and jaxkvf.repair((x, np.concatenate([f, f[:1]])), drop_duplicate_faces=True).report.ok
    )


if __name__ == "__main__":
    failures = {}
    for name in sys.argv[1:] or CHECKS:
        try:
            CHECKS[name]()
        except Exception as error:
            print(name, "failed:", error, file=sys.stderr, flush=True)
            failures[name] = "".join(traceback.format_exception(error)[-3:])[-1500:]
    print(json.dumps(failures))
