"""Polygon File Format, PLY: ASCII and binary."""

import re
import warnings
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .._attributes import COLOR, NO_ATTRIBUTES, Attributes, color_from
from .._defects import with_repeated_corner
from .._errors import MeshError
from .._polygons import Polygons
from .._raw import RawAttributes, RawMesh
from ._text import Lines, counted_polygons, numbers, positions, quoted, significant_lines

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
_TEXTURE = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))


class _Property(NamedTuple):
    name: str
    type: str
    count_type: str | None
    """Type of the number that stands before a list; None for a scalar."""


class _Element(NamedTuple):
    name: str
    n_records: int
    properties: list[_Property]


class _Records(NamedTuple):
    """The properties of an element's records."""

    scalars: dict[str, np.ndarray]
    lists: dict[str, tuple[np.ndarray, np.ndarray]]
    """Items, one list after the other, and lengths."""
    subject: Callable[[int], str] | None = None


def decode_ply(data: bytes) -> RawMesh:
    """The `x y z` of a PLY file's vertices and the corners of its faces, or of its strips of triangles.

    Raises:
        MeshError: a damaged header, fewer or more data than it promises, no vertices or faces.
    """
    byte_order, elements, start = _read_header(data)
    needed = {element.name: element for element in elements}
    faces = next((needed[name] for name in ("face", "tristrips") if name in needed), None)
    if "vertex" not in needed or faces is None:
        name = "face" if "vertex" in needed else "vertex"
        raise MeshError(f"the header declares no element '{name}': this is not a triangle mesh")
    for axis in "xyz":
        if axis not in [p.name for p in needed["vertex"].properties if p.count_type is None]:
            raise MeshError(f"the header declares no coordinate '{axis}' of the vertices")
    if not any(p.name in _CORNERS and p.count_type and p.type[0] in "iu" for p in faces.properties):
        raise MeshError("the header declares no list 'vertex_indices' of integers for the faces")
    wanted = {"vertex", faces.name}
    if byte_order:
        tables = _decode_binary(data[start:], elements, wanted, byte_order)
    else:
        tables = _decode_ascii(data[start:], elements, wanted, len(data[:start].splitlines()))
    vertex, face = tables["vertex"], tables[faces.name]
    vertices = np.stack([vertex.scalars[axis].astype(np.float64) for axis in "xyz"], axis=1)
    polygons = Polygons(*next(face.lists[name] for name in _CORNERS if name in face.lists))
    if faces.name == "tristrips":
        return RawMesh(vertices, _unrolled(polygons), attributes=lambda: RawAttributes(_attributes(vertex)))
    raw = RawMesh(vertices, polygons, attributes=lambda: _all_attributes(vertex, face, polygons))
    return raw if face.subject is None else raw._replace(subject=face.subject)


def _unrolled(strips: Polygons) -> Polygons:
    """The triangles of strips, which −1 ends; those that repeat a corner only join one strip to the next."""
    ends = np.union1d(np.flatnonzero(strips.corners < 0), np.cumsum(strips.sizes))
    corners = [np.zeros((0, 3), np.int64)]
    start = 0
    for end in ends.tolist():
        strip = strips.corners[start:end] if end < len(strips.corners) else strips.corners[start:]
        strip = strip[strip >= 0]
        rows = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1)
        rows[1::2] = rows[1::2, [1, 0, 2]]
        corners.append(rows)
        start = end
    faces = np.concatenate(corners)
    return Polygons.of_rows(np.delete(faces, with_repeated_corner(faces), axis=0))


def _all_attributes(vertex: _Records, face: _Records, polygons: Polygons) -> RawAttributes:
    """Texture coordinates stand at vertices, by one of several names, or in a list a face."""
    texture = None
    wedges = face.lists.get("texcoord")
    names = next((pair for pair in _TEXTURE if set(pair) <= vertex.scalars.keys()), None)
    if wedges is not None and (wedges[1] == 2 * polygons.sizes).all():
        texture = wedges[0].astype(np.float64).reshape(-1, 2)
    elif names is not None:
        places = np.stack([vertex.scalars[name].astype(np.float64) for name in names], axis=1)
        inside = (polygons.corners >= 0) & (polygons.corners < len(places))
        texture = np.where(inside[:, None], places[np.where(inside, polygons.corners, 0)], 0.0)
    return RawAttributes(_attributes(vertex), _attributes(face), texture)


def _attributes(records: _Records) -> dict[str, np.ndarray]:
    """Scalars by name, colours together; neither positions, normals nor texture coordinates."""
    values = dict(records.scalars)
    found: dict[str, np.ndarray] = {}
    for prefix in ("", "diffuse_"):
        channels = [values.pop(prefix + name, None) for name in _CHANNELS]
        present = [channel for channel in channels if channel is not None]
        if len(present) >= 3 and channels[:3] == present[:3]:
            color = np.stack(present, axis=1)
            found[COLOR] = color if color.dtype == np.uint8 else color_from(color)
    known = {"x", "y", "z", "nx", "ny", "nz"}.union(*_TEXTURE)
    return found | {name: array for name, array in values.items() if name not in known}


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
    body: bytes, elements: list[_Element], wanted: set[str], header_lines: int
) -> dict[str, _Records]:
    """A line for each record, elements in the order of the header."""
    lines = significant_lines(body, first_number=header_lines + 1)
    promised = sum(element.n_records for element in elements)
    if len(lines.texts) != promised:
        raise MeshError(
            f"the header promises {promised} lines of data, {len(lines.texts)} follow it: "
            "the file is truncated or damaged"
        )
    starts = np.cumsum([0] + [element.n_records for element in elements])
    return {
        e.name: _ascii_records(lines.between(int(start), int(start) + e.n_records), e)
        for e, start in zip(elements, starts, strict=False)
        if e.name in wanted
    }


def _ascii_records(lines: Lines, element: _Element) -> _Records:
    """Scalars before the first list, the list of corners, and one list or scalars behind it where all faces are alike."""
    names = [p.name for p in element.properties]
    if element.name == "vertex":
        xyz = positions(lines, [_ascii_column(element, (axis,)) for axis in "xyz"])
        before = next((i for i, p in enumerate(element.properties) if p.count_type), len(names))
        scalars = {}
        for i, p in enumerate(element.properties[:before]):
            column = xyz[:, "xyz".index(p.name)] if p.name in tuple("xyz") else _ascii_scalar(lines, i, p)
            if column is not None:
                scalars[p.name] = column
        return _Records(scalars, {})
    first = _ascii_column(element, _CORNERS)
    polygons = counted_polygons(lines, first)
    scalars = {p.name: _ascii_scalar(lines, i, p) for i, p in enumerate(element.properties[:first])}
    lists: dict[str, tuple[np.ndarray, np.ndarray]] = {names[first]: (polygons.corners, polygons.sizes)}
    if len(np.unique(polygons.sizes)) == 1:
        at = first + 1 + int(polygons.sizes[0])
        for p in element.properties[first + 1 :]:
            if p.count_type is not None:
                length = 2 * int(polygons.sizes[0])
                values = numbers(lines, range(at + 1, at + 1 + length)) if p.name == "texcoord" else None
                if values is None:
                    break
                lists[p.name] = values.ravel(), np.full(len(values), length)
                at += 1 + length
            else:
                scalars[p.name] = _ascii_scalar(lines, at, p)
                at += 1
    return _Records(
        {name: values for name, values in scalars.items() if values is not None},
        lists,
        lambda i: f"{lines.quote(i)} is a face with",
    )


def _ascii_scalar(lines: Lines, column: int, wanted: _Property) -> np.ndarray | None:
    """The values of a property in its own type; None where they are no such numbers."""
    values = numbers(lines, (column,))
    if values is None:
        return None
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return values[:, 0].astype(wanted.type)


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
    body: bytes, elements: list[_Element], wanted: set[str], byte_order: str
) -> dict[str, _Records]:
    tables: dict[str, _Records] = {}
    offset = 0
    for element in elements:
        tables[element.name], offset = _binary_records(body, offset, element, byte_order)
        if wanted <= tables.keys():
            if element is elements[-1] and body[offset:].strip():
                raise MeshError(
                    f"{len(body) - offset} bytes follow the last '{element.name}': the file is damaged"
                )
            break
    return tables


def _binary_records(body: bytes, offset: int, element: _Element, byte_order: str) -> tuple[_Records, int]:
    """The properties of an element's records, and where the next element starts."""
    fields: list[tuple] = []
    lengths: dict[str, int] = {}
    for p in element.properties:
        if p.count_type is None:
            fields.append((p.name, byte_order + p.type))
            continue
        length = _binary_list_length(body, offset + np.dtype(fields).itemsize, byte_order + p.count_type)
        lengths[p.name] = length if element.n_records else 0
        fields += [
            (f"{p.name} count", byte_order + p.count_type),
            (p.name, byte_order + p.type, (lengths[p.name],)),
        ]
    record = np.dtype(fields)
    complete = min(element.n_records, (len(body) - offset) // max(record.itemsize, 1))
    table = np.frombuffer(body, record, complete, offset) if record.itemsize else np.zeros(complete, record)
    if any((table[f"{name} count"] != length).any() for name, length in lengths.items()):
        return _ragged_records(body, offset, element, byte_order)
    if complete < element.n_records:
        raise _ends_early(element, complete)
    scalars = {p.name: table[p.name] for p in element.properties if p.count_type is None}
    lists = {
        name: (_native(table[name]).ravel(), np.full(complete, length)) for name, length in lengths.items()
    }
    return _Records(scalars, lists), offset + element.n_records * record.itemsize


def _native(values: np.ndarray) -> np.ndarray:
    return values.astype(np.int64 if values.dtype.kind in "iu" else np.float64)


def _ends_early(element: _Element, complete: int) -> MeshError:
    return MeshError(
        f"the header promises {element.n_records} records of element '{element.name}', the data ends "
        f"after {complete}: the file is truncated or damaged"
    )


def _ragged_records(body: bytes, offset: int, element: _Element, byte_order: str) -> tuple[_Records, int]:
    """Records with lists of different lengths, one after the other."""
    order = "little" if byte_order == "<" else "big"
    sizes = [np.dtype(p.type).itemsize for p in element.properties]
    counts = [0 if p.count_type is None else np.dtype(p.count_type).itemsize for p in element.properties]
    places: list[list[int]] = [[] for _ in element.properties]
    lengths: list[list[int]] = [[] for _ in element.properties]
    for record in range(element.n_records):
        for i, (size, count) in enumerate(zip(sizes, counts, strict=True)):
            length = int.from_bytes(body[offset : offset + count], order) if count else 1
            places[i].append(offset + count)
            lengths[i].append(length)
            offset += count + length * size
        if offset > len(body):
            raise _ends_early(element, record)
    content = np.frombuffer(body, np.uint8)
    scalars, lists = {}, {}
    for p, size, start, length in zip(element.properties, sizes, places, lengths, strict=True):
        n = np.array(length, np.int64)
        within = np.arange(int(n.sum())) - np.repeat(np.cumsum(n) - n, n)
        at = np.repeat(np.array(start, np.int64), n) + size * within
        values = content[at[:, None] + np.arange(size)].view(byte_order + p.type)[:, 0]
        if p.count_type is None:
            scalars[p.name] = values
        else:
            lists[p.name] = _native(values), n
    return _Records(scalars, lists), offset


def _binary_list_length(body: bytes, offset: int, count_type: str) -> int:
    """How long the list at `offset` says it is; 0 where the data ends before."""
    size = np.dtype(count_type).itemsize
    length = int(np.frombuffer(body, count_type, 1, offset)[0]) if offset + size <= len(body) else 0
    return length if 0 <= length <= len(body) else 0
