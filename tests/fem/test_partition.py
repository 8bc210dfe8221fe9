"""Meshes divided into pieces: connected, balanced, between layers where there are layers."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from fmd.core.arrays import IntArray
from fmd.fem.mesh import SolidMesh
from fmd.fem.partition import PartitionError, count_bare_nodes, divide_mesh, interior_facets
from fmd.fem.space import Discretisation
from fmd.meshes.bar import hexahedral_bar, tetrahedral_bar


def parts_of(space: Discretisation, labels: IntArray) -> int:
    """Count the connected parts of all pieces together."""
    pairs, _ = interior_facets(space)
    same = pairs[labels[pairs[:, 0]] == labels[pairs[:, 1]]]
    graph = sp.coo_array((np.ones(len(same)), same.T), shape=(len(labels),) * 2)
    return int(connected_components(graph, directed=False, return_labels=False))


@pytest.mark.parametrize("count", [2, 3, 5, 8])
def test_a_bar_of_layers_is_cut_between_them(count: int) -> None:
    space = Discretisation(SolidMesh(*hexahedral_bar(1.0, 0.05, 0.03, (24, 2, 2))), 1)
    labels = divide_mesh(space, count)
    layer = np.floor(space.x[space.element_nodes].mean(axis=1)[:, 0] * 24).astype(int)
    for k in range(24):
        assert len(set(labels[layer == k])) == 1
    counts = np.bincount(labels) // 4
    assert counts.max() - counts.min() <= (0 if 24 % count == 0 else 1)


def test_tetrahedra_are_divided_into_connected_pieces_of_about_equal_volume() -> None:
    space = Discretisation(SolidMesh(*tetrahedral_bar(1.0, 0.06, 0.06, 0.03)), 1)
    labels = divide_mesh(space, 6)
    volumes = np.bincount(labels, space.volumes)
    assert parts_of(space, labels) == 6
    assert volumes.max() < 1.4 * volumes.min()


def test_a_ring_is_divided_into_arcs() -> None:
    pytest.importorskip("pymetis")
    turns = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    around = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    points = np.array([(r * c, r * s, z) for c, s in around for r in (0.9, 1.0) for z in (0.0, 0.1)])
    after = np.roll(np.arange(24), -1)
    cells = np.array(
        [[4 * i, 4 * i + 2, 4 * j + 2, 4 * j, 4 * i + 1, 4 * i + 3, 4 * j + 3, 4 * j + 1] for i, j in enumerate(after)]
    )
    space = Discretisation(SolidMesh(points, cells, "hexahedron", {"ring": np.arange(24)}, {}), 1)
    labels = divide_mesh(space, 4)
    assert parts_of(space, labels) == 4
    assert np.bincount(labels).min() >= 4
    pairs, _ = interior_facets(space)
    assert np.count_nonzero(labels[pairs[:, 0]] != labels[pairs[:, 1]]) == 4  # four cuts: one closes the ring


def test_two_elements_are_two_pieces() -> None:
    space = Discretisation(SolidMesh(*hexahedral_bar(1.0, 0.05, 0.03, (2, 1, 1))), 1)
    assert divide_mesh(space, 2).tolist() == [0, 1]


def test_more_pieces_than_elements_are_refused() -> None:
    space = Discretisation(SolidMesh(*hexahedral_bar(1.0, 0.05, 0.03, (3, 1, 1))), 1)
    with pytest.raises(PartitionError, match="has 3 elements; it can't be divided into 4 pieces"):
        divide_mesh(space, 4)


def test_nodes_of_pieces_without_a_common_facet_are_counted() -> None:
    space = Discretisation(SolidMesh(*hexahedral_bar(1.0, 0.1, 0.1, (2, 2, 1))), 1)
    centres = space.x[space.element_nodes].mean(axis=1)
    quarter = (2 * (centres[:, 0] > 0.5) + (centres[:, 1] > 0)).astype(int)
    pairs = interior_facets(space)[0]
    assert count_bare_nodes(space.element_nodes, quarter, pairs) == 2 * 2  # two nodes in the middle, two diagonals
    assert count_bare_nodes(space.element_nodes, quarter // 2, pairs) == 0
