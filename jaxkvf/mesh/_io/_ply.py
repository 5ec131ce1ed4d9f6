"""Polygon File Format, PLY: ASCII and binary."""

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Integer

from .._errors import MeshError
from ._attributes import COLOR, NO_ATTRIBUTES, Attributes
from ._text import positions, quoted, significant_lines, triangles

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_NAMES_OF_TYPES = {code: name for name, code in reversed(_TYPES.items())} | {"b1": "uchar"}
_CHANNELS = ("red", "green", "blue", "alpha")
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_CORNERS = ("vertex_indices", "vertex_index")


class _Property(NamedTuple):
    name: str
    type: str
    count_type: str | None
    """Type of the number that stands before a list; None for a scalar."""


class _Element(NamedTuple):
    name: str
    n_records: int
    properties: list[_Property]


def decode_ply(data: bytes) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
    """The `x y z` of a PLY file's vertices and the corners of its faces; other properties are not read.

    Raises:
        MeshError: a damaged header, fewer or more data than it promises, no vertices or faces, or a face that
            is not a triangle.
    """
    byte_order, elements, start = _read_header(data)
    needed = {element.name: element for element in elements}
    for name in ("vertex", "face"):
        if name not in needed:
            raise MeshError(f"the header declares no element '{name}': this is not a triangle mesh")
    for axis in "xyz":
        if axis not in [p.name for p in needed["vertex"].properties if p.count_type is None]:
            raise MeshError(f"the header declares no coordinate '{axis}' of the vertices")
    if not any(p.name in _CORNERS and p.count_type and p.type[0] in "iu" for p in needed["face"].properties):
        raise MeshError("the header declares no list 'vertex_indices' of integers for the faces")
    if byte_order:
        return _decode_binary(data[start:], elements, byte_order)
    return _decode_ascii(data[start:], elements, header_lines=len(data[:start].splitlines()))


def encode_ply(
    vertices: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"], attributes: Attributes = NO_ATTRIBUTES
) -> bytes:
    """Binary PLY with double coordinates; colours as `red green blue (alpha)`, texture coordinates as a list a face.

    Raises:
        ValueError: a scalar of a type that PLY does not have.
    """
    vertex = [(axis, "double", vertices[:, number]) for number, axis in enumerate("xyz")]
    face: list[tuple[str, str, np.ndarray]] = [("vertex_indices", "list uchar int", faces)]
    if attributes.texture is not None:
        face.append(("texcoord", "list uchar float", attributes.texture.reshape(-1, 6)))
    header = ["ply", "format binary_little_endian 1.0"]
    body = b""
    for element, n, geometry, values in (
        ("vertex", len(vertices), vertex, attributes.vertex),
        ("face", len(faces), face, attributes.face),
    ):
        columns = geometry + _attribute_columns(element, values)
        header += [f"element {element} {n}", *(f"property {kind} {name}" for name, kind, _ in columns)]
        body += _records(n, columns)
    return "\n".join([*header, "end_header\n"]).encode("ascii", "backslashreplace") + body


def _attribute_columns(element: str, values: Mapping[str, np.ndarray]) -> list[tuple[str, str, np.ndarray]]:
    """Name, type and values of the properties."""
    columns: list[tuple[str, str, np.ndarray]] = []
    for name, array in values.items():
        if name == COLOR:
            columns += [(c, "uchar", array[:, i]) for i, c in enumerate(_CHANNELS[: array.shape[1]])]
        elif (kind := _NAMES_OF_TYPES.get(array.dtype.str[1:])) is None:
            raise ValueError(f"PLY has no type for the {element} attribute '{name}', {array.dtype}")
        else:
            columns.append((name, kind, array))
    return columns


def _records(n: int, columns: list[tuple[str, str, np.ndarray]]) -> bytes:
    fields: list[tuple] = []
    for name, kind, array in columns:
        *is_list, item = kind.split()
        if is_list:
            fields += [(f"{name} count", "u1"), (name, "<" + _TYPES[item], array.shape[1:])]
        else:
            fields.append((name, "<" + _TYPES[item]))
    table = np.zeros(n, fields)
    for name, kind, array in columns:
        table[name] = array
        if kind.startswith("list"):
            table[f"{name} count"] = array.shape[1]
    return table.tobytes()


def _read_header(data: bytes) -> tuple[str, list[_Element], int]:
    """Byte order ('' for ASCII), declared elements, and where the data starts."""
    if not data:
        raise MeshError("the file is empty")
    magic = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    if magic is None:
        raise MeshError(f"a PLY file starts with the line 'ply', this one with {quoted(data, 20)}")
    end = re.search(rb"(?:\r|\n)end_header[ \t]*" + magic[1], data)
    if end is None:
        raise MeshError("the header has no 'end_header': the file is truncated or damaged")
    byte_order, elements = None, []
    for line in data[magic.end() : end.start()].decode("utf-8", "backslashreplace").splitlines():
        match line.split():
            case ["format", name, _] if name in _BYTE_ORDERS:
                byte_order = _BYTE_ORDERS[name]
            case ["element", name, count] if re.fullmatch(r"[0-9]{1,18}", count):
                elements.append(_Element(name, int(count), []))
            case ["property", "list", count_type, item_type, name] if (
                elements and {count_type, item_type} <= _TYPES.keys() and _TYPES[count_type][0] in "iu"
            ):
                elements[-1].properties.append(_Property(name, _TYPES[item_type], _TYPES[count_type]))
            case ["property", item_type, name] if elements and item_type in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[item_type], None))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise MeshError(f"the header has a line that PLY does not know: {quoted(line.encode())}")
    if byte_order is None:
        raise MeshError("the header has no line 'format ascii 1.0' or 'format binary_… 1.0'")
    for element in elements:
        names = [p.name for p in element.properties]
        if len(set(names)) != len(names):
            raise MeshError(f"the header declares a property of element '{element.name}' twice")
    if len({element.name for element in elements}) != len(elements):
        raise MeshError("the header declares an element twice")
    return byte_order, elements, end.end()


def _decode_ascii(
    body: bytes, elements: list[_Element], header_lines: int
) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
    """A line for each record, elements in the order of the header."""
    lines = significant_lines(body, first_number=header_lines + 1)
    promised = sum(element.n_records for element in elements)
    if len(lines.texts) != promised:
        raise MeshError(
            f"the header promises {promised} lines of data, {len(lines.texts)} follow it: "
            "the file is truncated or damaged"
        )
    starts = np.cumsum([0] + [element.n_records for element in elements])
    parts = {
        e.name: lines.between(int(start), int(start) + e.n_records)
        for e, start in zip(elements, starts, strict=False)
    }
    vertex, face = (next(e for e in elements if e.name == name) for name in ("vertex", "face"))
    vertices = positions(parts["vertex"], [_ascii_column(vertex, (axis,)) for axis in "xyz"])
    return vertices, triangles(parts["face"], first_column=_ascii_column(face, _CORNERS))


def _ascii_column(element: _Element, names: tuple[str, ...]) -> int:
    """Where the property starts on its line; a list before it would have it start anywhere."""
    column = next(i for i, p in enumerate(element.properties) if p.name in names)
    for p in element.properties[:column]:
        if p.count_type is not None:
            raise MeshError(
                f"element '{element.name}' has the list '{p.name}' before '{names[0]}', which is not read; "
                "export the mesh without it"
            )
    return column


def _decode_binary(
    body: bytes, elements: list[_Element], byte_order: str
) -> tuple[Float[np.ndarray, "V 3"], Int[np.ndarray, "F 3"]]:
    """Records of fixed size one after the other: possible since every face is a triangle."""
    tables: dict[str, dict[str, np.ndarray]] = {}
    offset = 0
    for element in elements:
        table, offset = _binary_records(body, offset, element, byte_order)
        tables[element.name] = table
        if {"vertex", "face"} <= tables.keys():
            if element is elements[-1] and body[offset:].strip():
                raise MeshError(
                    f"{len(body) - offset} bytes follow the last '{element.name}': the file is damaged"
                )
            break
    vertices = np.stack([tables["vertex"][axis].astype(np.float64) for axis in "xyz"], axis=1)
    faces = next(tables["face"][name] for name in _CORNERS if name in tables["face"])
    return vertices, faces.astype(np.int64)


def _binary_records(
    body: bytes, offset: int, element: _Element, byte_order: str
) -> tuple[dict[str, np.ndarray], int]:
    """The properties of an element's records, an array each, and where the next element starts."""
    fields: list[tuple] = []
    lengths: dict[str, int] = {}
    for p in element.properties:
        if p.count_type is None:
            fields.append((p.name, byte_order + p.type))
            continue
        lengths[p.name] = 3 if element.name == "face" and p.name in _CORNERS else 0
        if not lengths[p.name] and element.n_records:
            lengths[p.name] = _binary_list_length(
                body, offset + np.dtype(fields).itemsize, byte_order + p.count_type
            )
        fields += [
            (f"{p.name} count", byte_order + p.count_type),
            (p.name, byte_order + p.type, (lengths[p.name],)),
        ]
    record = np.dtype(fields)
    complete = min(element.n_records, (len(body) - offset) // max(record.itemsize, 1))
    table = np.frombuffer(body, record, complete, offset) if record.itemsize else np.zeros(complete, record)
    for name, length in lengths.items():
        _check_list_lengths(element, name, table[f"{name} count"], length)
    if complete < element.n_records:
        raise MeshError(
            f"the header promises {element.n_records} records of element '{element.name}', the data ends "
            f"after {complete}: the file is truncated or damaged"
        )
    return {p.name: table[p.name] for p in element.properties}, offset + element.n_records * record.itemsize


def _binary_list_length(body: bytes, offset: int, count_type: str) -> int:
    """How long the list at `offset` says it is."""
    size = np.dtype(count_type).itemsize
    length = int(np.frombuffer(body, count_type, 1, offset)[0]) if offset + size <= len(body) else -1
    if not 0 <= length <= len(body):
        raise MeshError("the data ends inside a list: the file is truncated or damaged")
    return length


def _check_list_lengths(element: _Element, name: str, counts: Integer[np.ndarray, " n"], length: int) -> None:
    """Every list is as long as supposed; the first that is not was still read from where it stands."""
    other = np.flatnonzero(counts != length)
    if not other.size:
        return
    if element.name == "face" and name in _CORNERS:
        raise MeshError(
            f"face {other[0]} (counted from 0) has {counts[other[0]]} corners; only triangles are read: "
            "triangulate the mesh first"
        )
    raise MeshError(
        f"the list '{name}' of element '{element.name}' varies in length, which is not read; "
        "export the mesh without it"
    )
