"""Broken or hostile input ends in a result or in a `MeshError` or `OSError`: nothing else, quickly, in little memory."""

import resource
import threading
import time
import warnings
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import jaxkvf
from jaxkvf import DenseEigh, MeshError, TriangleMesh, check, cli, repair, shapes

STEPS = (
    "drop_invalid",
    "merge_duplicates",
    "drop_degenerate",
    "drop_duplicate_faces",
    "split_nonmanifold",
    "orient",
    "drop_unreferenced",
)
SUFFIXES = (".obj", ".ply", ".off", ".stl")
HOSTILE = [
    *(
        b"nan",
        b"inf",
        b"-inf",
        b"1e999",
        b"-1",
        b"0",
        b"99999999999999999999",
        b"2147483648",
        b"0x10",
        b"1e-320",
    ),
    *(
        b"\n",
        b"\r",
        b"\\\n",
        b"\0",
        b"\0\xff\xfe",
        b"#",
        b"/",
        b"//",
        b" ",
        b"\t",
        b"\xef\xbb\xbf",
        "٣½".encode(),
    ),
    *(
        b"f 1 2 3 4 5\n",
        b"v 0 0\n",
        b"element vertex 999999999999\n",
        b"property list uchar int vertex_indices\n",
    ),
    *(b"OFF\n", b"ply\n", b"solid\n", b"end_header\n", b"facet", b"format ascii 1.0\n", b"9" * 4300),
]


@pytest.fixture(scope="module")
def sound_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[bytes]]:
    """The bytes of small meshes in every format."""
    folder = tmp_path_factory.mktemp("sound")
    files: dict[str, list[bytes]] = {suffix: [] for suffix in SUFFIXES}
    for mesh in (shapes.icosphere(1), shapes.disk(2), shapes.random_sphere(30, seed=0)):
        for suffix in SUFFIXES:
            mesh.save(folder / f"mesh{suffix}")
            files[suffix].append((folder / f"mesh{suffix}").read_bytes())
    vertices, faces = np.asarray(shapes.icosphere(1).vertices), np.asarray(shapes.icosphere(1).faces)
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in vertices.tolist())
    rows += "".join(f"3 {a} {b} {c}\n" for a, b, c in faces.tolist())
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    files[".ply"].append((header + rows).encode())
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*vertices[i]) for i in face)
        + "endloop\nendfacet\n"
        for face in faces.tolist()
    )
    files[".stl"].append(f"solid x\n{facets}endsolid x\n".encode())
    return files


@st.composite
def corrupted(draw: st.DrawFn, files: dict[str, list[bytes]]) -> tuple[str, bytes]:
    """A file and its ending, after one to four accidents or attacks."""
    suffix = draw(st.sampled_from(SUFFIXES))
    content = draw(st.sampled_from(files[draw(st.sampled_from([suffix, suffix, suffix, *SUFFIXES]))]))
    for _ in range(draw(st.integers(1, 4))):
        at, end = sorted(draw(st.integers(0, len(content))) for _ in range(2))
        piece = draw(st.sampled_from(HOSTILE) | st.binary(max_size=8))
        match draw(st.sampled_from(["cut", "insert", "replace", "drop", "repeat", "bomb", "swap"])):
            case "cut":
                content = content[:at]
            case "insert":
                content = content[:at] + piece + content[at:]
            case "replace":
                content = content[:at] + piece + content[at + len(piece) :]
            case "drop":
                content = content[:at] + content[min(end, at + 40) :]
            case "repeat":
                content = content[:end] + content[at:end] + content[end:]
            case "bomb":
                content = content[:at] + content[at : at + 30] * 20_000 + content[at:]
            case "swap":
                content = content[end:] + content[:end]
        content = content[:2_000_000]
    return suffix, content


def digest(source: Path | tuple[np.ndarray, np.ndarray]) -> None:
    """Loads, checks and repairs; what comes out is sound and agrees."""
    began = time.perf_counter()
    try:
        mesh = TriangleMesh.load(source) if isinstance(source, Path) else TriangleMesh.from_arrays(*source)
    except MeshError as error:
        assert str(error)
        mesh = None
    report = check(source)
    assert report.ok == (mesh is not None), f"{report}"
    try:
        mended = repair(source, **dict.fromkeys(STEPS, True))
    except MeshError as error:
        assert str(error)
    else:
        left = {finding.kind for finding in mended.report.errors}
        assert left <= {"faces on one-sided pieces", "faces beyond the range of the dtype"}
    assert time.perf_counter() - began < 10


def peak_memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def fuzz_files(files: dict[str, list[bytes]], folder: Path, count: int) -> None:
    seen = 0

    @settings(
        max_examples=count,
        deadline=None,
        database=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
    )
    @given(corrupted(files))
    def run(case: tuple[str, bytes]) -> None:
        nonlocal seen
        seen += 1
        suffix, content = case
        path = folder / f"mesh{suffix}"
        path.write_bytes(content)
        digest(path)

    before = peak_memory()
    run()
    assert seen >= count
    assert peak_memory() - before < 2 * 2**30


def test_corrupted_files(sound_files, tmp_path):
    fuzz_files(sound_files, tmp_path, 150)


@pytest.mark.slow
def test_many_corrupted_files(sound_files, tmp_path):
    fuzz_files(sound_files, tmp_path, 2000)


@pytest.mark.slow
@settings(
    max_examples=40, deadline=None, database=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
@given(data=st.data())
def test_corrupted_real_files(real_mesh_folder, tmp_path_factory, data):
    name = data.draw(st.sampled_from(["penguin", "wingnut"]))
    content = (real_mesh_folder / f"{name}.obj").read_bytes()
    _, damaged = data.draw(corrupted({suffix: [content] for suffix in SUFFIXES}))
    path = tmp_path_factory.getbasetemp() / "damaged.obj"
    path.write_bytes(damaged)
    digest(path)


@st.composite
def soups(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Random triangles over few random vertices, at any scale, some of them no triangles."""
    n = draw(st.integers(3, 9))
    scale = 10.0 ** draw(st.sampled_from([0, 0, 0, -12, 12, -160, 160, 300]))
    coordinates = st.sampled_from([0.0, 1.0, -1.0, 0.5, 2.0]) | st.floats(-3, 3, width=32)
    vertices = scale * np.array(draw(st.lists(st.tuples(*[coordinates] * 3), min_size=n, max_size=n)))
    vertices = vertices + draw(st.sampled_from([0.0, 0.0, 0.0, 1e9]))
    if draw(st.integers(0, 9)) == 0:
        vertices[draw(st.integers(0, n - 1)), draw(st.integers(0, 2))] = draw(
            st.sampled_from([np.nan, np.inf, -np.inf])
        )
    corner = st.integers(0, n - 1) if draw(st.integers(0, 4)) else st.integers(-2, n + 1)
    faces = np.array(draw(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=14)), np.int64)
    if draw(st.booleans()):
        with np.errstate(over="ignore"):
            vertices = vertices.astype(np.float32)
    return vertices, faces


@settings(
    max_examples=300, deadline=None, database=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
@given(soups())
def test_triangle_soups(soup):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "overflow", RuntimeWarning)  # where float64 becomes float32
        digest(soup)


@pytest.mark.slow
@settings(
    max_examples=2000, deadline=None, database=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
@given(soups())
def test_many_triangle_soups(soup):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "overflow", RuntimeWarning)
        digest(soup)


@settings(
    max_examples=60, deadline=None, database=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
@given(soups(), st.sets(st.sampled_from(STEPS)))
def test_any_choice_of_repairs(soup, steps):
    try:
        done = repair(soup, **dict.fromkeys(steps, True))
    except MeshError as error:
        assert str(error)
        return
    inside = (done.faces >= 0) & (done.faces < len(done.vertices))
    assert "drop_invalid" not in steps or inside.all()
    np.testing.assert_array_equal(done.vertices, soup[0][done.vertex_origins])


@pytest.mark.slow
def test_extreme_scales_and_places():
    """λ · area is the same at every scale whose areas a number can hold, and far from the origin."""
    mesh = shapes.ellipsoid(4)
    expected = np.asarray(jaxkvf.killing_fields(mesh, 4, solver=DenseEigh()).dimensionless)
    for scale in (1e-150, 1e-12, 1e12, 1e150):
        found = jaxkvf.killing_fields(mesh.with_vertices(scale * mesh.vertices), 4, solver=DenseEigh())
        np.testing.assert_allclose(found.dimensionless, expected, rtol=1e-9, atol=1e-9)
        assert np.isfinite(found.vectors).all()
    for scale in (1e-16, 1e-6, 1e6, 1e16):
        single = TriangleMesh.from_arrays(np.asarray(scale * mesh.vertices, np.float32), mesh.faces)
        found = jaxkvf.killing_fields(single, 4, solver=DenseEigh())
        assert found.vectors.dtype == jnp.float32
        np.testing.assert_allclose(found.dimensionless, expected, rtol=1e-3, atol=1e-2)
    with pytest.raises(MeshError, match="leave the range of float32; rescale the mesh"):
        TriangleMesh.from_arrays(np.asarray(1e20 * mesh.vertices, np.float32), mesh.faces)
    far = jaxkvf.killing_fields(mesh.with_vertices(mesh.vertices + 1e6), 4, solver=DenseEigh())
    np.testing.assert_allclose(far.dimensionless, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    "name", ["a b", "ü ☃", "new\nline", "50%", "-dash", "$(x)", "'quoted\"", "dots..obj"]
)
def test_paths_with_odd_characters(name, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = tmp_path / f"{name}.off"
    mesh = shapes.icosphere(1)
    mesh.save(path)
    np.testing.assert_array_equal(TriangleMesh.load(path).faces, mesh.faces)
    assert cli.main(["check", str(path)]) == 0
    path.write_text("nothing")
    with pytest.raises(MeshError) as refusal:
        TriangleMesh.load(path)
    assert name in str(refusal.value)


def test_writers_at_the_same_time_leave_one_whole_file(tmp_path):
    path = tmp_path / "mesh.ply"
    meshes = [shapes.icosphere(n) for n in (1, 2, 3)]
    meshes[0].save(path)
    sizes = {mesh.topology.n_vertices for mesh in meshes}
    failures: list[BaseException] = []

    def write(mesh: TriangleMesh) -> None:
        try:
            for _ in range(20):
                mesh.save(path)
                assert TriangleMesh.load(path).topology.n_vertices in sizes
        except BaseException as failure:
            failures.append(failure)

    threads = [threading.Thread(target=write, args=[mesh]) for mesh in meshes]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
    assert [file.name for file in tmp_path.iterdir()] == ["mesh.ply"]


def test_an_interrupted_write_leaves_nothing(tmp_path, monkeypatch):
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        shapes.icosphere(1).save(tmp_path / "mesh.obj")
    assert not list(tmp_path.iterdir())


def test_a_solve_too_large_for_memory_is_refused_before_it_begins(monkeypatch):
    monkeypatch.setattr("jaxkvf.memory.available_memory", lambda: 100_000)
    with pytest.raises(jaxkvf.MeshTooLargeError, match="162 vertices takes about"):
        jaxkvf.killing_fields(shapes.icosphere(4), 3)
