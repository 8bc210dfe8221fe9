"""Links and masses of decks: the same bracket from Abaqus and Nastran decks, springs, equations, chains of links."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.fem import assembly
from fmd.fem.assembly import assemble
from fmd.fem.cells.table import CELLS
from fmd.fem.deck_links import find_deck_links
from fmd.fem.formats.import_mesh import read_mesh
from fmd.fem.links import Linked, LinkedFace, LinkedModel, LumpedMass, link_points
from fmd.fem.markers import face_marker, weighted_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.selection import nodes_on_faces
from fmd.fem.space import Discretisation
from fmd.meshes.bar import hexahedral_bar
from fmd.reduction.eigen import FreeBodySolver

BRACKET = Path(__file__).parents[1] / "fem" / "formats" / "decks" / "bracket.inp"
ALUMINIUM = Material(70e9, 0.33, 2700.0)
# CalculiX 2.20: *RIGID BODY of the nodes of BORE, MASS of 0.4 kg on its reference node, nodes of FOOT fixed.
CALCULIX_HZ = [375.066, 640.655, 1624.415, 7594.937, 20453.998, 22452.978]
# MYSTRAN 17.0 (77d970d): RBE3 of the nodes of BORE, all with weight 1, a CONM2 of 0.4 kg on its reference, FOOT fixed.
# RBE2 in place of that gives the frequencies of CalculiX, in all of its seven digits.
MYSTRAN_HZ = [343.2448, 522.4164, 1157.832, 6947.647, 13439.53, 13830.5]
RIGID_BODY = """*NODE, NSET=MOTOR
9001, 0.042, 0.0, 0.03
*RIGID BODY, NSET=BORE, REF NODE=9001
*ELEMENT, TYPE=MASS, ELSET=LUMP
90001, 9001
*MASS, ELSET=LUMP
0.4
"""


def nastran(mesh: SolidMesh, *cards: str, scale: float = 1.0) -> str:
    """Write a mesh as bulk data, its grid points from 1 on, and cards behind."""
    lines = ["BEGIN BULK"]
    lines += [f"GRID,{k},,{x!r},{y!r},{z!r}" for k, (x, y, z) in enumerate((mesh.points / scale).tolist(), start=1)]
    cell = CELLS[mesh.cell_type]
    order = np.argsort(cell.nastran_order) if cell.nastran_order else np.arange(len(cell.nodes))
    for number, nodes in enumerate(mesh.cells[:, order] + 1, start=1):
        fields = [cell.nastran[0], str(number), "1", *map(str, nodes)]
        lines += [",".join(("+", *fields[k : k + 8]) if k > 1 else fields[:9]) for k in (1, *range(9, len(fields), 8))]
    return "\n".join([*lines, *cards, "ENDDATA", ""])


def long_card(name: str, *fields: object) -> str:
    """Return a card of free fields over as many lines as it takes."""
    rows = [fields[k : k + 8] for k in range(0, len(fields), 8)]
    return "\n".join(",".join(map(str, (name if k == 0 else "+", *row))) for k, row in enumerate(rows))


def on_face(mesh: SolidMesh, face: str) -> IntArray:
    return nodes_on_faces(Discretisation(mesh, mesh.order), [mesh.faces[face]])


def linked(mesh: SolidMesh, mass_order: int | None = None, material: Material = ALUMINIUM) -> LinkedModel:
    """Return the model of a deck; masses integrated as by CalculiX if an order is given."""
    space = Discretisation(mesh, mesh.order)
    if mass_order is None:
        fe = assemble(mesh, mesh.order, material)
    else:
        space.__dict__["kind"] = replace(space.kind, mass_order=mass_order)
        fe = FEModel(space, material, assembly._stiffness(space, material), assembly._mass(space, material))
    assert mesh.connections is not None
    return link_points(fe, find_deck_links(mesh.connections, fe))


def clamped_hz(model: FEModel, nodes: IntArray, count: int = 6) -> Array:
    fixed = (3 * nodes[:, None] + np.arange(3)).ravel()
    return np.asarray(FreeBodySolver(model, fixed=fixed).modes(count).omega / (2 * np.pi))


def test_a_rigid_body_with_a_mass_has_the_frequencies_of_calculix_from_decks_of_abaqus_and_nastran(
    tmp_path: Path,
) -> None:
    path = tmp_path / "bracket.inp"
    path.write_text(BRACKET.read_text() + RIGID_BODY)
    mesh = read_mesh(path, 1.0)
    foot, bore = on_face(mesh, "FOOT"), mesh.faces["BORE"]
    model = linked(mesh, mass_order=2)
    assert np.round(clamped_hz(model, foot), 3).tolist() == CALCULIX_HZ
    assert model.marker("MOTOR").position == pytest.approx([0.042, 0.0, 0.03])
    assert model.marker("9001").nodes.tolist() == model.marker("motor".upper()).nodes.tolist()

    # in tonnes, millimetres and seconds; the mass hangs on a second point, on a bar of RBE2, RBAR and CONM2's offset
    cards = (
        "GRID,9001,,42.,0.,0.",
        "GRID,9002,,42.,0.,20.",
        long_card("RBE2", 1, 9001, 123456, *(bore + 1)),
        "RBAR,2,9001,9002,123456",
        "CONM2,3,9002,,4.-4,0.,0.,10.",
    )
    path = tmp_path / "bracket.bdf"
    path.write_text(nastran(mesh, *cards, scale=1e-3))
    other = linked(read_mesh(path, 1e-3, mass_unit=1e3, force_unit=1.0), mass_order=2)
    assert np.round(clamped_hz(other, foot), 3).tolist() == CALCULIX_HZ
    assert other.marker("9002").position == pytest.approx([0.042, 0.0, 0.02])


def dense(fe: FEModel, rows: Array, mass: Array, nodes: IntArray) -> Array:
    """Return the frequencies [Hz] of a clamped model with masses that move as rows (k, 3 n) of its displacements."""
    K, M = fe.K.toarray(), fe.M.toarray() + rows.T @ mass @ rows
    kept = np.setdiff1d(np.arange(len(K)), (3 * nodes[:, None] + np.arange(3)).ravel())
    return np.sqrt(eigh(K[np.ix_(kept, kept)], M[np.ix_(kept, kept)], eigvals_only=True)[:6]) / (2 * np.pi)


def test_an_average_link_of_nastran_weights_its_points_as_its_card_says(
    tmp_path: Path, box_mesh: Callable[..., SolidMesh]
) -> None:
    """Dense: least squares of the weighted displacements, by the normal equations of six rigid motions."""
    mesh = box_mesh("hexahedron", (3, 2, 2))
    end = np.flatnonzero(mesh.points[:, 0] == mesh.points[:, 0].max())
    root = np.flatnonzero(mesh.points[:, 0] == 0.0)
    weights, at = 1.0 + np.arange(len(end)) % 3, np.array([1.5, 0.2, 0.1])
    runs = [field for w in (1.0, 2.0, 3.0) for field in (w, 123, *(end[weights == w] + 1))]
    cards = (
        f"GRID,1000,,{at[0]},{at[1]},{at[2]}",
        long_card("RBE3", 5, "", 1000, 123456, *runs),
        long_card("CONM2", 6, 1000, 0, 300.0, "", "", "", "", 10.0, 1.0, 20.0, 2.0, 3.0, 30.0),
    )
    path = tmp_path / "box.bdf"
    path.write_text(nastran(mesh, *cards))
    found = read_mesh(path, 1.0)
    assert found.points == pytest.approx(mesh.points)
    model = linked(found)
    S = np.concatenate([np.tile(np.eye(3), (len(end), 1, 1)), np.zeros((len(end), 3, 3))], axis=2)
    for k, r in enumerate(mesh.points[end] - at):
        S[k, :, 3:] = -np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    normal = np.einsum("k,kai,kaj->ij", weights, S, S)
    rows = np.zeros((6, 3 * len(mesh.points)))
    for k, node in enumerate(end):
        rows[:, 3 * node : 3 * node + 3] = np.linalg.solve(normal, weights[k] * S[k].T)
    J = np.array([[10.0, -1.0, -2.0], [-1.0, 20.0, -3.0], [-2.0, -3.0, 30.0]])
    mass = np.block([[300.0 * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), J]])
    assert clamped_hz(model, root) == pytest.approx(dense(assemble(mesh, 1, ALUMINIUM), rows, mass, root), rel=1e-8)


def test_a_mass_on_an_average_link_has_the_frequencies_of_mystran(tmp_path: Path) -> None:
    bracket = read_mesh(BRACKET, 1.0)
    bore, foot = on_face(bracket, "BORE") + 1, on_face(bracket, "FOOT")
    path = tmp_path / "bracket.bdf"
    rbe3 = long_card("RBE3", 1, "", 9001, 123456, 1.0, 123, *bore)
    path.write_text(nastran(bracket, "GRID,9001,,0.042,0.,0.03", rbe3, "CONM2,2,9001,,0.4"))
    hz = clamped_hz(linked(read_mesh(path, 1.0), mass_order=2), foot)
    assert [float(f"{f:.7g}") for f in hz] == MYSTRAN_HZ


@pytest.mark.parametrize(("spider", "square"), [(True, 999.269), (False, 994.307)])
def test_a_mass_on_a_spider_or_on_nodes_has_the_frequency_that_moose_gives(
    tmp_path: Path, spider: bool, square: float
) -> None:
    """Pull request 33820 of idaholab/moose: 5 × 1 × 1, 10 × 3 × 3 linear hexahedra, E 1e6, nu 0.3, rho 1, mass 1."""
    mesh = SolidMesh(*hexahedral_bar(5.0, 1.0, 1.0, (10, 3, 3)))
    end, root = on_face(mesh, "x+"), on_face(mesh, "x-")
    at = mesh.points[end].mean(axis=0)
    cards = [f"CONM2,{2 + k},{node},,{1 / 16}" for k, node in enumerate(end + 1)]
    if spider:
        cards = [
            f"GRID,500,,{at[0]},{at[1]},{at[2]}",
            long_card("RBE2", 1, 500, 123456, *(end + 1)),
            "CONM2,2,500,,1.0",
        ]
    path = tmp_path / "bar.bdf"
    path.write_text(nastran(mesh, *cards))
    found = read_mesh(path, 1.0)
    fe = assemble(found, 1, Material(1e6, 0.3, 1.0), "plain")
    assert found.connections is not None
    model = link_points(fe, find_deck_links(found.connections, fe))
    omega = 2 * np.pi * clamped_hz(model, root, 1)
    assert round(float(omega[0] ** 2), 3) == square
    assert model.mass == pytest.approx(5.0 + 1.0)


def test_a_distributing_coupling_is_an_average_link_by_areas_and_a_surface_of_nodes_one_by_nodes(
    tmp_path: Path, box_mesh: Callable[..., SolidMesh]
) -> None:
    mesh = box_mesh("hexahedron", (3, 2, 2))
    end = np.flatnonzero(mesh.points[:, 0] == mesh.points[:, 0].max())
    deck = ["*NODE", *(f"{k},{x!r},{y!r},{z!r}" for k, (x, y, z) in enumerate(mesh.points.tolist(), start=1))]
    deck += ["*ELEMENT, TYPE=C3D8, ELSET=ALL"]
    deck += [", ".join(map(str, [k, *(cell + 1)])) for k, cell in enumerate(mesh.cells, start=1)]
    deck += ["*NSET, NSET=END", ", ".join(map(str, end + 1))]
    deck += ["*NODE, NSET=HUB", "1000, 1.5, 0.2, 0.1"]
    deck += ["*ELEMENT, TYPE=MASS, ELSET=LUMP", "1000, 1000", "*MASS, ELSET=LUMP", "300.0"]
    deck += ["*ELEMENT, TYPE=ROTARYI, ELSET=TURN", "1001, 1000"]
    deck += ["*ROTARY INERTIA, ELSET=TURN", "10., 20., 30., -1., -2., -3."]
    root = np.flatnonzero(mesh.points[:, 0] == 0.0)
    found = []
    for surface in ("*SURFACE, NAME=FACE, TYPE=NODE\nEND,", "*SURFACE, NAME=FACE\n" + _facets_of(mesh, end)):
        path = tmp_path / "box.inp"
        coupling = "*COUPLING, REF NODE=HUB, SURFACE=FACE, CONSTRAINT NAME=BOLT\n*DISTRIBUTING\n"
        path.write_text("\n".join([*deck, surface, coupling]))
        found.append(clamped_hz(linked(read_mesh(path, 1.0)), root))
    fe = assemble(mesh, 1, ALUMINIUM)
    at, J = np.array([1.5, 0.2, 0.1]), np.array([[10.0, -1.0, -2.0], [-1.0, 20.0, -3.0], [-2.0, -3.0, 30.0]])
    mass = LumpedMass("hub", 300.0, at, J)
    markers = [
        weighted_marker(end, mesh.points[end], np.ones(len(end))),
        face_marker(fe.discretisation, end),
    ]
    for hz, marker in zip(found, markers, strict=True):
        model = link_points(fe, Linked({"hub": LinkedFace(marker, at)}, [mass]))
        assert hz == pytest.approx(clamped_hz(model, root), rel=1e-9)
    assert abs(found[0][0] / found[1][0] - 1) > 1e-4  # they are two links


def _facets_of(mesh: SolidMesh, nodes: IntArray) -> str:
    """Return the lines of a surface of Abaqus's faces of hexahedra whose corners are all among nodes."""
    rows = []
    for number, cell in enumerate(mesh.cells, start=1):
        for side, corners in enumerate(CELLS["hexahedron"].shape.abaqus_faces, start=1):
            if np.isin(cell[list(corners)], nodes).all():
                rows.append(f"{number}, S{side}")
    assert rows
    return "\n".join(rows)


def test_springs_and_equations_between_two_boxes_are_those_of_dense_algebra(
    tmp_path: Path, box_mesh: Callable[..., SolidMesh]
) -> None:
    """Two boxes of one deck, apart: their touching nodes are tied by equations along x and by springs across."""
    one = box_mesh("hexahedron", (2, 1, 1))
    length, n = float(one.points[:, 0].max()), len(one.points)
    points = np.concatenate([one.points, one.points + np.array([length, 0.0, 0.0])])
    mesh = SolidMesh(points, np.concatenate([one.cells, one.cells + n]), "hexahedron", {}, {})
    left = np.flatnonzero(np.abs(points[:n, 0] - length) < 1e-12)
    right = np.array([n + np.linalg.norm(points[n:] - points[k], axis=1).argmin() for k in left])
    k, cards = 4e7, []
    for i, (a, b) in enumerate(zip(left + 1, right + 1, strict=True)):
        cards += [long_card("MPC", 1, a, 1, 1.0, b, 1, -1.0)]
        cards += [f"CELAS2,{10 * i + d},{k},{a},{d},{b},{d}" for d in (2, 3)]
    path = tmp_path / "boxes.bdf"
    path.write_text(nastran(mesh, *cards))
    model = linked(read_mesh(path, 1.0))
    root = np.flatnonzero(points[:, 0] == 0.0)
    fe = assemble(mesh, 1, ALUMINIUM)
    K, M, T = fe.K.toarray(), fe.M.toarray(), np.eye(6 * n)
    for a, b in zip(left, right, strict=True):
        T[3 * a] = T[3 * b]
        for d in (1, 2):
            row = np.zeros(6 * n)
            row[3 * a + d], row[3 * b + d] = 1.0, -1.0
            K += k * np.outer(row, row)
    kept = np.setdiff1d(np.arange(6 * n), np.concatenate([3 * left, (3 * root[:, None] + np.arange(3)).ravel()]))
    T = T[:, kept]
    exact = np.sqrt(eigh(T.T @ K @ T, T.T @ M @ T, eigvals_only=True)[:6]) / (2 * np.pi)
    assert clamped_hz(model, root) == pytest.approx(exact, rel=1e-9)
    assert FreeBodySolver(model).modes(4).n_rigid == 6


def test_equations_that_hang_on_one_another_give_their_first_terms(tmp_path: Path) -> None:
    """An edge whose nodes are each in the middle of two others, in any order of numbers, is a straight line."""
    mesh = SolidMesh(*hexahedral_bar(0.8, 0.1, 0.1, (8, 1, 1)))
    x = mesh.points
    edge = np.flatnonzero((x[:, 1] < 0) & (x[:, 2] < 0))
    edge = edge[np.argsort(x[edge, 0])] + 1
    halves = [(4, 0, 8), (2, 0, 4), (6, 8, 4), (1, 2, 0), (3, 2, 4), (5, 6, 4), (7, 8, 6)]
    cards = [
        long_card("MPC", 1, edge[a], d, 1.0, edge[b], d, -0.5, "", "", edge[c], d, -0.5)
        for a, b, c in halves
        for d in (1, 2, 3)
    ]
    path = tmp_path / "bar.bdf"
    path.write_text(nastran(mesh, *cards))
    model = linked(read_mesh(path, 1.0))
    fe = assemble(mesh, 1, ALUMINIUM)
    T = np.eye(3 * len(x))
    for k in range(1, 8):
        rows = 3 * (edge[k] - 1) + np.arange(3)
        T[rows] = (1 - k / 8) * T[3 * (edge[0] - 1) + np.arange(3)] + k / 8 * T[3 * (edge[8] - 1) + np.arange(3)]
    root = np.flatnonzero(x[:, 0] == 0.0)
    given = (3 * (np.concatenate([edge[1:8] - 1, root])[:, None]) + np.arange(3)).ravel()
    T = np.delete(T, given, axis=1)
    exact = np.sqrt(eigh(T.T @ fe.K @ T, T.T @ fe.M @ T, eigvals_only=True)[:6]) / (2 * np.pi)
    assert clamped_hz(model, root) == pytest.approx(exact, rel=1e-9)


def test_a_mass_on_springs_is_an_absorber(tmp_path: Path, box_mesh: Callable[..., SolidMesh]) -> None:
    """Three springs to a corner hold a point mass, whose rotations move nothing and are left out: m 2 kg, k 800 N/m."""
    mesh = box_mesh("hexahedron", (2, 1, 1))
    root = np.flatnonzero(mesh.points[:, 0] == 0.0)
    corner = len(mesh.points) - 1
    x, y, z = mesh.points[corner].tolist()
    cards = [f"GRID,900,,{x!r},{y!r},{z!r}", "CONM2,1,900,,2.0", "PELAS,7,800.0"]
    cards += [f"CELAS1,{10 + d},7,{corner + 1},{d},900,{d}" for d in (1, 2, 3)]
    path = tmp_path / "box.bdf"
    path.write_text(nastran(mesh, *cards))
    hz = clamped_hz(linked(read_mesh(path, 1.0)), root, 3)
    assert hz == pytest.approx(np.full(3, np.sqrt(800.0 / 2.0) / (2 * np.pi)), rel=1e-4)  # the box is far stiffer


@pytest.mark.parametrize(
    ("cards", "message"),
    [
        (["RBE2,1,900,12,1,2,3"], "RBE2 1 ties its points in 12"),
        (["RBE2,1,901,123456,1,2,3"], "RBE2 1 names point 901, which isn't there"),
        (["RBE2,1,900,123456,1,2,3", "RBE2,2,8,123456,3,4"], "a node is moved by two links"),
        (["RBE2,1,900,123456,1,2", "CONM2,2,900,,1.0"], "900 carries a mass that nothing holds in all directions"),
        (["CONM2,2,900,,1.0"], "900 carries a mass that nothing holds in all directions"),
        (["CONM2,2,1,,1.0,.1"], "CONM2 2 has an offset or inertia at a node of the solid"),
        (["CONM2,2,1,5,1.0"], "CONM2 2 is in coordinate system 5"),
        (["RBE3,1,,900,123456,1.0,123,1,2"], "RBE3 1 follows nodes that lie on a line"),
        (["RBE3,1,,900,123456,1.0,123456,1,2,3"], "RBE3 1 follows its points in 123456"),
        (["RBE3,1,,900,123,1.0,123,1,2,3", "CONM2,2,900,,1.0,.1"], "RBE3 1 doesn't turn its point, where CONM2 2"),
        (["RBE3,1,,900,123,1.0,123,1,2,3", "RBE2,2,900,123456,4,5,6"], "RBE3 1 doesn't turn its point, on which RBE2"),
        ([f"RBE3,{k},,900,123456,1.0,123,1,2,3" for k in (1, 2)], "RBE3 1 and RBE3 2 move the same point"),
        (["RBE3,1,,900,123456,1.0,123,1,2,+", "+,5", "RBE2,2,900,123456,1,3"], "hang on one another in a circle"),
        (["CELAS2,1,10.0,1,1"], "CELAS2 1 has one end on the ground"),
        (["CELAS2,1,10.0,1,2,8,2"], "CELAS2 1 resists rigid motions"),
        (["CELAS1,1,4,1,1,2,1"], "names PELAS 4, which isn't there"),
        (["MPC,1,1,1,1.0"], "MPC 1 resists rigid motions"),
        (["MPC,1,1,4,1.0,2,4,-1.0"], "MPC 1 has a rotation at node 1"),
        (["MPC,1,1,1,1.0,2,1,-1.", "MPC,2,1,1,1.0,2,1,-1."], "several sets of MPC: 1, 2"),
        (["RBAR,1,1,2,123,123"], "independent components at both ends"),
        (["RBE1,1,1,123456,2,123"], r"aren't solid \(1 RBE1\)"),
    ],
)
def test_connections_that_are_not_read_or_make_no_sense_are_refused_by_name(
    tmp_path: Path, box_mesh: Callable[..., SolidMesh], cards: list[str], message: str
) -> None:
    path = tmp_path / "box.bdf"
    path.write_text(nastran(box_mesh("hexahedron", (1, 1, 1)), "GRID,900,,2.,.5,.5", *cards))
    with pytest.raises((ValueError, InputError), match=message):
        linked(read_mesh(path, 1.0))


def test_masses_and_springs_take_the_files_units(tmp_path: Path, box_mesh: Callable[..., SolidMesh]) -> None:
    path = tmp_path / "box.bdf"
    path.write_text(nastran(box_mesh("hexahedron", (1, 1, 1)), "CONM2,2,1,,1.0-3", "CELAS2,3,5.0,1,1,1,2", scale=1e-3))
    with pytest.raises(InputError, match=r"has CONM2 2; say the file's unit, mesh.mass_unit = 'kg' or 't'"):
        read_mesh(path, 1e-3)
    with pytest.raises(InputError, match=r"has CELAS2 3; say the file's unit, mesh.force_unit = 'N'"):
        read_mesh(path, 1e-3, mass_unit=1e3)
    found = read_mesh(path, 1e-3, mass_unit=1e3, force_unit=1.0).connections
    assert found is not None
    assert found.masses[0].mass == pytest.approx(1.0)
    assert found.springs[0].stiffness == pytest.approx(5e3)
