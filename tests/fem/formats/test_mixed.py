"""Meshes of several kinds of cells: as tetrahedra they fill the same volume, stretch evenly and vibrate alike."""

from pathlib import Path

import numpy as np
import pytest

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.fem.assembly import assemble
from fmd.fem.cells.table import CELLS
from fmd.fem.formats.import_mesh import read_mesh, solid_mesh
from fmd.fem.formats.mixed import split_mixed
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.meshes.bar import hexahedral_bar
from fmd.reduction.eigen import FreeBodySolver

ALUMINIUM = Material(70e9, 0.33, 2700.0)
SIZE = (0.4, 0.05, 0.04)
Blocks = list[tuple[str, IntArray]]


def mixed(order: int = 1, n: int = 8) -> tuple[Array, Blocks]:
    """Hexahedra, columns of wedges, pyramids between them and tetrahedra at the side."""
    bar = hexahedral_bar(*SIZE, (n, n // 4, n // 4))
    points, kinds = list(bar.points), dict[str, list[list[int]]]()
    for nodes in bar.cells.tolist():
        place = int(points[nodes[0]][0] / SIZE[0] * n + 0.5) % 3
        x = np.array([points[k] for k in nodes])
        if place == 0:
            kinds.setdefault("hexahedron", []).append(nodes)
        elif place == 1:
            up = [min(nodes, key=lambda k, q=q: np.linalg.norm(points[k] - q)) for q in ordered(x)]
            kinds.setdefault("wedge", []).extend(
                [[up[k] for k in own] for own in ((0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7))]
            )
        else:
            points.append(x.mean(axis=0))
            for face in CELLS["hexahedron"].shape.faces:
                base = [nodes[k] for k in face][::-1]
                side = np.abs(np.array([points[k][1] for k in base])).min() > 0.02
                own = [[base[0], base[1], base[2]], [base[0], base[2], base[3]]] if side else [base]
                for each in own:
                    kinds.setdefault("tetra" if side else "pyramid", []).append([*each, len(points) - 1])
    blocks = [(kind, np.array(cells)) for kind, cells in kinds.items()]
    x = np.array(points)
    return (x, blocks) if order == 1 else with_middles(x, blocks)


def ordered(x: Array) -> Array:
    """Return the corners of a box, those of its lower side first."""
    low, high = x.min(axis=0), x.max(axis=0)
    return np.array(
        [
            np.where(bits, high, low)
            for bits in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
        ]
    )


def with_middles(x: Array, blocks: Blocks) -> tuple[Array, Blocks]:
    """Return cells of second order with straight edges."""
    points, between, found = list(x), dict[tuple[int, int], int](), []
    of_second = {
        kind: next(c.name for c in CELLS.values() if c.order == 2 and c.shape.name == kind) for kind, _ in blocks
    }
    for kind, cells in blocks:
        rows = []
        for nodes in cells.tolist():
            for a, b in CELLS[kind].shape.edges:
                key = min(nodes[a], nodes[b]), max(nodes[a], nodes[b])
                if key not in between:
                    between[key] = len(points)
                    points.append((x[key[0]] + x[key[1]]) / 2)
            mids = [between[min(nodes[a], nodes[b]), max(nodes[a], nodes[b])] for a, b in CELLS[kind].shape.edges]
            rows.append([*nodes, *mids])
        found.append((of_second[kind], np.array(rows)))
    return np.array(points), found


def model(order: int, bend: float = 0.0, n: int = 8) -> tuple[FEModel, int]:
    x, blocks = mixed(order, n)
    x = x + bend * np.column_stack([0 * x[:, 0], 0 * x[:, 0], x[:, 0] ** 2])
    raw = RawMesh(x, blocks, {}, {"end": np.flatnonzero(x[:, 0] == 0)})
    mesh = solid_mesh(split_mixed(raw), 1.0)
    assert len({kind for kind, _ in blocks}) == 4
    return assemble(mesh, 2, ALUMINIUM), len(x)


@pytest.mark.parametrize("order", [1, 2])
def test_a_mixed_bar_has_its_volume_and_its_file_nodes_and_stretches_evenly(order: int) -> None:
    fe, n = model(order)
    mesh = fe.discretisation.mesh
    assert mesh.volume == pytest.approx(np.prod(SIZE), rel=1e-12)
    assert mesh.points[:n] == pytest.approx(mixed(order)[0], abs=0)
    assert "several kinds" in mesh.notes[0]
    assert f"{len(mesh.cells)} tetrahedra of second order" in mesh.notes[0]
    x = fe.x
    inside = (np.abs(x[:, 1]) < 0.02) & (np.abs(x[:, 2]) < 0.019) & (x[:, 0] > 0.001) & (x[:, 0] < 0.399)
    forces = (fe.K @ (x @ np.random.default_rng(2).normal(size=(3, 3))).ravel()).reshape(-1, 3)
    assert inside.sum() > 20
    assert np.abs(forces[inside]).max() < 1e-11 * np.abs(forces).max()  # no cracks between the kinds


def test_frequencies_of_a_mixed_bar_converge_to_those_of_hexahedra() -> None:
    fine = SolidMesh(*hexahedral_bar(*SIZE, (20, 4, 4)))
    wanted = FreeBodySolver(assemble(fine, 2, ALUMINIUM)).modes(6).omega
    coarse, half = (FreeBodySolver(model(1, n=n)[0]).modes(6).omega / wanted - 1 for n in (8, 12))
    assert coarse[:2] == pytest.approx(0, abs=3e-3)
    assert half == pytest.approx(0, abs=6e-3)
    assert (half < coarse * (8 / 12) ** 2.5).all()


def test_curved_sides_stay_curved() -> None:
    fe, _ = model(2, bend=0.5)
    assert fe.discretisation.mesh.volume == pytest.approx(np.prod(SIZE), rel=1e-6)  # sheared, section by section


def test_hexahedra_beside_tetrahedra_without_pyramids_are_refused() -> None:
    x = np.array([[i, j, k] for i in (0.0, 1.0, 2.0) for j in (0.0, 1.0) for k in (0.0, 1.0)])
    hexahedron = np.array([[0, 4, 6, 2, 1, 5, 7, 3]])
    apart = np.array([[5, 6, 7, 11], [4, 5, 6, 8]])  # on the diagonal from 5 to 6, the other is from 4
    raw = RawMesh(x, [("hexahedron", hexahedron), ("tetra", apart)])
    with pytest.raises(MeshFileError, match=r"2 triangular facets of elements lie on quadrilateral ones"):
        split_mixed(raw)


def test_a_deck_of_a_hexahedron_and_a_wedge_has_its_sets(tmp_path: Path) -> None:
    deck = """*NODE
1,0,0,0
2,1,0,0
3,1,1,0
4,0,1,0
5,0,0,1
6,1,0,1
7,1,1,1
8,0,1,1
9,2,0,0
10,2,0,1
*ELEMENT, TYPE=C3D8, ELSET=BLOCK
1,1,2,3,4,5,6,7,8
*ELEMENT, TYPE=C3D6, ELSET=ROOF
2,2,9,3,6,10,7
*SURFACE, NAME=TOP
1,S2
2,S2
*SURFACE, NAME=SIDE
BLOCK,S6
"""
    (tmp_path / "house.inp").write_text(deck)
    mesh = read_mesh(tmp_path / "house.inp", 1.0)
    assert {name: len(cells) for name, cells in mesh.parts.items()} == {"BLOCK": 6, "ROOF": 3}
    assert mesh.volume == pytest.approx(1.5, rel=1e-12)
    for name, area, axis, place in (("TOP", 1.5, 2, 1.0), ("SIDE", 1.0, 0, 0.0)):
        x = mesh.points[mesh.faces[name]]
        assert (np.abs(x[..., axis] - place) < 1e-12).all()
        across = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        assert np.linalg.norm(across, axis=1).sum() / 2 == pytest.approx(area, rel=1e-12)
    (tmp_path / "bad.inp").write_text(deck.replace("2,2,9,3,6,10,7", "2,2,9,3,6,10,17"))
    with pytest.raises(InputError, match="node 17, which isn't there"):
        read_mesh(tmp_path / "bad.inp", 1.0)
