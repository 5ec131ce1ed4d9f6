"""One small mesh in the ways that files have of writing it."""

import struct
from pathlib import Path

CORNERS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.1, 1.0)]
FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]

V = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0.1 1\n"
F = "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
OFF = "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0.1 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"
STL = (
    "solid t\n"
    + "".join(
        "facet normal 0 0 1\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*CORNERS[i]) for i in face)
        + "endloop\nendfacet\n"
        for face in FACES
    )
    + "endsolid t\n"
)


def ply(
    order="ascii", *, scalar="double", index="int", count="uchar", faces=FACES, corners=CORNERS, **header
) -> bytes:
    """A PLY file; `header` overrides what it says about the numbers of vertices and faces."""
    n_vertices, n_faces = header.get("n_vertices", len(corners)), header.get("n_faces", len(faces))
    text = (
        f"ply\nformat {order} 1.0\ncomment made by a test\nelement vertex {n_vertices}\n"
        f"property {scalar} x\nproperty {scalar} y\nproperty {scalar} z\n"
        f"element face {n_faces}\nproperty list {count} {index} vertex_indices\nend_header\n"
    ).encode()
    if order == "ascii":
        rows = [*corners, *((len(face), *face) for face in faces)]
        return text + "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
    sign = "<" if "little" in order else ">"
    code = {"uchar": "B", "short": "h", "int": "i", "uint": "I", "float": "f", "double": "d"}
    body = b"".join(struct.pack(sign + "3" + code[scalar], *corner) for corner in corners)
    return (
        text
        + body
        + b"".join(
            struct.pack(f"{sign}{code[count]}{len(face)}{code[index]}", len(face), *face) for face in faces
        )
    )


def binary_stl(faces=FACES, head=b"", count=None) -> bytes:
    triangles = [[x for i in face for x in CORNERS[i]] for face in faces]
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *numbers, 0) for numbers in triangles)
    return head.ljust(80, b"\0") + struct.pack("<I", len(faces) if count is None else count) + body


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def put(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path
