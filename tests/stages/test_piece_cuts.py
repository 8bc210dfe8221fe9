"""Cuts between pieces: one for each place where two touch, and none where they hardly do."""

import numpy as np
import pytest

from fmd.fem.mesh import SolidMesh
from fmd.fem.partition import PartitionError, interior_facets
from fmd.fem.space import Discretisation
from fmd.meshes.bar import hexahedral_bar
from fmd.stages.pieces import join_pieces


def test_two_pieces_have_a_cut_in_each_place_where_they_touch() -> None:
    space = Discretisation(SolidMesh(*hexahedral_bar(1.0, 0.1, 0.1, (6, 2, 1))), 1)
    middle = np.abs(space.x[space.element_nodes].mean(axis=1)[:, 0] - 0.5) < 0.3
    number, cuts = join_pieces(space, middle.astype(int), *interior_facets(space), 1)
    assert number.tolist() == [1, 0]
    assert [(sorted(cut.pieces), cut.closes, len(cut.facets)) for cut in cuts] == [
        ([0, 1], False, 2),
        ([0, 1], True, 2),
    ]
    for piece in (0, 1):
        assert len({cut.of_first if cut.first == piece else cut.of_second for cut in cuts}) == 2


def test_a_piece_that_hardly_touches_the_others_is_refused() -> None:
    places = [(x, y, z) for x in (0.0, 1.0, 1.005, 2.0) for y in (0.0, 1.0, 2.0) for z in (0.0, 1.0)]
    corners = np.array([0, 6, 8, 2, 1, 7, 9, 3])
    cells = np.stack([corners, corners + 6, corners + 12, corners + 8])  # the last one stands on the thin one
    used, cells = np.unique(cells, return_inverse=True)
    mesh = SolidMesh(np.array(places)[used], cells.reshape(4, 8), "hexahedron", {}, {})
    space = Discretisation(mesh, 1)
    with pytest.raises(PartitionError, match="1 of the pieces hardly touch the others; take another number"):
        join_pieces(space, np.array([0, 1, 1, 2]), *interior_facets(space), 0)
