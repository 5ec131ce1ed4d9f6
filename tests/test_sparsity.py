"""Patterns of sparse matrices, and the layouts of their products, against SciPy."""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse as sp

from jaxkvf.compiled import compiled
from jaxkvf.sparse import ProductLayout, RowLayout, Sparsity


def random_pattern(n_rows, n_columns, density, seed):
    """A pattern with an empty and a full row among others, its triples in no order."""
    rng = np.random.default_rng(seed)
    filled = rng.random((n_rows, n_columns)) < density
    filled[n_rows // 2], filled[n_rows // 3] = False, True
    rows, columns = np.nonzero(filled)
    shuffle = rng.permutation(len(rows))
    rows, columns = rows[shuffle], columns[shuffle]
    entries = rng.permutation(len(rows))
    return Sparsity.from_entries(rows, columns, entries, (n_rows, n_columns)), (rows, columns, entries)


def test_entries_are_sorted_by_row_and_column():
    sparsity, (rows, columns, entries) = random_pattern(30, 20, 0.2, seed=0)
    expected = sp.coo_array((entries + 1, (rows, columns)), shape=(30, 20)).tocsr()
    np.testing.assert_array_equal(sparsity.starts, expected.indptr)
    np.testing.assert_array_equal(sparsity.columns, expected.indices)
    np.testing.assert_array_equal(sparsity.entries, expected.data - 1)
    transposed, expected = sparsity.transposed(), expected.T.tocsr()
    np.testing.assert_array_equal(transposed.columns, expected.indices)
    np.testing.assert_array_equal(transposed.entries, expected.data - 1)


def test_a_graph_may_be_seen_along_some_edges():
    edges = np.array([[0, 1], [1, 2], [0, 2], [2, 3]])
    along = np.array([True, False, False, True])
    part = Sparsity.of_graph(edges, 4, along)
    assert part.rows.tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert part.columns.tolist() == [0, 1, 0, 1, 2, 3, 2, 3]
    assert part.entries.tolist() == [
        0,
        4,
        8,
        1,
        2,
        7,
        11,
        3,
    ]  # node, 4 + edge from its tail, 8 + edge from its head
    whole = Sparsity.of_graph(edges, 4)
    assert set(part.entries.tolist()) < set(whole.entries.tolist())


def dense(sparsity, blocks):
    """The matrix with these blocks."""
    r, c = blocks.shape[1:]
    matrix = np.zeros((sparsity.n_rows, r, sparsity.n_columns, c))
    matrix[sparsity.rows, :, sparsity.columns] = blocks[sparsity.entries]
    return matrix.reshape(sparsity.n_rows * r, -1)


@pytest.mark.parametrize("density", [0.02, 0.4])
@pytest.mark.parametrize("transposed", [False, True])
def test_products_with_blocks_of_vectors(density, transposed):
    sparsity, _ = random_pattern(60, 45, density, seed=1)
    rng = np.random.default_rng(2)
    blocks = rng.standard_normal((len(sparsity.entries), 2, 3))
    given = blocks.transpose(0, 2, 1) if transposed else blocks
    x = rng.standard_normal((45 * 3, 4))
    layout = RowLayout.build(sparsity)
    product = jax.jit(lambda blocks, x: layout.fill(blocks, transposed=transposed)(x))
    np.testing.assert_allclose(
        product(jnp.asarray(given), jnp.asarray(x)), dense(sparsity, blocks) @ x, atol=1e-12
    )


@pytest.mark.parametrize(("transposed", "upper"), [(False, False), (True, False), (True, True)])
def test_products_with_each_other(transposed, upper):
    L, _ = random_pattern(40, 35, 0.1, seed=3)
    R, _ = random_pattern(35, 40, 0.1, seed=4)
    rng = np.random.default_rng(5)
    left, right = rng.standard_normal((len(L.entries), 2, 3)), rng.standard_normal((len(R.entries), 3, 2))
    layout, pattern = ProductLayout.build(L, R, upper=upper)
    given = left.transpose(0, 2, 1) if transposed else left
    blocks = jax.jit(lambda a, b: layout(a, b, transposed=transposed))(jnp.asarray(given), jnp.asarray(right))
    expected = dense(L, left) @ dense(R, right)
    if upper:
        assert (pattern.rows <= pattern.columns).all()
        expected *= np.kron(np.triu(np.ones((40, 40))), np.ones((2, 2)))
    np.testing.assert_allclose(dense(pattern, np.asarray(blocks)), expected, atol=1e-12)
    structure = sp.csr_array((np.ones(len(L.columns)), L.columns, L.starts), shape=(40, 35)) @ sp.csr_array(
        (np.ones(len(R.columns)), R.columns, R.starts), shape=(35, 40)
    )
    assert len(pattern.columns) == (sp.triu(structure) if upper else structure).nnz


@compiled
def sum_of_squares(values: np.ndarray) -> float:
    total = 0.0
    for value in values:
        total += value * value
    return total


def test_loops_are_compiled_with_or_without_a_place_to_keep_them(monkeypatch):
    import numba  # noqa: PLC0415

    values, njit, asked = np.arange(10.0), numba.njit, []
    assert sum_of_squares(values) == 285
    assert sum_of_squares.__name__ == "sum_of_squares"

    def without_a_folder(cache=False, nogil=False):
        asked.append(cache)
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return njit(nogil=nogil)

    monkeypatch.setattr(numba, "njit", without_a_folder)
    again = compiled(inspect.unwrap(sum_of_squares))
    assert again(values) == 285
    assert asked == [True, False]
