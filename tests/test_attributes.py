"""Colours, scalars and texture coordinates beside a mesh: written, read, carried through repairs, or named as lost."""

from pathlib import Path

import numpy as np
import pytest
from mesh_files import put

from jaxkvf import check, repair, shapes
from jaxkvf.mesh import Attributes, read_attributes, write_mesh


def colored() -> tuple[np.ndarray, np.ndarray, Attributes]:
    mesh, rng = shapes.icosphere(2), np.random.default_rng(0)
    v, f = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    vertex = {
        "color": rng.integers(0, 256, v.shape, np.uint8),
        "quality": rng.random(len(v)).astype(np.float32),
    }
    texture = rng.integers(0, 65, (len(f), 3, 2)) / 64
    return v, f, Attributes(vertex, {"color": rng.integers(0, 256, f.shape, np.uint8)}, texture)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off"])
def test_what_a_format_holds_reads_back(suffix: str, tmp_path: Path):
    v, f, given = colored()
    held, lost = given.held_by(suffix)
    path = tmp_path / f"a{suffix}"
    write_mesh(path, v, f, held)
    found = read_attributes(path)
    assert held.vertex.keys() == found.vertex.keys() and held.face.keys() == found.face.keys()
    for name, values in {**held.vertex}.items():
        np.testing.assert_array_equal(
            found.vertex[name][:, :3] if name == "color" else found.vertex[name], values
        )
    for name, values in held.face.items():
        np.testing.assert_array_equal(found.face[name], values)
    if held.texture is not None:
        np.testing.assert_array_equal(found.texture, held.texture)
    expected = {
        ".ply": (),
        ".obj": ("'quality' at vertices", "colours at faces"),
        ".off": ("'quality' at vertices", "texture coordinates"),
    }
    assert lost == expected[suffix]
    if lost:
        with pytest.raises(ValueError, match=r"the format holds no .*Attributes\.held_by"):
            write_mesh(path, v, f, given)


def test_they_survive_repairs(tmp_path: Path):
    v, f, given = colored()
    path = tmp_path / "a.ply"
    write_mesh(
        path,
        np.concatenate([[[9.0, 9, 9]], v]),
        f + 1,
        Attributes(
            {"color": np.concatenate([[[1, 2, 3]], given.vertex["color"]]).astype(np.uint8)},
            {},
            given.texture,
        ),
    )
    done = repair(path, drop_unreferenced=True)
    np.testing.assert_array_equal(done.attributes.vertex["color"], given.vertex["color"])
    np.testing.assert_array_equal(done.attributes.texture, given.texture)


def test_polygons_keep_their_texture_when_cut(tmp_path: Path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .5 .2 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt .5 .2\n"
    arrow = put(tmp_path, "arrow.obj", text + "f 1/1 5/5 2/2 3/3 -2/-2\n")  # not convex at its second corner
    assert check(arrow).errors[0].steps == {"triangulate": True}
    done = repair(arrow, triangulate=True)
    assert done.report.ok and len(done.faces) == 3
    np.testing.assert_array_equal(done.attributes.texture, done.vertices[done.faces][..., :2])
    normals = np.cross(*np.moveaxis(np.diff(done.vertices[done.faces], axis=1), 1, 0))[:, 2]
    assert (normals > 0).all() and normals.sum() / 2 == pytest.approx(0.9)


def test_strips_and_mixed_polygons_in_binary_ply(tmp_path: Path):
    corners = "".join(f"{x} {y} 0\n" for x in range(3) for y in (0, 1))
    head = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    strips = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    file = put(tmp_path, "strips.ply", head + strips + corners + "9 0 1 2 3 -1 2 3 4 5\n")
    done = repair(file, orient=True)
    assert done.report.ok and len(done.faces) == 4 and done.actions == ()
    body = np.array([[x, y, 0] for x in range(3) for y in (0, 1)], ">f4").tobytes()
    body += b"".join(
        np.array([len(face), *face], ">i4").tobytes() for face in ([0, 2, 3, 1], [2, 4, 5], [2, 5, 3])
    )
    faces = "element face 3\nproperty list int int vertex_indices\nend_header\n"
    header = (head + faces).replace("ascii", "binary_big_endian")
    mixed = put(tmp_path, "mixed.ply", header.encode() + body)
    assert repair(mixed, triangulate=True).actions == ("triangulated faces: 1",)


def test_stl_far_from_the_origin_is_refused_with_what_helps(tmp_path: Path):
    v, f, _ = colored()
    far = tmp_path / "far.obj"
    write_mesh(far, np.add(v, [512345.678, 4198765.432, 123.4]), f)
    moved = repair(far, to_origin=True)
    with pytest.raises(ValueError, match=r"would (merge|move|flatten) .*repair\(…, to_origin=True\)"):
        repair(far).mesh.save(tmp_path / "a.stl")
    moved.mesh.save(tmp_path / "a.stl")
    report = check(tmp_path / "a.stl")
    assert report.ok and report.n_vertices == 42
    assert any("single precision, rounded by up to" in note for note in report.notes)
    assert float(moved.mesh.area) == pytest.approx(float(shapes.icosphere(2).area), rel=1e-8)
