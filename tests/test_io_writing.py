"""Mesh files: what is written is there whole, and reads back as the same mesh; real files are read as libigl does."""

import errno
import os
from pathlib import Path

import igl
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mesh_files import CORNERS, FACES, names, put

from jaxkvf import MeshError, TriangleMesh
from jaxkvf.mesh import shapes
from jaxkvf.mesh._io import read_mesh, write_mesh


@pytest.mark.parametrize("suffix", [".obj", ".OFF", ".ply"])
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(vertices=arrays(np.float64, (4, 3), elements=st.floats(allow_nan=False, allow_infinity=False)))
def test_doubles_survive_to_the_last_bit(suffix: str, tmp_path: Path, vertices: np.ndarray):
    path = tmp_path / f"a{suffix}"
    write_mesh(path, vertices, np.array(FACES))
    read_vertices, read_faces = read_mesh(path)
    assert read_vertices.tobytes() == vertices.tobytes()
    assert np.array_equal(read_faces, FACES)


def test_stl_rounds_to_float32(tmp_path: Path):
    mesh = shapes.icosphere(4)
    mesh.save(tmp_path / "a.stl")
    vertices, faces = read_mesh(tmp_path / "a.stl")
    expected = np.asarray(mesh.vertices).astype(np.float32)[np.asarray(mesh.faces)]
    assert np.array_equal(vertices[faces], expected.astype(np.float64))
    with pytest.raises(ValueError, match="beyond its range"):
        write_mesh(tmp_path / "b.stl", 1e300 * vertices, faces)
    assert names(tmp_path) == ["a.stl"]


def test_libigl_reads_what_we_write(tmp_path: Path):
    mesh = shapes.vase(20)
    for suffix in ("obj", "ply", "off"):
        path = tmp_path / f"a.{suffix}"
        mesh.save(path)
        vertices, faces = igl.read_triangle_mesh(path)
        assert np.array_equal(vertices, np.asarray(mesh.vertices))
        assert np.array_equal(faces, np.asarray(mesh.faces))
    mesh.save(tmp_path / "a.stl")
    corners, triangles, normals = igl.readSTL(str(tmp_path / "a.stl"))
    assert np.allclose(corners[triangles], np.asarray(mesh.vertices)[np.asarray(mesh.faces)], atol=1e-6)
    edges = np.diff(corners[triangles], axis=1)
    across = np.cross(edges[:, 0], edges[:, 1])
    assert np.allclose(normals, across / np.linalg.norm(across, axis=1, keepdims=True), atol=1e-4)


def test_writing_replaces_in_one_step_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "a.obj"
    shapes.icosphere(1).save(str(path))
    before = path.read_bytes()
    assert names(tmp_path) == ["a.obj"]
    assert path.stat().st_mode & 0o777 == put(tmp_path, "b", "").stat().st_mode & 0o777
    (tmp_path / "b").unlink()

    def disk_full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "replace", disk_full)
    with pytest.raises(OSError, match="No space left"):
        shapes.icosphere(2).save(path)
    assert path.read_bytes() == before
    assert names(tmp_path) == ["a.obj"]


def test_writing_goes_through_a_symbolic_link(tmp_path: Path):
    (tmp_path / "to").mkdir()
    link = tmp_path / "link.ply"
    link.symlink_to(tmp_path / "to" / "a.ply")
    shapes.icosphere(1).save(link)
    assert link.is_symlink()
    assert len(read_mesh(tmp_path / "to" / "a.ply")[0]) == 12


def test_places_where_nothing_can_be_written(tmp_path: Path):
    mesh = shapes.icosphere(1)
    with pytest.raises(
        FileNotFoundError, match=r"a\.obj: the folder .*nowhere does not exist; create it first"
    ):
        mesh.save(tmp_path / "nowhere" / "a.obj")
    (tmp_path / "folder.obj").mkdir()
    with pytest.raises(IsADirectoryError, match=r"folder\.obj: it is a folder"):
        mesh.save(tmp_path / "folder.obj")
    with pytest.raises(ValueError, match=r"a\.gltf: the ending '\.gltf' is no known mesh format"):
        mesh.save(tmp_path / "a.gltf")
    assert names(tmp_path) == ["folder.obj"]


def test_nothing_is_written_that_could_not_be_read(tmp_path: Path):
    vertices, faces = np.array(CORNERS), np.array(FACES)
    with pytest.raises(MeshError, match=r"vertex 2 \(counted from 0\) is not finite"):
        write_mesh(tmp_path / "a.obj", np.where(np.arange(4)[:, None] == 2, np.nan, vertices), faces)
    with pytest.raises(MeshError, match=r"face 1 .* has corners"):
        write_mesh(tmp_path / "a.ply", vertices, np.where(faces == 3, np.arange(4)[:, None] + 3, faces))
    with pytest.raises(MeshError, match="there are no faces"):
        write_mesh(tmp_path / "a.off", vertices, faces[:0])
    assert names(tmp_path) == []


def test_triangle_mesh_loads_what_it_saved(tmp_path: Path):
    mesh = shapes.add_normal_noise(shapes.torus(12, 8), 0.1, seed=3)
    for suffix in ("obj", "ply", "off"):
        path = tmp_path / f"white space.{suffix}"
        mesh.save(path)
        loaded = TriangleMesh.load(path)
        assert np.array_equal(loaded.vertices, mesh.vertices)
        assert np.array_equal(loaded.faces, mesh.faces)


def test_real_meshes_are_read_as_libigl_reads_them(real_mesh_folder: Path):
    for path in sorted(real_mesh_folder.glob("*.obj")):
        vertices, faces = read_mesh(path)
        expected_vertices, expected_faces = igl.read_triangle_mesh(path)
        assert np.array_equal(vertices, expected_vertices), path
        assert np.array_equal(faces, expected_faces), path


def test_texture_seams_split_no_vertex(real_mesh_folder: Path):
    content = (real_mesh_folder / "boat.obj").read_bytes().split(b"\n")
    n_vertices = sum(line.startswith(b"v ") for line in content)
    assert sum(line.startswith(b"vt ") for line in content) > n_vertices
    assert len(read_mesh(real_mesh_folder / "boat.obj")[0]) == n_vertices
