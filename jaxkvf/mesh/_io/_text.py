"""Lines of text as arrays of numbers; the first line that is not what it should be is named."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import DTypeLike

from .._errors import MeshError
from .._polygons import Polygons

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


def polygons(
    lines: Lines, rows: list[bytes], sizes: Int[np.ndarray, " n"], first_column: int
) -> Int[np.ndarray, " c"]:
    """All corners, one face after the other.

    Args:
        lines: a face each.
        rows: what they say, with the corners from `first_column` on.
        sizes: numbers of corners.
        first_column: where the first corner stands; what comes after the last is not read.

    Raises:
        MeshError: a corner that is not an integer, or is not there.
    """
    starts = np.cumsum(sizes) - sizes
    corners = np.empty(int(sizes.sum()), np.int64)
    for n in np.unique(sizes[sizes > 0]).tolist():
        which = np.flatnonzero(sizes == n)
        part = lines, rows
        if len(which) < len(sizes):
            part = lines.where((sizes == n).tolist()), [rows[i] for i in which]
        corners[starts[which, None] + np.arange(n)] = integers(*part, range(first_column, first_column + n))
    return corners


def counted_polygons(lines: Lines, first_column: int = 0) -> Polygons:
    """Faces written as their number of corners and the corners: `3 0 2 1`.

    Raises:
        MeshError: a number that is no integer, or is not there.
    """
    sizes = integers(lines, lines.texts, [first_column], "a face, which begins with its number of corners")[
        :, 0
    ]
    longest = np.array([len(text) for text in lines.texts], np.int64)
    wrong = np.flatnonzero((sizes < 0) | (2 * sizes > longest))
    if wrong.size:
        raise MeshError(f"{lines.quote(wrong[0])}, expected {sizes[wrong[0]]} corners of a face")
    return Polygons(polygons(lines, lines.texts, sizes, first_column + 1), sizes)


def integers(
    lines: Lines, rows: list[bytes], columns: Sequence[int], expected: str | None = None
) -> Int[np.ndarray, "n c"]:
    """The integers in these columns of `rows`, which say what `lines` say in the file.

    Raises:
        MeshError: a line without an integer there.
    """
    named = "a triangle" if len(columns) == 3 else f"a face of {len(columns)} corners"
    return _table(rows, lines, columns, np.int64, expected or named)


def numbers(lines: Lines, columns: Sequence[int]) -> Float[np.ndarray, "n c"] | None:
    """The numbers in these columns; None where a line has none: for what a mesh can do without."""
    try:
        return _table(lines.texts, lines, columns, np.float64, "")
    except MeshError:
        return None


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
