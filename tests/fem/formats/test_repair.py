"""Faults of mesh files: each is counted, and mended if repair is allowed and can't change the part."""

from collections.abc import Callable

import numpy as np
import pytest

from fmd.core.arrays import Array, IntArray
from fmd.fem.cells.table import solid_cell
from fmd.fem.formats.import_mesh import solid_mesh
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh
from fmd.fem.mesh import SolidMesh

Make = Callable[..., SolidMesh]
VOLUME = 1.2 * 1.0 * 0.8


@pytest.fixture
def box(box_mesh: Make) -> RawMesh:
    mesh = box_mesh("tetra", (2, 2, 2), (1.2, 1.0, 0.8))
    return RawMesh(mesh.points.copy(), [("tetra", mesh.cells.copy())])


def second_order(raw: RawMesh) -> RawMesh:
    """A copy with nodes in the middle of the edges."""
    ((_, cells),) = raw.blocks
    ends = np.sort(cells[:, np.array(solid_cell("tetra").shape.edges)], axis=2)
    pairs, number = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    points = np.concatenate([raw.points, raw.points[pairs].mean(axis=1)])
    return RawMesh(points, [("tetra10", np.hstack([cells, len(raw.points) + number.reshape(len(cells), 6)]))])


def torn(raw: RawMesh) -> tuple[Array, IntArray]:
    """The first cube's cells with nodes of their own."""
    ((_, cells),) = raw.blocks
    own = cells[:6].ravel()
    return np.concatenate([raw.points, raw.points[own]]), np.concatenate(
        [len(raw.points) + np.arange(own.size).reshape(-1, 4), cells[6:]]
    )


def test_a_sound_mesh_is_taken_without_a_word(box: RawMesh) -> None:
    mesh = solid_mesh(box, 0.5)
    assert mesh.notes == ()
    assert mesh.volume == pytest.approx(VOLUME / 8, rel=1e-13)
    assert {name: len(cells) for name, cells in mesh.parts.items()} == {"all": 48}


def test_nodes_of_no_element_are_left_out(box: RawMesh) -> None:
    box.points = np.concatenate([np.full((3, 3), 9.0), box.points])
    box.blocks = [("tetra", box.blocks[0][1] + 3)]
    box.point_sets["corner"] = np.array([0, 3])
    mesh = solid_mesh(box, 1.0)
    assert mesh.notes == ("3 nodes that belong to no element are left out",)
    assert len(mesh.points) == 27
    assert mesh.faces["corner"].tolist() == [0]


def test_coincident_nodes_are_merged_if_that_is_wanted(box: RawMesh) -> None:
    points, cells = torn(box)
    raw = RawMesh(points, [("tetra", cells)])
    with pytest.raises(MeshFileError, match=r"mesh.repair = true \(or --repair\) does: \d+ nodes lie on others, which"):
        solid_mesh(raw, 1.0)
    mesh = solid_mesh(raw, 1.0, repair=True)
    assert len(mesh.points) == 27
    assert mesh.volume == pytest.approx(VOLUME, rel=1e-13)
    assert mesh.notes[-1].startswith("mended: 24 nodes lie on others")  # six cells of four, 24 nodes of their own


def test_a_crowd_of_nodes_in_one_place_is_no_crowd_of_pairs(box: RawMesh) -> None:
    box.points = np.concatenate([box.points, np.zeros((50_000, 3))])
    assert len(solid_mesh(box, 1.0).points) == 27


def test_inverted_elements_are_turned_if_that_is_wanted(box: RawMesh) -> None:
    box.blocks[0][1][[3, 7]] = box.blocks[0][1][[3, 7]][:, [0, 2, 1, 3]]
    with pytest.raises(MeshFileError, match="2 of 48 elements are inverted"):
        solid_mesh(box, 1.0)
    mesh = solid_mesh(box, 1.0, repair=True)
    assert mesh.notes == ("mended: 2 of 48 elements are inverted: turned",)
    assert mesh.volume == pytest.approx(VOLUME, rel=1e-13)


def test_a_mesh_that_is_left_handed_throughout_is_turned_by_itself(box: RawMesh) -> None:
    raw = second_order(box)
    raw.blocks = [("tetra10", raw.blocks[0][1][:, solid_cell("tetra10").mirrored])]
    mesh = solid_mesh(raw, 1.0)
    assert mesh.notes == ("all 48 elements have their nodes in left-handed order and were turned",)
    assert mesh.volume == pytest.approx(VOLUME, rel=1e-13)


def test_mid_edge_nodes_in_another_order_are_put_right(box: RawMesh) -> None:
    raw = second_order(box)
    raw.blocks = [("tetra10", raw.blocks[0][1][:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]])]  # Gmsh's
    mesh = solid_mesh(raw, 1.0)
    assert len(mesh.notes) == 1
    assert "another order" in mesh.notes[0]
    assert mesh.volume == pytest.approx(VOLUME, rel=1e-13)


def test_elements_turned_inside_out_by_curved_edges_are_straightened_if_that_is_wanted(box: RawMesh) -> None:
    raw = second_order(box)
    moved = raw.blocks[0][1][0, 4]
    raw.points[moved] += 0.9 * (raw.points[raw.blocks[0][1][0, 1]] - raw.points[moved])
    with pytest.raises(MeshFileError, match=r"\d+ elements are inside out by their curved edges"):
        solid_mesh(raw, 1.0)
    mesh = solid_mesh(raw, 1.0, repair=True)
    assert mesh.volume == pytest.approx(VOLUME, rel=1e-13)


def test_flat_elements_are_beyond_mending(box: RawMesh) -> None:
    box.points[13] = box.points[0]  # the inner node
    with pytest.raises(MeshFileError, match="elements are flat, twisted or concave, the first at"):
        solid_mesh(box, 1.0, repair=True)


def test_a_node_twice_in_an_element_is_beyond_mending(box: RawMesh) -> None:
    box.blocks[0][1][5, 1] = box.blocks[0][1][5, 0]
    with pytest.raises(MeshFileError, match="1 elements have a node more than once"):
        solid_mesh(box, 1.0, repair=True)


def test_elements_upon_elements_are_left_out_if_that_is_wanted(box: RawMesh) -> None:
    cells = box.blocks[0][1]
    raw = RawMesh(box.points, [("tetra", cells), ("tetra", cells[:4])], {"more": [np.arange(0), np.arange(4)]})
    with pytest.raises(MeshFileError, match="4 elements lie on others"):
        solid_mesh(raw, 1.0)
    assert solid_mesh(raw, 1.0, repair=True).volume == pytest.approx(VOLUME, rel=1e-13)


def test_pieces_are_counted_and_never_dropped(box: RawMesh) -> None:
    ((_, cells),) = box.blocks
    raw = RawMesh(
        np.concatenate([box.points, box.points[:, :] + 5]), [("tetra", np.concatenate([cells, cells[:6] + 27]))]
    )
    with pytest.raises(MeshFileError, match="2 unconnected pieces, of 48, 6 elements"):
        solid_mesh(raw, 1.0, repair=True)


def test_shells_and_beams_that_are_no_faces_are_left_out_if_that_is_wanted(box: RawMesh) -> None:
    skin = box.blocks[0][1][0, [0, 2, 1]]
    box.blocks += [("triangle", np.array([skin, [0, 13, 26]])), ("line", np.array([[0, 26], [0, 1]]))]
    box.cell_sets["skin"] = [np.arange(0), np.array([0]), np.arange(0)]
    box.others["CONM2"] = 2
    said = (
        r"elements that aren't solid \(2 CONM2, 1 triangle, \d line\): left out; mesh.shell takes them as shells; "
        r"mesh.beam takes them as beams"
    )
    with pytest.raises(MeshFileError, match=said):
        solid_mesh(box, 1.0)
    mesh = solid_mesh(box, 1.0, repair=True)
    assert mesh.notes[0].startswith("1 surface elements on the solid's facets count as its faces")
    assert mesh.faces["skin"].tolist() == [sorted(skin.tolist())]


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (
            RawMesh(np.zeros((4, 3)), [("triangle", np.array([[0, 1, 2]]))]),
            "no solid elements; the elements: 1 triangle",
        ),
        (
            RawMesh(np.eye(5, 3), [("penta_prism", np.array([[0, 1, 2, 3, 4]]))]),
            "solid elements of kind penta_prism aren't read",
        ),
        (RawMesh(np.full((4, 3), np.nan), [("tetra", np.array([[0, 1, 2, 3]]))]), "4 nodes have coordinates"),
        (RawMesh(np.eye(4, 3), [("tetra", np.array([[0, 1, 2, 9]]))]), "name nodes that aren't there"),
    ],
)
def test_what_cannot_be_used_is_refused_with_counts(raw: RawMesh, message: str) -> None:
    with pytest.raises(MeshFileError, match=message):
        solid_mesh(raw, 1.0, repair=True)
