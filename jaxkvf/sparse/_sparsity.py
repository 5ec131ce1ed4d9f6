"""Where sparse matrices have entries, on the host: by rows, as in the CSR format."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from ..compiled import compiled


class Sparsity(NamedTuple):
    """Where a block matrix has entries, by rows: those of row r are `starts[r] : starts[r + 1]`."""

    starts: Int[np.ndarray, " starts"]
    columns: Int[np.ndarray, " e"]
    """Column block of each entry, ascending in each row."""
    entries: Int[np.ndarray, " e"]
    """Number of each entry's block in the list of blocks that goes with the matrix."""
    n_columns: int

    @property
    def n_rows(self) -> int:
        return len(self.starts) - 1

    @property
    def rows(self) -> Int[np.ndarray, " e"]:
        return np.repeat(np.arange(self.n_rows, dtype=np.int32), np.diff(self.starts))

    @classmethod
    def from_entries(
        cls,
        rows: Int[np.ndarray, " e"],
        columns: Int[np.ndarray, " e"],
        entries: Int[np.ndarray, " e"],
        shape: tuple[int, int],
    ) -> "Sparsity":
        """From triples in any order, no place twice."""
        rows, columns, entries = (part.astype(np.int32) for part in (rows, columns, entries))
        return cls(*_sorted(rows, columns, entries, shape[0]), shape[1])

    @classmethod
    def of_graph(
        cls, edges: Int[np.ndarray, "m 2"], n_nodes: int, along: Bool[np.ndarray, " m"] | None = None
    ) -> "Sparsity":
        """Of a `SymmetricBlockOperator`, with its numbers of blocks.

        Args:
            edges: the graph.
            n_nodes: n.
            along: only these edges; their blocks keep their numbers.
        """
        numbers = np.arange(n_nodes + 2 * len(edges), dtype=np.int32)
        nodes, upper, lower = np.split(numbers, [n_nodes, n_nodes + len(edges)])
        if along is not None:
            edges, upper, lower = edges[along], upper[along], lower[along]
        # In this order, which is by column where edges are sorted and point upwards.
        tail, head = edges.T
        rows, columns = np.concatenate([head, nodes, tail]), np.concatenate([tail, nodes, head])
        return cls.from_entries(rows, columns, np.concatenate([lower, nodes, upper]), (n_nodes, n_nodes))

    def transposed(self) -> "Sparsity":
        """The same blocks, seen from the columns."""
        return Sparsity.from_entries(self.columns, self.rows, self.entries, (self.n_columns, self.n_rows))


@compiled
def _sorted(
    rows: np.ndarray, columns: np.ndarray, entries: np.ndarray, n_rows: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    starts = np.zeros(n_rows + 1, np.int32)
    for row in rows:
        starts[row + 1] += 1
    for row in range(n_rows):
        starts[row + 1] += starts[row]
    ends = starts[:-1].copy()
    sorted_columns, sorted_entries = np.empty_like(columns), np.empty_like(entries)
    for i in range(len(rows)):
        first, place = starts[rows[i]], ends[rows[i]]
        ends[rows[i]] += 1
        while place > first and sorted_columns[place - 1] > columns[i]:  # seldom far: most come in order
            sorted_columns[place], sorted_entries[place] = (
                sorted_columns[place - 1],
                sorted_entries[place - 1],
            )
            place -= 1
        sorted_columns[place], sorted_entries[place] = columns[i], entries[i]
    return starts, sorted_columns, sorted_entries
