"""Where the terms of many sums of varying length stand, on the host.

Sums of similar length stand together, padded to the same length, so that all of them advance by one term at once.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Int

from ..compiled import compiled

NOTHING = int(np.iinfo(np.int32).max)
"""Number of the term in a slot left over: out of bounds of any list."""

_MOST_CLASSES = 2  # lengths that sums are padded to
_WORTH_A_CLASS = 0.9  # padding must fall to this for one more: each costs compilation, and the sums' order
_CHUNK = 1 << 19  # terms that one thread writes at a time
_ALIGNED = 16  # numbers: JAX takes over arrays that begin at a multiple of 64 bytes
UNROLLED = 8  # terms added at once: fewer cost memory traffic, more cost compilation


class Slots(NamedTuple):
    """Where the terms of sums stand in one long array: slot by slot in each class of sums of similar length."""

    places: Int[np.ndarray, " sums"]
    """Of each sum when the classes follow each other."""
    firsts: Int[np.ndarray, " starts"]
    """First place of each class, and one past the last."""
    widths: Int[np.ndarray, " classes"]
    """Slots of each sum."""
    offsets: Int[np.ndarray, " starts"]
    """Where the slots of each class begin, and the length of the array."""


class Table(NamedTuple):
    """Slots, and how they are cut up for XLA."""

    slots: Slots
    chunks: list[int]
    """That the slots of each class are added up in."""

    @classmethod
    def of(cls, lengths: Int[np.ndarray, " sums"]) -> "Table":
        class_of, longest = _length_classes(lengths)
        places, firsts = _places(lengths.astype(np.int32), class_of, len(longest))
        chunks = [-(-length // UNROLLED) for length in longest]
        widths = np.array([-(-length // n) * n for length, n in zip(longest, chunks, strict=True)])
        sizes = -(-np.diff(firsts) * widths // _ALIGNED) * _ALIGNED
        return cls(Slots(places, firsts, widths, np.append(0, np.cumsum(sizes))), chunks)

    @property
    def order(self) -> Int[Array, " sums"] | None:
        """The places, unless there is but one class."""
        return None if len(self.chunks) == 1 else jax.device_put(self.slots.places)

    def empty(self) -> Int[np.ndarray, " slots"]:
        return _aligned(int(self.slots.offsets[-1]))

    def parts(self, values: Int[np.ndarray, " slots"]) -> tuple[Int[Array, "_ _ _"], ...]:
        """The array of each class, [chunk, slot, sum]."""
        _, firsts, widths, offsets = self.slots
        sizes = np.diff(firsts)
        ends = offsets[:-1] + widths * sizes
        return tuple(
            jax.device_put(values[start:end].reshape(n, -1, size))
            for start, end, size, n in zip(offsets, ends, sizes, self.chunks, strict=False)
        )


def _aligned(size: int) -> Int[np.ndarray, " size"]:
    """An array that JAX can use on a CPU as it is, without a copy."""
    room = np.empty(size + _ALIGNED, np.int32)
    first = -(room.ctypes.data // room.itemsize) % _ALIGNED
    return room[first : first + size]


def _length_classes(lengths: Int[np.ndarray, " n"]) -> tuple[Int[np.ndarray, " lengths"], list[int]]:
    """Class of each length from 0 on, and the longest of each class.

    At most two classes, chosen to minimise the padding, and fewer where more do not pay.
    """
    all_counts = np.bincount(lengths)
    values = np.flatnonzero(all_counts)
    below = np.append(0, np.cumsum(all_counts[values]))
    # cost[j, i]: sums with length in values[j : i], padded to values[i − 1]
    cost = (below[None, :] - below[:, None]) * np.append(0, values)[None, :]
    cost = np.where(np.tri(len(below), k=-1, dtype=bool), np.inf, cost)
    best, cuts = cost[0], []
    total, chosen = best[-1], [len(values)]  # number of values up to the end of each class
    for _ in range(min(_MOST_CLASSES, len(values)) - 1):
        following = best[:, None] + cost
        cuts.append(following.argmin(axis=0))
        best = following.min(axis=0)
        if best[-1] <= _WORTH_A_CLASS * total:
            total, chosen = best[-1], [len(values)]
            for cut in reversed(cuts):
                chosen.append(cut[chosen[-1]])
    longest = values[np.unique(chosen) - 1]
    class_of = np.searchsorted(longest, np.arange(len(all_counts))).astype(np.int32)
    return class_of, np.maximum(longest, 1).tolist()


def row_parts(work: Int[np.ndarray, " starts"]) -> list[tuple[int, int]]:
    """First and last row of parts of about the same size, by the work up to each row."""
    cuts = np.searchsorted(work, np.arange(_CHUNK, work[-1], _CHUNK))
    cuts = np.unique(np.concatenate([[0], cuts, [len(work) - 1]]))
    return list(zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True))


@compiled
def _places(lengths: np.ndarray, class_of: np.ndarray, n_classes: int) -> tuple[np.ndarray, np.ndarray]:
    """Place of each sum when the classes follow each other, and the first of each class."""
    firsts = np.zeros(n_classes + 1, np.int64)
    for length in lengths:
        firsts[class_of[length] + 1] += 1
    firsts = np.cumsum(firsts)
    following = firsts.astype(np.int32)
    places = np.empty_like(lengths)
    for i in range(len(lengths)):
        places[i] = following[class_of[lengths[i]]]
        following[class_of[lengths[i]]] += 1
    return places, firsts
