"""`check` lists what is wrong, `repair` mends what it is told to and says so."""

import numpy as np
import pytest

import jaxkvf
from jaxkvf import MeshError, TriangleMesh, check, repair, shapes

EVERYTHING = dict.fromkeys(
    (
        "drop_invalid",
        "merge_duplicates",
        "drop_degenerate",
        "drop_duplicate_faces",
        "split_nonmanifold",
        "orient",
        "drop_unreferenced",
    ),
    True,
)


def arrays(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    return np.array(mesh.vertices), np.array(mesh.faces)


def sphere() -> tuple[np.ndarray, np.ndarray]:
    return arrays(shapes.icosphere(3))


def moebius(n: int) -> tuple[np.ndarray, np.ndarray]:
    t = 2 * np.pi * np.arange(n) / n
    across = np.stack([np.cos(t / 2) * np.cos(t), np.cos(t / 2) * np.sin(t), np.sin(t / 2)], axis=1)
    middle = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    i = np.arange(n)
    low, high = i, i + n
    next_low = np.where(i == n - 1, n, i + 1)
    next_high = np.where(i == n - 1, 0, i + 1 + n)
    faces = np.concatenate([np.stack([low, next_low, high], 1), np.stack([next_low, next_high, high], 1)])
    return np.concatenate([middle - 0.3 * across, middle + 0.3 * across]), faces


def broken(name: str) -> tuple[np.ndarray, np.ndarray]:
    """A sphere, broken in one way."""
    v, f = sphere()
    n = len(v)
    match name:
        case "not finite":
            v[5, 1] = np.nan
        case "out of range":
            f[7, 2] = n + 40
        case "repeated corner":
            f = np.concatenate([f, [[3, 3, 4]]])
        case "zero area":
            a, b, c = f[0]
            v = np.concatenate([v, [(v[a] + v[b]) / 2]])
            f = np.concatenate([f[1:], [[a, n, c], [n, b, c], [a, b, n]]])
        case "unreferenced":
            v = np.concatenate([v, [[9.0, 9, 9]]])
        case "fin":
            a, b = f[0, :2]
            v = np.concatenate([v, [3 * v[a]]])
            f = np.concatenate([f, [[a, b, n]]])
        case "touching":
            v = np.concatenate([v, 3 * v[1:] - 2 * v[0]])
            f = np.concatenate([f, np.where(f > 0, f + n - 1, 0)])
        case "turned":
            f[[4, 9, 30]] = f[[4, 9, 30], ::-1]
        case "soup":
            v, f = v[f.ravel()], np.arange(f.size).reshape(-1, 3)
        case "twice":
            f = np.concatenate([f, f[3:4, ::-1]])
    return v, f


BROKEN = {
    "not finite": ("positions that are not finite", (5,), "drop_invalid"),
    "out of range": ("faces with a corner that is no vertex", (7,), "drop_invalid"),
    "repeated corner": ("faces with a repeated corner", (180,), "drop_degenerate"),
    "zero area": ("faces of zero area", (181,), "drop_degenerate"),
    "unreferenced": ("unreferenced vertices", (92,), "drop_unreferenced"),
    "fin": ("edges of more than two faces", None, "split_nonmanifold"),
    "touching": ("vertices where sheets touch", (0,), "split_nonmanifold"),
    "turned": ("faces that look the other way", (4, 9, 30), "orient"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_wrong_is_listed_refused_and_mended_on_request(name):
    kind, first, remedy = BROKEN[name]
    mesh = broken(name)
    report = check(mesh)
    finding = next(f for f in report.errors if f.kind == kind)
    assert first is None or finding.first == first
    assert f"{remedy}=True" in finding.remedy and str(finding) in str(report)
    with pytest.raises(MeshError):
        TriangleMesh.from_arrays(*mesh)

    untouched = repair(mesh)
    assert untouched.actions == ()
    np.testing.assert_array_equal(untouched.faces, mesh[1])
    np.testing.assert_array_equal(untouched.vertices, mesh[0])
    with pytest.raises(MeshError):
        _ = untouched.mesh

    mended = repair(mesh, **{remedy: True})
    assert kind not in [f.kind for f in mended.report.errors]
    assert mended.actions
    np.testing.assert_array_equal(mended.vertices, mesh[0][mended.vertex_origins])
    whole = repair(mesh, **EVERYTHING)
    assert whole.report.ok
    assert check(whole.mesh).ok


def test_a_sound_mesh_is_left_alone():
    mesh = shapes.icosphere(3)
    report = check(mesh)
    assert report.ok and report.remarks == () and "can be used" in str(report)
    same = repair(mesh, **EVERYTHING)
    assert same.actions == ()
    np.testing.assert_array_equal(same.vertices, mesh.vertices)
    np.testing.assert_array_equal(same.faces, mesh.faces)


def test_soup_becomes_the_surface_again():
    soup = broken("soup")
    report = check(soup)
    remarks = {f.kind: f.count for f in report.remarks}
    assert report.ok  # 180 separate triangles
    assert remarks["components"] == 180 and remarks["boundary edges"] == 540
    assert remarks["vertices at the position of another"] == 540 - 92
    merged = repair(soup, merge_duplicates=True)
    assert merged.actions == ("merged vertices: 448",)
    assert merged.mesh.topology.euler_characteristic == 2
    np.testing.assert_array_equal(merged.vertices[merged.faces], soup[0][soup[1]])

    shaken = soup[0] + 1e-9 * np.random.default_rng(0).standard_normal(soup[0].shape)
    assert repair((shaken, soup[1]), merge_duplicates=True).actions == ()
    assert repair((shaken, soup[1]), merge_duplicates=1e-6).mesh.topology.euler_characteristic == 2


def test_splitting_keeps_the_faces_where_they_are():
    for name in ("fin", "touching"):
        mesh = broken(name)
        split = repair(mesh, split_nonmanifold=True)
        np.testing.assert_array_equal(split.vertices[split.faces], mesh[0][mesh[1]])
        count, _ = split.mesh.topology.components()
        assert count == 2


def test_orientation_follows_the_majority_of_each_piece():
    v, f = arrays(shapes.disk(4))
    both = np.concatenate([v, v + 5]), np.concatenate([f, f[:, ::-1] + len(v)])
    turned, some = both[1].copy(), [2, len(f) + 3, len(f) + 9]
    turned[some] = turned[some, ::-1]
    mended = repair((both[0], turned), orient=True)
    assert mended.actions == ("turned faces over: 3",)
    heights = np.cross(*np.moveaxis(np.diff(mended.vertices[mended.faces], axis=1), 1, 0))[:, 2]
    assert (heights.reshape(2, -1) * [[1], [-1]] > 0).all()


def test_a_one_sided_surface_has_no_remedy():
    mesh = moebius(12)
    report = check(mesh)
    assert [f.kind for f in report.errors] == ["faces on one-sided pieces"]
    assert repair(mesh, orient=True).actions == ()
    with pytest.raises(MeshError, match="non-orientable"):
        _ = repair(mesh, **EVERYTHING).mesh


def test_steps_that_cannot_be_done_say_what_to_add():
    with pytest.raises(MeshError, match="drop_invalid=True"):
        repair(broken("out of range"), orient=True)
    with pytest.raises(MeshError, match="drop_degenerate=True"):
        repair(broken("repeated corner"), split_nonmanifold=True)
    with pytest.raises(MeshError, match="no face is left"):
        repair((np.zeros((3, 3)), np.array([[0, 1, 2]])), drop_degenerate=True)
    with pytest.raises(ValueError, match="merge_duplicates"):
        repair(sphere(), merge_duplicates=-1.0)


def test_remarks_name_thin_faces_and_distance():
    needle = shapes.ellipsoid(4, (1.0, 1.0, 300.0))
    kinds = [f.kind for f in check(needle).remarks]
    assert "edges that are not Delaunay" in kinds and "faces with an angle below 1°" in kinds
    far = check(shapes.icosphere(2).with_vertices(shapes.icosphere(2).vertices + 1e8))
    assert "mesh far from the origin" in [f.kind for f in far.remarks]


def test_files_are_checked_as_they_are(tmp_path):
    file = tmp_path / "mesh.off"
    file.write_text("OFF\n4 3 0\n0 0 0\n1 0 0\n0 1 0\n0 0 nan\n3 0 1 2\n3 0 1 7\n3 1 1 2\n")
    assert {f.kind for f in check(file).errors} == {
        "positions that are not finite",
        "faces with a corner that is no vertex",
        "faces with a repeated corner",
        "unreferenced vertices",
    }
    mended = repair(file, **EVERYTHING)
    assert mended.faces.tolist() == [[0, 1, 2]] and len(mended.vertices) == 3
    file.write_text("no mesh")
    assert [f.kind for f in check(file).errors] == ["unreadable mesh"]
    with pytest.raises(FileNotFoundError):
        check(tmp_path / "missing.obj")


def test_what_memory_will_not_hold_is_refused_with_the_estimate(tmp_path, monkeypatch):
    file = tmp_path / "mesh.obj"
    shapes.icosphere(2).save(file)
    monkeypatch.setattr("jaxkvf.memory.available_memory", lambda: 10_000)
    with pytest.raises(jaxkvf.MeshTooLargeError, match=r"reading .* takes about .* GiB of memory") as refusal:
        TriangleMesh.load(file)
    assert isinstance(refusal.value, MemoryError) and isinstance(refusal.value, MeshError)
