"""What a shape stands on: the axis of its symmetry, where there is one."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxkvf import TriangleMesh, killing_fields, shapes
from jaxkvf.geometry import closest_rigid_motion
from jaxkvf.report import symmetry_axis

TURN = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()


def placed(mesh: TriangleMesh, vertices: np.ndarray) -> TriangleMesh:
    return mesh.with_vertices(jnp.asarray(vertices))


def turned(mesh: TriangleMesh) -> TriangleMesh:
    return placed(mesh, 3.0 * np.asarray(mesh.vertices) @ TURN.T + [5.0, -20.0, 7.0])


def test_a_rigid_motion_is_found_again_whatever_the_weights():
    random = np.random.default_rng(0)
    x, weights = random.normal(size=(50, 3)) + 10, random.uniform(size=50)
    rotation, translation = random.normal(size=3), random.normal(size=3)
    field = np.cross(rotation, x - weights @ x / weights.sum()) + translation
    found = closest_rigid_motion(x, field, weights)
    np.testing.assert_allclose(found.rotation, rotation, rtol=1e-10)
    np.testing.assert_allclose(found.translation, translation, rtol=1e-10)
    assert found.misfit < 1e-12
    # least squares: no other motion is closer
    field += random.normal(size=field.shape)
    found = closest_rigid_motion(x, field, weights)
    rest = field - found.translation - np.cross(found.rotation, x - found.center)
    np.testing.assert_allclose(weights @ rest, 0, atol=1e-10)
    np.testing.assert_allclose(weights @ np.cross(x - found.center, rest), 0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "mesh"),
    [
        ("vase", shapes.add_normal_noise(shapes.vase(24), 0.1, seed=0)),
        ("open cylinder, two fields mixed", shapes.cylinder(16)),
        ("flat annulus, three", shapes.annulus(5, 0.4, 1.0)),
        ("nearly a sphere", shapes.ellipsoid(6, (1.0, 1.0, 1.15))),
    ],
)
def test_a_shape_with_an_axis_stands_on_it(name, mesh):
    axis = symmetry_axis(turned(mesh), killing_fields(turned(mesh), 4))
    assert axis is not None and abs(axis @ TURN[:, 2]) > 1 - 1e-4, name


def test_specks_do_not_decide():
    vase, speck = shapes.vase(24), shapes.icosphere(1)
    x = np.concatenate([vase.vertices, 1e-3 * speck.vertices + 3.0])
    faces = np.concatenate([vase.faces, speck.faces + len(vase.vertices)])
    mesh = turned(TriangleMesh.from_arrays(x, faces))
    axis = symmetry_axis(mesh, killing_fields(mesh, 6))
    assert axis is not None and abs(axis @ TURN[:, 2]) > 1 - 1e-4


def wavy_sheet() -> TriangleMesh:
    """Symmetric within itself, but by no motion of space."""
    flat = shapes.annulus(6, 0.4, 1.0)
    x = np.array(flat.vertices)
    x[:, 2] = 0.3 * np.sin(4 * x[:, 0])
    return placed(flat, x)


@pytest.mark.parametrize(
    ("name", "mesh"),
    [("many", shapes.icosphere(6)), ("none", shapes.limbed_blob(6)), ("waves", wavy_sheet())],
)
def test_a_shape_with_no_axis_or_many_has_none(name, mesh):
    assert symmetry_axis(mesh, killing_fields(mesh, 4)) is None, name
