"""Mesh files: what is read is what stands in the file, and a bad file is named with what is wrong in it."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_files import CORNERS, FACES, OFF, STL, F, V, binary_stl, ply, put

from jaxkvf import MeshError
from jaxkvf.mesh import _io
from jaxkvf.mesh._io import read_mesh

LITTLE, BIG = "binary_little_endian", "binary_big_endian"
SAME_MESH = {
    "plain.obj": V + F,
    "UPPER.OBJ": V + F,
    "crlf.obj": (V + F).replace("\n", "\r\n"),
    "cr.obj": (V + F).replace("\n", "\r"),
    "byte_order_mark.obj": b"\xef\xbb\xbf" + (V + F).encode(),
    "negative.obj": V + "f -4 -2 -3\nf -4 -3 -1\nf -3 -2 -1\nf -2 -4 -1\n",
    "slashes.obj": V
    + "vt 0 0\nvt 1 0\nvn 0 0 1\nf 1/1/1 3/2/1 2/1/1\nf 1//1 2//1 4//1\nf 2/2 3/1 4/2\nf 3/ 1/ 4/\n",
    "other_statements.obj": "mtllib a.mtl\no thing\ng part\n"
    + V
    + "usemtl a#b\ns off\n"
    + F
    + "l 1 2\np 1\n",
    "comments.obj": "# v 9 9 9\n" + V.replace("\n", " # here\n") + "\n\n" + F.replace("\n", "# there\n"),
    "continued.obj": (V + F).replace("v 1 0 0", "v 1 \\\n 0 0").replace("f 1 3 2", "f 1 \\\r\n 3 2"),
    "colours.obj": V.replace("\n", " 0.5 0.5 0.5\n") + F,
    "indented.obj": (V + F).replace("\n", "  \n\t").replace(" 0", "\t0"),
    "faces_first.obj": F + V,
    "long_comment.obj": "#" + 5000 * " v 1 2 3" + "\n" + V + F,
    "white space ünï.obj": V + F,
    "plain.off": OFF,
    "crlf.off": OFF.replace("\n", "\r\n"),
    "one_line.off": OFF.replace("OFF\n", "OFF "),
    "no_edges.off": OFF.replace("4 4 6", "4 4"),
    "comments.off": OFF.replace("\n", " # c\n\n"),
    "colours.off": OFF.replace("OFF", "COFF")
    .replace("1 0 0\n", "1 0 0 255 0 0 255\n")
    .replace("0 2 1\n", "0 2 1 9\n"),
    "ascii.ply": ply(),
    "crlf.ply": ply().replace(b"\n", b"\r\n"),
    "double.ply": ply(LITTLE),
    "big.ply": ply(BIG),
    "unsigned.ply": ply(LITTLE, index="uint", count="int"),
    "short.ply": ply(BIG, index="short"),
    "vertex_index.ply": ply(LITTLE).replace(b"vertex_indices", b"vertex_index"),
    "ascii.stl": STL,
    "crlf.stl": STL.replace("\n", "\r\n"),
    "upper.stl": STL.upper(),
    "indented.stl": STL.replace("\n", "\n   "),
    "two_solids.stl": STL.replace("facet normal", "endsolid t\nsolid u\nfacet normal", 2).replace(
        "endsolid t\n", "", 1
    ),
}


@pytest.mark.parametrize("name", SAME_MESH)
def test_the_ways_of_writing_one_mesh(name: str, tmp_path: Path):
    vertices, faces = read_mesh(put(tmp_path, name, SAME_MESH[name]))
    assert vertices.dtype == np.float64
    assert faces.dtype == np.int32
    assert vertices[faces].tolist() == [[list(CORNERS[i]) for i in face] for face in FACES]
    if not name.endswith(".stl"):  # whose vertices stand in order of first appearance
        assert vertices.tolist() == [list(corner) for corner in CORNERS]


def test_negative_numbers_count_back_from_the_face(tmp_path: Path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nf -4 -3 -1\n"
    assert read_mesh(put(tmp_path, "a.obj", text))[1].tolist() == [[0, 1, 2], [0, 1, 3]]


def test_a_statement_may_go_on_over_several_lines(tmp_path: Path):
    path = tmp_path / "mesh.obj"
    path.write_bytes((V + "f 1 \\\n 3 \\\r\n 2\n" + F.partition("\n")[2] + "f 1 2 x\n").encode())
    with pytest.raises(MeshError, match="line 11: 'f 1 2 x'"):
        read_mesh(path)
    path.write_bytes((V + "f 1 \\\n 3 \\\r\n 2\n" + F.partition("\n")[2]).encode())
    np.testing.assert_array_equal(read_mesh(path)[1], FACES)


def test_float32_is_read_as_the_same_numbers(tmp_path: Path):
    for name, content in {
        "a.ply": ply(LITTLE, scalar="float"),
        "b.ply": ply(BIG, scalar="float"),
        "c.stl": binary_stl(),
    }.items():
        vertices, faces = read_mesh(put(tmp_path, name, content))
        expected = np.float32(CORNERS).astype(np.float64)
        assert np.array_equal(vertices[faces], expected[np.array(FACES)])


def test_binary_stl_may_begin_like_ascii(tmp_path: Path):
    path = put(tmp_path, "a.stl", binary_stl(head=b"solid made by a program"))
    assert len(read_mesh(path)[0]) == 4


def test_stl_merges_equal_corners_and_no_others(tmp_path: Path):
    near = float(np.nextafter(1.0, 2.0))
    text = STL.replace("vertex 1.0 0.0 0.0", "vertex 1.0 -0.0 0.0", 1)
    assert len(read_mesh(put(tmp_path, "zero.stl", text))[0]) == 4
    text = STL.replace("vertex 1.0 0.0 0.0", f"vertex {near!r} 0.0 0.0", 1)
    assert len(read_mesh(put(tmp_path, "near.stl", text))[0]) == 5


def test_unreferenced_vertices_and_repeated_positions_stay(tmp_path: Path):
    vertices, faces = read_mesh(put(tmp_path, "a.obj", "v 0 0 0\nv 0 0 0\n" + V + "f 3 4 5\n"))
    assert len(vertices) == 6
    assert faces.tolist() == [[2, 3, 4]]


def test_ply_properties_beside_the_mesh(tmp_path: Path):
    head = (
        "ply\nformat {} 1.0\nobj_info x\nelement camera 1\nproperty float a\nelement vertex 3\nproperty uchar red\n"
        "property float x\nproperty float y\nproperty float nx\nproperty float z\nelement face 1\nproperty uchar flag\n"
        "property list uchar int vertex_indices\nproperty list uchar float texcoord\nelement edge 1\n"
        "property int vertex1\nend_header\n"
    )
    rows = [(9, 0, 0, 7, 0), (9, 1, 0, 7, 0), (9, 0, 1, 7, 0)]
    ascii_body = "5\n" + "".join("{} {} {} {} {}\n".format(*row) for row in rows) + "8 3 0 1 2 2 0.5 0.5\n0\n"
    body = struct.pack("<f", 5) + b"".join(struct.pack("<B4f", *row) for row in rows)
    body += struct.pack("<BB3iB2fi", 8, 3, 0, 1, 2, 2, 0.5, 0.5, 0)
    for name, content in {
        "a.ply": (head.format("ascii") + ascii_body).encode(),
        "b.ply": head.format(LITTLE).encode() + body,
    }.items():
        vertices, faces = read_mesh(put(tmp_path, name, content))
        assert vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
        assert faces.tolist() == [[0, 1, 2]]


TRUNCATED = "truncated or damaged"
BAD = {
    "quad.obj": (
        V + "f 1 3 2\nf 1 2 3 4\nf 1 2 3 4\n",
        r"line 6: 'f 1 2 3 4' is a face with 4 corners.*2 of the 3.*triangulate",
    ),
    "pair.obj": (V + "f 1 3 2\nf 1 2", r"line 6: 'f 1 2' is a face with 2 corners"),
    "empty.obj": ("", "no vertices"),
    "no_faces.obj": (V, "no faces"),
    "no_vertices.obj": (F, r"line 1: 'f 1 3 2' names a vertex that does not exist; the file has 0 vertices"),
    "short.obj": ("v 0 0 0\nv 1 0\n" + F, r"line 2: 'v 1 0', expected a vertex with three coordinates"),
    "word.obj": (V.replace("1 0 0", "one 0 0") + F, r"line 2: 'v one 0 0', expected a vertex"),
    "comma.obj": (V.replace("0.1", "0,1") + F, r"line 4: 'v 0 0,1 1', expected a vertex"),
    "nan.obj": (V.replace("1 0 0", "nan 0 0") + F, r"vertex 1 \(counted from 0\) is not finite"),
    "infinite.obj": (
        V.replace("1 0 0", "1e999 0 0") + F,
        r"vertex 1 \(counted from 0\) is not finite: \[inf, 0.0, 0.0\]",
    ),
    "beyond.obj": (
        V + F + "f 1 2 5\n",
        r"line 9: 'f 1 2 5' names a vertex that does not exist.*4 vertices, numbered from 1",
    ),
    "zero.obj": (V + "f 0 1 2\n", r"line 5: 'f 0 1 2' names a vertex that does not exist"),
    "before.obj": (V + "f -5 1 2\n", r"line 5: 'f -5 1 2' names a vertex that does not exist"),
    "wraps.obj": (V + "f 1 2 4294967299\n", "line 5: 'f 1 2 4294967299' names a vertex that does not exist"),
    "huge.obj": (V + "f 1 2 99999999999999999999999\n", r"line 5: .*, expected a triangle"),
    "fraction.obj": (V + "f 1.5 2 3\n", r"line 5: 'f 1.5 2 3', expected a triangle"),
    "letters.obj": (V + "f a b c\n", r"line 5: 'f a b c', expected a triangle"),
    "unknown.obj": (V + "w 1 2 3\n" + F, r"line 5 is no OBJ statement: 'w 1 2 3'"),
    "garbage.obj": (bytes(range(1, 256)) * 9, "line 1 is no OBJ statement"),
    "empty.off": ("", "the file is empty"),
    "no_keyword.off": (OFF[4:], r"line 1: '4 4 6': an OFF file starts with the word OFF"),
    "four_dimensional.off": (OFF.replace("OFF", "4OFF"), "starts with the word OFF"),
    "binary.off": (b"OFF BINARY\n\0\0\0\4", "binary OFF is not read; save the mesh as ASCII"),
    "no_counts.off": ("OFF\n", "expected the numbers of vertices, faces and edges after OFF"),
    "negative_count.off": (
        OFF.replace("4 4 6", "-4 4 6"),
        "expected the numbers of vertices, faces and edges",
    ),
    "huge_count.off": (OFF.replace("4 4 6", "4000000000000 4 6"), TRUNCATED),
    "truncated.off": (OFF[:60], TRUNCATED),
    "too_long.off": (OFF + "3 0 1 2\n", TRUNCATED),
    "quad.off": (
        OFF.replace("3 2 0 3", "4 2 0 3 1"),
        r"line 10: '4 2 0 3 1' is a face with 4 corners.*triangulate",
    ),
    "short.off": (OFF.replace("0 1 0", "0 1"), r"line 5: '0 1', expected a vertex"),
    "beyond.off": (
        OFF.replace("3 2 0 3", "3 2 0 4"),
        r"face 3 \(counted from 0\) has corners \[2, 0, 4\].* from 0 to 3",
    ),
    "garbage.off": (bytes(range(1, 256)) * 9, "starts with the word OFF"),
    "empty.ply": (b"", "the file is empty"),
    "garbage.ply": (bytes(range(1, 256)) * 9, "starts with the line 'ply'"),
    "header.ply": (ply(LITTLE)[:100], "no 'end_header'"),
    "type.ply": (
        ply().replace(b"double y", b"quaternion y"),
        "a line that PLY does not know: 'property quaternion y'",
    ),
    "count.ply": (ply(n_vertices=-4), "a line that PLY does not know: 'element vertex -4'"),
    "float_count.ply": (
        ply().replace(b"list uchar", b"list float"),
        "does not know: 'property list float int",
    ),
    "no_format.ply": (ply().replace(b"format ascii 1.0\n", b""), "no line 'format ascii 1.0'"),
    "no_x.ply": (ply().replace(b"double x", b"double u"), "no coordinate 'x'"),
    "twice.ply": (ply().replace(b"double y", b"double x"), "declares a property of element 'vertex' twice"),
    "float_corners.ply": (
        ply().replace(b"uchar int", b"uchar float"),
        "no list 'vertex_indices' of integers",
    ),
    "points.ply": (ply().replace(b"element face", b"element strip"), "no element 'face'"),
    "no_faces.ply": (ply(LITTLE, faces=[]), "no faces"),
    "no_vertices.ply": (ply(LITTLE, corners=[], faces=[]), "no vertices"),
    "quad.ply": (
        ply(LITTLE, faces=[(0, 1, 2), (0, 1, 2, 3), (1, 2, 3)]),
        r"face 1 \(counted from 0\) has 4 corners.*triangulate",
    ),
    "ascii_quad.ply": (
        ply(faces=[(0, 1, 2), (0, 1, 2, 3)]),
        r"line 16: '4 0 1 2 3' is a face with 4 corners",
    ),
    "list_length.ply": (
        ply().replace(b"3 2 0 3", b"200 2 0 3"),
        r"line 18: '200 2 0 3', expected 200 corners of a face",
    ),
    "truncated.ply": (
        ply(LITTLE)[:-15],
        f"4 records of element 'face', the data ends after 2: .*{TRUNCATED}",
    ),
    "truncated_vertices.ply": (
        ply(LITTLE)[:-80],
        f"4 records of element 'vertex', the data ends after 2: .*{TRUNCATED}",
    ),
    "truncated_ascii.ply": (ply()[:-12], f"promises 8 lines of data, 7 follow it: .*{TRUNCATED}"),
    "huge.ply": (ply(LITTLE, n_vertices=2000000000), f"2000000000 records of element 'vertex'.*{TRUNCATED}"),
    "huge_faces.ply": (ply(BIG, n_faces=2000000000), f"2000000000 records of element 'face'.*{TRUNCATED}"),
    "too_long.ply": (ply(LITTLE) + b"more", "4 bytes follow the last 'face'"),
    "word.ply": (ply().replace(b"0.1", b"abc"), r"line 14: '0.0 abc 1.0', expected a vertex"),
    "nan.ply": (ply(LITTLE, corners=[(float("nan"), 0, 0), *CORNERS[1:]]), "vertex 0 .* is not finite"),
    "beyond.ply": (ply(BIG, faces=[(0, 1, 4)]), r"face 0 \(counted from 0\) has corners \[0, 1, 4\]"),
    "before.ply": (ply(BIG, faces=[(0, 1, -1)]), r"face 0 \(counted from 0\) has corners \[0, 1, -1\]"),
    "list_first.ply": (
        ply().replace(b"property list", b"property list uchar int tags\nproperty list"),
        "has the list 'tags' before 'vertex_indices'",
    ),
    "ragged_list.ply": (
        b"ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
        b"property list uchar uchar tags\nelement face 1\nproperty list uchar int vertex_index\nend_header\n"
        + struct.pack("<3fBB3fBBB", 0, 0, 0, 1, 1, 0, 0, 0, 2, 1, 1),
        f"1 records of element 'face', the data ends after 0: .*{TRUNCATED}",
    ),
    "empty.stl": ("", "the file is empty"),
    "garbage.stl": (
        bytes(range(1, 256)) * 9,
        "neither ASCII STL, which starts with 'solid', nor complete binary STL",
    ),
    "truncated.stl": (binary_stl()[:-30], "promises 4 faces in 284 bytes, the file has 254"),
    "truncated_ascii.stl": (STL[:200], "the file ends at line 14 without 'endsolid': it is truncated"),
    "cut.stl": (
        STL.replace("endfacet\nendsolid", "endsolid"),
        "the last face, up to line 28, has no 'endfacet'",
    ),
    "no_faces.stl": (binary_stl([]), "no vertices"),
    "quad.stl": (
        STL.replace("endloop", "vertex 1 1 1\nendloop", 1),
        "line 7: 'vertex 1 1 1', expected 'endloop': only triangles",
    ),
    "word.stl": (STL.replace("1.0 0.0 0.0", "one 0 0", 1), "line 6: 'vertex one 0 0', expected a vertex"),
    "nan.stl": (STL.replace("1.0 0.0 0.0", "nan 0 0"), "vertex 2 .* is not finite"),
    "thing.xyz": (V, r"the ending '.xyz' is no known mesh format; known are .obj, .ply, .off, .stl"),
    "thing": (V, "a file without an ending is no known mesh format"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_content_is_named(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    content, message = BAD[name]
    path = put(tmp_path, name, content)
    with pytest.raises(MeshError, match=re.escape(str(path)) + ": .*" + message):
        read_mesh(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", ["obj", "ply", "off", "stl"])
def test_files_that_cannot_be_read(suffix: str, tmp_path: Path):
    missing = tmp_path / f"missing.{suffix}"
    with pytest.raises(FileNotFoundError, match=re.escape(str(missing))):
        read_mesh(missing)
    folder = tmp_path / f"folder.{suffix}"
    folder.mkdir()
    with pytest.raises(IsADirectoryError, match=re.escape(str(folder))):
        read_mesh(str(folder))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_damaged_bytes_never_do_worse_than_mesh_error(data: st.DataObject):
    suffix, content = data.draw(
        st.sampled_from(
            [
                (".obj", V + F),
                (".off", OFF),
                (".ply", ply()),
                (".ply", ply(BIG)),
                (".stl", STL),
                (".stl", binary_stl()),
            ]
        )
    )
    damaged = bytearray(content.encode() if isinstance(content, str) else content)
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(damaged)))
        length = data.draw(st.integers(0, 4))
        damaged[at : at + length] = data.draw(
            st.binary(max_size=4)
            | st.sampled_from([b"nan", b"-1", b"\n", b"99999999999999999999", b"\\\n", b"\0\xff"])
        )
    try:
        raw = _io._files._DECODERS[suffix](bytes(damaged))
    except MeshError:
        return
    assert raw.vertices.shape[1:] == (3,)
    assert raw.polygons.sizes.sum() == len(raw.polygons.corners) and raw.polygons.sizes.min(initial=0) >= 0
    raw.attributes()
