"""Symmetrizations that are interrupted, saved, copied and sent to other processes."""

import copy
import io
import multiprocessing
import pickle
import zipfile

import jax
import numpy as np
import optimistix as optx
import pytest

import jaxkvf
from jaxkvf import shapes
from jaxkvf.symmetrization import LowestFields, PositionFidelity, ShapeBarrier, symmetry_report

GO_ON = {"rtol": 0.0, "atol": 0.0}


@pytest.fixture(scope="module")
def small():
    return shapes.add_normal_noise(shapes.ellipsoid(3), 0.05, seed=2)


@pytest.fixture(scope="module")
def half(small):
    return jaxkvf.symmetrize(small, max_steps=6, **GO_ON)


def same(one, other):
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))


def test_it_goes_on_from_a_state_as_if_it_had_not_stopped(small, half, tmp_path):
    before = np.array(small.vertices)
    whole = jaxkvf.symmetrize(small, max_steps=12, **GO_ON)
    assert whole.stats["steps"] == 12 and half.stats["steps"] == 6
    assert whole.history[-1].dimensionless[0] < half.history[-1].dimensionless[0]
    half.state.save(tmp_path / "state.npz")
    pickled = pickle.loads(pickle.dumps(half.state))
    for state in (half.state, pickled, tmp_path / "state.npz", str(tmp_path / "state.npz")):
        resumed = jaxkvf.symmetrize(small, max_steps=np.int64(12), resume=state, **GO_ON)
        same(resumed.history, whole.history)
        np.testing.assert_array_equal(resumed.mesh.vertices, whole.mesh.vertices)
    np.testing.assert_array_equal(small.vertices, before)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "minimiser",
    [optx.IndirectLevenbergMarquardt(1e-10, 1e-10), optx.NelderMead(1e-8, 1e-8), optx.BFGS(1e-8, 1e-8)],
    ids=["LevenbergMarquardt", "NelderMead", "BFGS"],
)
def test_with_other_minimisers(minimiser, tmp_path):
    mesh = shapes.add_normal_noise(shapes.ellipsoid(2), 0.05, seed=2)
    options = {"minimiser": minimiser, **GO_ON}
    whole = jaxkvf.symmetrize(mesh, max_steps=5, **options)
    jaxkvf.symmetrize(mesh, max_steps=2, **options).state.save(tmp_path / "state.npz")
    resumed = jaxkvf.symmetrize(mesh, max_steps=5, resume=tmp_path / "state.npz", **options)
    np.testing.assert_allclose(resumed.mesh.vertices, whole.mesh.vertices, rtol=1e-9)
    assert [step.steps for step in resumed.history] == [step.steps for step in whole.history]


def others(small):
    """Each with one thing changed, and the word that the error must have."""
    elsewhere = small.with_vertices(small.vertices.at[3, 1].add(1e-9))
    return {
        "positions": (elsewhere, {}),
        "faces": (shapes.add_normal_noise(shapes.ellipsoid(2), 0.05, seed=2), {}),
        r"target \(LowestFields\(\) then, LowestFields\(number=2\) now\)": (small, {"target": 2}),
        "terms": (small, {"terms": (PositionFidelity(2e-4), ShapeBarrier())}),
        "unknowns": (small, {"unknowns": jaxkvf.symmetrization.EdgeLengths()}),
        "minimiser": (small, {"minimiser": optx.BFGS(1e-8, 1e-8)}),
        "precision": (
            jaxkvf.TriangleMesh(small.vertices.astype(np.float32), small.topology),
            {},
        ),
    }


@pytest.mark.parametrize("what", range(7))
def test_the_state_of_another_problem_is_refused(small, half, what, tmp_path):
    word, (mesh, options) = list(others(small).items())[what]
    half.state.save(tmp_path / "state.npz")
    for state in (half.state, tmp_path / "state.npz"):
        with pytest.raises(ValueError, match=f"belongs to another problem, which differs in .*{word}"):
            jaxkvf.symmetrize(mesh, resume=state, **options)


def test_what_may_change_when_it_goes_on(small, half):
    target = LowestFields(1)
    done = jaxkvf.symmetrize(
        small,
        target,
        max_steps=7,
        reach=2.0,
        rtol=1e-12,
        atol=0.0,
        solver=jaxkvf.eigen.DenseEigh(),
        resume=half.state,
    )
    assert done.stats["steps"] == 7


def test_files_that_hold_no_state_are_refused(small, half, tmp_path):
    good = tmp_path / "state.npz"
    half.state.save(good)
    content = good.read_bytes()
    arrays = dict(np.load(good))

    def packed(**changed):
        stream = io.BytesIO()
        np.savez(stream, **{k: v for k, v in (arrays | changed).items() if v is not None})
        return stream.getvalue()

    flipped = bytearray(content)
    largest = max(zipfile.ZipFile(good).infolist(), key=lambda entry: entry.file_size)
    flipped[largest.header_offset + 400] ^= 0xFF
    single = io.BytesIO()
    np.save(single, np.zeros(3))
    bad = {
        "nothing": b"",
        "half": content[: len(content) // 2],
        "start": content[:100],
        "one bit": bytes(flipped),
        "text": b"not an archive",
        "array": single.getvalue(),
        "no evaluation": packed(**{"evaluation.2": None}),
        "no history": packed(**{"history.terms": None}),
        "other shape": packed(**{"accepted.0": np.zeros(7)}),
        "other format": packed(format=np.asarray("9")),
        "no problem": packed(problem=None),
        "uneven history": packed(**{"history.steps": np.arange(3)}),
    }
    for name, data in bad.items():
        (tmp_path / "bad.npz").write_bytes(data)
        with pytest.raises(ValueError, match="is not the whole state of a symmetrization"):
            jaxkvf.symmetrize(small, resume=tmp_path / "bad.npz")
            pytest.fail(name)
    with pytest.raises(FileNotFoundError):
        jaxkvf.symmetrize(small, resume=tmp_path / "none.npz")
    with pytest.raises(TypeError):
        jaxkvf.symmetrize(small, resume=half)


def echo(x):
    return x, float(np.asarray(jax.tree.leaves(x)[0]).ravel()[0])


@pytest.mark.exhaustive
def test_results_go_through_processes(small, half):
    """By `spawn`, the way that is safe with JAX's threads."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        for one in (half, half.state):
            other, number = pool.apply(echo, (one,))
            same(other, one)
            assert number == float(np.asarray(jax.tree.leaves(one)[0]).ravel()[0])


def test_public_results_can_be_pickled_and_copied(small, half):
    fields = jaxkvf.killing_fields(small, 2)
    for one in (half, symmetry_report(small, half), small, small.topology, fields):
        for other in (pickle.loads(pickle.dumps(one)), copy.deepcopy(one), copy.copy(one)):
            assert type(other) is type(one)
            same(other, one)
    again = copy.deepcopy(half)
    resumed = jaxkvf.symmetrize(small, max_steps=7, resume=again.state, **GO_ON)
    assert resumed.stats["steps"] == 7
