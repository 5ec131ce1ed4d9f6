"""Symmetrization in single precision, JAX's default; what it reaches is measured in double precision."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkvf
from jaxkvf import shapes
from jaxkvf.symmetrization import OUTCOMES, Configuration, PositionFidelity, ShapeBarrier, symmetry_report

SCRIPT = """
import sys
import numpy as np
import jaxkvf
from jaxkvf import shapes
mesh = shapes.add_normal_noise(shapes.ellipsoid(4), 0.05, seed=0)
done = jaxkvf.symmetrize(mesh)
assert mesh.vertices.dtype == done.mesh.vertices.dtype == np.float32
account = jaxkvf.symmetry_report(mesh, done)
history = [step.dimensionless[0] for step in done.history]
np.savez(sys.argv[1], before=mesh.vertices, after=done.mesh.vertices, history=history, result=account.result)
"""


def exactly(mesh, vertices):
    """λ₀·area in double precision."""
    exact = mesh.with_vertices(jnp.asarray(np.asarray(vertices), jnp.float64))
    return float(jaxkvf.killing_fields(exact, 1).dimensionless[0])


def check(mesh, before, after, history):
    first, last, goal = exactly(mesh, before), exactly(mesh, after), 20 / mesh.topology.n_faces**2
    np.testing.assert_allclose([history[0], history[-1]], [first, last], rtol=2e-3)
    assert (np.diff(history) <= 0).all()
    assert 0 < last <= goal * 1.01 + 5e-7 * first < 2e-2 * first
    unit = float(Configuration.of(mesh).unit)
    moved = np.sqrt((np.asarray(after - before, np.float64) ** 2).sum(1).mean()) / unit
    assert 1e-3 < moved < 0.06


def test_arrays_of_single_precision():
    mesh = shapes.add_normal_noise(shapes.ellipsoid(3), 0.05, seed=0)
    single = jaxkvf.TriangleMesh(mesh.vertices.astype(jnp.float32), mesh.topology)
    done = jaxkvf.symmetrize(single)
    assert done.result == OUTCOMES.successful
    for array in jax.tree.leaves((done.mesh.vertices, done.lengths, done.state.evaluation.fields)):
        assert array.dtype == np.float32
    check(mesh, single.vertices, done.mesh.vertices, [step.dimensionless[0] for step in done.history])
    assert symmetry_report(single, done).result == "successful"


@pytest.mark.exhaustive
def test_without_x64(tmp_path):
    environment = os.environ | {"JAX_ENABLE_X64": "0", "JAX_NUMPY_DTYPE_PROMOTION": "strict"}
    file = tmp_path / "single.npz"
    subprocess.run([sys.executable, "-W", "error", "-c", SCRIPT, str(file)], check=True, env=environment)
    found = np.load(file)
    assert str(found["result"]) == "successful"
    check(shapes.ellipsoid(4), found["before"], found["after"], found["history"])


def test_prices_in_single_precision():
    """Of small moves they are small, though not zero."""
    mesh = shapes.icosphere(3)
    moved = mesh.with_vertices(mesh.vertices * (1 + 1e-3 * mesh.vertices[:, 2:]))
    single, double = (
        [Configuration.of(jaxkvf.TriangleMesh(m.vertices.astype(dtype), m.topology)) for m in (moved, mesh)]
        for dtype in (jnp.float32, jnp.float64)
    )
    for term in (PositionFidelity(1.0), ShapeBarrier(1.0)):
        np.testing.assert_allclose(float(term(*single)), float(term(*double)), rtol=1e-3)
