"""Whoever does what `check` says, to the letter, gets the surface back."""

import numpy as np
import pytest
from broken_meshes import BREAKS, follow
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import jaxkvf
from jaxkvf import TriangleMesh, check, repair, shapes

GOOD = {
    name: (np.asarray(mesh.vertices), np.asarray(mesh.faces))
    for name, mesh in {
        "sphere": shapes.icosphere(3),
        "disk": shapes.disk(3),
        "torus": shapes.torus(12, 7),
        "random": shapes.random_sphere(60, seed=1),
    }.items()
}


def invariants(vertices: np.ndarray, faces: np.ndarray) -> tuple[int, int, int]:
    topology = TriangleMesh.from_arrays(vertices, faces).topology
    return topology.euler_characteristic, topology.components()[0], topology.boundary_loops()[0]


def area(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@st.composite
def broken(draw: st.DrawFn) -> tuple[str, list[str], int, bool, int]:
    kinds = draw(st.lists(st.sampled_from(list(BREAKS)), min_size=1, max_size=2, unique=True))
    return (
        draw(st.sampled_from(list(GOOD))),
        sorted(kinds, key=[*BREAKS].index),
        draw(st.sampled_from([0, 0, -3, 3, -20, 20])),
        draw(st.booleans()),
        draw(st.integers(0, 999)),
    )


@settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(broken())
def test_the_advice_restores_the_surface(case):
    restores(*case)


@pytest.mark.exhaustive
@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(broken())
def test_the_advice_restores_many_surfaces(case):
    restores(*case)


def restores(name: str, kinds: list[str], exponent: int, at_once: bool, seed: int) -> None:
    vertices, faces = GOOD[name]
    vertices = vertices * 10.0**exponent
    mesh, rng = (vertices, faces), np.random.default_rng(seed)
    for kind in kinds:
        mesh = BREAKS[kind](*mesh, rng)
    done, report = follow(mesh, at_once=at_once)
    if "last_digits" in kinds:  # loose triangles are allowed, so their seams are a remark
        seams = next(finding for finding in report.remarks if "merge_duplicates" in finding.remedy)
        distance = float(seams.remedy.partition("merge_duplicates=")[2].partition(")")[0])
        done, report = follow(_arrays(repair(_arrays(done), merge_duplicates=distance)), at_once=at_once)
    if "with_specks" in kinds:
        assert "below 1 % of the largest's area" in str(report)
        done = repair(_arrays(done), keep_largest=1)
    assert report.ok
    assert invariants(*_arrays(done)) == invariants(vertices, faces)
    tolerance = 1e-5 if {"last_digits", "half_sewn"} & set(kinds) else 1e-12
    scale = 10.0**exponent
    assert area(done.vertices / scale, done.faces) == pytest.approx(
        area(vertices / scale, faces), rel=tolerance
    )


def _arrays(done: jaxkvf.Repair) -> tuple[np.ndarray, np.ndarray]:
    return done.vertices, done.faces


@pytest.mark.exhaustive
def test_flat_faces_go_without_a_trace_in_the_spectrum():
    mesh = shapes.ellipsoid(3)
    broken = BREAKS["sides_without_length"](
        np.asarray(mesh.vertices), np.asarray(mesh.faces), np.random.default_rng(3)
    )
    done, _ = follow(broken)
    expected = jaxkvf.killing_fields(mesh, 3).dimensionless
    np.testing.assert_allclose(jaxkvf.killing_fields(done.mesh, 3).dimensionless, expected, atol=1e-8)


def test_faces_at_the_boundary_and_what_opens_are_counted():
    vertices, faces = GOOD["disk"]
    topology = shapes.disk(3).topology
    edge = np.flatnonzero(np.asarray(topology.is_boundary_edge))[0]
    face, side = divmod(int(np.asarray(topology.edge_halfedges)[edge].max()), 3)
    a, b, c = np.roll(faces[face], -side)
    middle = len(vertices)
    mesh = (
        np.concatenate([vertices, [(vertices[a] + vertices[b]) / 2]]),
        np.concatenate([np.delete(faces, face, 0), [[a, middle, c], [middle, b, c], [a, b, middle]]]),
    )
    assert check(mesh).errors[0].steps == {"drop_degenerate": True}
    done = repair(mesh, drop_degenerate=True)
    assert done.actions[0] == "dropped flat faces at the boundary: 1"
    assert done.actions[1].startswith("boundary edges now: ") and len(done.actions) == 2
    assert done.report.ok
    split = repair((vertices, np.concatenate([faces, faces[:1, ::-1]])), split_nonmanifold=True)
    assert any(action == "pieces now: 3, before: 1" for action in split.actions)
    assert any(action.startswith("boundary edges now: ") for action in split.actions)


def test_closed_pieces_look_outwards_and_cavities_inwards():
    outer, ball = GOOD["sphere"], GOOD["torus"]
    inside = 0.02 * ball[0], ball[1][:, ::-1]
    hollow = np.concatenate([outer[0], inside[0]]), np.concatenate([outer[1], inside[1] + len(outer[0])])
    assert "inside out" not in str(check(hollow))
    turned = hollow[0], hollow[1][:, ::-1]
    (remark,) = [finding for finding in check(turned).remarks if "inside out" in finding.kind]
    assert remark.count == 2 and remark.steps == {"orient": True}
    np.testing.assert_array_equal(repair(turned, orient=True).faces, hollow[1])
    only_outer = hollow[0], np.concatenate([outer[1][:, ::-1], inside[1] + len(outer[0])])
    np.testing.assert_array_equal(repair(only_outer, orient=True).faces, hollow[1])


@pytest.mark.parametrize("scale", [1e-280, 1e-60, 1.0, 1e60])
def test_any_scale(scale):
    vertices, faces = GOOD["sphere"]
    signed = scale * np.concatenate([vertices, np.where(vertices == 0, -0.0, vertices)])
    mesh = signed, np.concatenate([faces[:90], faces[90:] + len(vertices)])
    merged = repair(mesh, merge_duplicates=True, drop_unreferenced=True)
    assert len(merged.vertices) == len(vertices)
    near = repair(
        (scale * (1 + 1e-9 * np.arange(2)[:, None]) * [[1.0, 0, 0]], [[0, 1, 0]]),
        merge_duplicates=1e-8 * scale,
    )
    assert len(near.vertices) == 1
    if scale > 1e-100:
        assert check((scale * vertices, faces[:, ::-1])).remarks[0].kind == "closed pieces turned inside out"
