"""Lines of text as arrays of numbers; the first line that is not what it should be is named."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import DTypeLike

from .._errors import MeshError

_UTF8_MARK = b"\xef\xbb\xbf"


class Lines(NamedTuple):
    """Some lines of a text file, without comments and surrounding blanks."""

    numbers: list[int]
    """Where each stands in the file, counted from 1."""
    texts: list[bytes]

    def quote(self, i: int | np.integer) -> str:
        """`line 7: 'f 1 2 x'`, for a message."""
        return f"line {self.numbers[i]}: {quoted(self.texts[i])}"

    def between(self, start: int, stop: int) -> "Lines":
        return Lines(self.numbers[start:stop], self.texts[start:stop])

    def where(self, keep: Sequence[bool]) -> "Lines":
        pairs = [pair for pair, kept in zip(zip(*self, strict=True), keep, strict=True) if kept]
        return Lines([number for number, _ in pairs], [text for _, text in pairs])


def quoted(text: bytes, longest: int = 60) -> str:
    """The text in quotes, printable and cut to `longest` characters."""
    shown = text[:longest].decode("utf-8", "backslashreplace")
    return repr(shown + "…" if len(text) > longest else shown)


def significant_lines(data: bytes, first_number: int = 1) -> Lines:
    """The lines that are not blank once comments, `#` to the end of the line, are gone."""
    data = data.removeprefix(_UTF8_MARK)
    if b"#" in data:
        data = re.sub(rb"#[^\r\n]*", b"", data)
    texts = [line.strip() for line in data.splitlines()]
    lines = Lines(list(range(first_number, first_number + len(texts))), texts)
    return lines.where([bool(text) for text in texts]) if not all(texts) else lines


def positions(lines: Lines, columns: Sequence[int]) -> Float[np.ndarray, "n 3"]:
    """The coordinates that stand in these three columns of each line; further columns are not read.

    Raises:
        MeshError: a line without three numbers there.
    """
    return _table(lines.texts, lines, columns, np.float64, "a vertex with three coordinates")


def triangles(lines: Lines, first_column: int = 0) -> Int[np.ndarray, "n 3"]:
    """The corners of faces written as their number of corners and the corners: `3 0 2 1`.

    Args:
        lines: a face each.
        first_column: where the number of corners stands; what comes after the third corner is not read.

    Raises:
        MeshError: a face that is not a triangle, or a corner that is not an integer.
    """
    counts_and_corners = integers(lines, lines.texts, range(first_column, first_column + 4))
    check_triangles(lines, counts_and_corners[:, 0])
    return counts_and_corners[:, 1:]


def integers(lines: Lines, rows: list[bytes], columns: Sequence[int]) -> Int[np.ndarray, "n c"]:
    """The corners in these columns of `rows`, which say what `lines` say in the file.

    Raises:
        MeshError: a line without an integer there.
    """
    return _table(rows, lines, columns, np.int64, "a triangle")


def check_triangles(lines: Lines, n_corners: Int[np.ndarray, " n"]) -> None:
    """Every face has three corners.

    Raises:
        MeshError: one has not.
    """
    polygons = np.flatnonzero(n_corners != 3)
    if polygons.size:
        raise MeshError(
            f"{lines.quote(polygons[0])} is a face with {n_corners[polygons[0]]} corners; only triangles are "
            f"read, and {polygons.size} of the {len(n_corners)} faces are none: triangulate the mesh first"
        )


def _table(
    rows: list[bytes], lines: Lines, columns: Sequence[int], dtype: DTypeLike, expected: str
) -> np.ndarray:
    """Numbers in these columns; `numpy.loadtxt` rounds correctly and does not depend on the locale."""

    def parse(part: list[bytes]) -> np.ndarray:
        return np.loadtxt(part, dtype=dtype, comments=None, usecols=columns, ndmin=2)

    if not rows:
        return np.zeros((0, len(columns)), dtype)
    try:
        return parse(rows)
    except ValueError:
        low, high = 0, len(rows)  # the first bad row is in rows[low:high]
        while high - low > 1:
            middle = (low + high) // 2
            try:
                parse(rows[low:middle])
            except ValueError:
                high = middle
            else:
                low = middle
        raise MeshError(f"{lines.quote(low)}, expected {expected}") from None
