"""Sums of element entries into matrices, against SciPy's own sums."""

import numpy as np
import pytest
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.fem.space import BlockStructure

N_NODES, N_LOCAL = 30, 4


@pytest.fixture
def element_nodes() -> IntArray:
    rng = np.random.default_rng(0)
    return np.array([rng.choice(N_NODES, N_LOCAL, replace=False) for _ in range(40)])


def summed(element_nodes: IntArray, entries: Array) -> Array:
    rows = np.repeat(element_nodes, N_LOCAL, axis=1).ravel()
    columns = np.tile(element_nodes, (1, N_LOCAL)).ravel()
    return sp.coo_array((entries.ravel(), (rows, columns)), shape=(N_NODES, N_NODES)).toarray()


def test_scalar_entries_are_summed_by_pairs_of_nodes(element_nodes: IntArray) -> None:
    entries = np.random.default_rng(1).standard_normal((40, N_LOCAL, N_LOCAL))
    structure = BlockStructure(element_nodes, N_NODES)
    A = structure.scalar_matrix(structure.sums(entries))
    assert np.abs(A.toarray() - summed(element_nodes, entries)).max() < 1e-14
    assert A.has_canonical_format


def test_blocks_stand_at_the_unknowns_of_their_nodes(element_nodes: IntArray) -> None:
    entries = np.random.default_rng(2).standard_normal((40, N_LOCAL, N_LOCAL, 3, 3))
    structure = BlockStructure(element_nodes, N_NODES)
    A = structure.block_matrix(structure.sums(entries)).toarray()
    for a in range(3):
        for b in range(3):
            assert np.abs(A[a::3, b::3] - summed(element_nodes, entries[..., a, b])).max() < 1e-14


def test_a_node_of_no_element_has_an_empty_row() -> None:
    structure = BlockStructure(np.array([[0, 1], [1, 3]]), 5)
    A = structure.scalar_matrix(structure.sums(np.ones((2, 2, 2))))
    assert np.diff(A.indptr).tolist() == [2, 3, 0, 2, 0]
