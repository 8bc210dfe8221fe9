"""Links and masses on shells: against dense algebra, rotors in the textbook, and shells that the same file links."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import eigh, null_space

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.core.rotations import rigid_motions
from fmd.fem.assembly import assemble
from fmd.fem.deck_links import find_deck_links
from fmd.fem.formats.import_joined import read_structure
from fmd.fem.formats.import_shell import GivenSections
from fmd.fem.links import Linked, LinkedFace, LinkedModel, LumpedMass, link_points
from fmd.fem.local_markers import single_node_marker
from fmd.fem.markers import face_marker
from fmd.fem.material import Material
from fmd.fem.model import FEModel
from fmd.fem.thicken import Sheet, thicken
from fmd.meshes.tube import sheet
from fmd.reduction.body import supported_body
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.rotating import rotating_modes
from fmd.reduction.stiffening import stiffen_body
from tests.fem.formats.test_import_shell import panel, write_abaqus, write_nastran
from tests.reduction.test_links import rotor_frequencies

STEEL = Material(210e9, 0.3, 7850.0)
AT = np.array([0.32, 0.09, 0.05])  # of the reference [m]
OFFSET, MASS = np.array([0.01, 0.02, 0.03]), 0.5
J = np.diag([1e-3, 2e-3, 1.5e-3])
MOTOR = (
    "GRID,900,,{:g},{:g},{:g}".format(*AT * 1e3),
    "CONM2,901,900,0,0.5,10.,20.,30.\n+,1000.,0.,2000.,0.,0.,1500.",
)


def model_of(path: Path, cards: tuple[str, ...] = MOTOR) -> LinkedModel:
    """Return the model of a panel in a deck of Nastran with cards beside it."""
    x, cells = panel()
    write_nastran(path, x, {"CQUAD4": cells}, "\n".join(cards))
    mesh = read_structure(path, 1e-3, GivenSections(2e-3), units=(1.0, 1.0))
    fe = assemble(mesh, 1, STEEL)
    assert mesh.connections is not None
    return link_points(fe, find_deck_links(mesh.connections, fe))


def end_nodes() -> IntArray:
    """Return five nodes at the panel's end, which don't lie on a line."""
    x, _ = panel()
    middle = np.abs(x[:, 1] - 100.0) < 1.0
    return np.flatnonzero(np.abs(x[:, 0] - np.where(middle, 250.0, 300.0)) < 1.0)


def rows_of(T: Array, points: IntArray) -> Array:
    return T[(3 * points[:, None] + np.arange(3)).ravel()]


def dense_frequencies(fe: FEModel, g_rows: Array, g_of: Array, count: int = 8) -> Array:
    """Return ω of the free shell with a body on a grid point g (6), where ``g_rows y = g_of g``."""
    T = fe.T.toarray()  # type: ignore[union-attr]
    C = np.concatenate([g_rows, -g_of], axis=1)
    N = null_space(C / np.abs(C).max(axis=1, keepdims=True))
    n = T.shape[1]
    S = rigid_motions(OFFSET[None])[0]  # of the centre of mass, by g
    body = MASS * S.T @ S
    body[3:, 3:] += J
    K, M = np.zeros((n + 6, n + 6)), np.zeros((n + 6, n + 6))
    K[:n, :n], M[:n, :n] = T.T @ fe.K @ T, T.T @ fe.M @ T
    M[n:, n:] = body
    return np.sqrt(np.abs(eigh(N.T @ K @ N, N.T @ M @ N, eigvals_only=True)[6 : 6 + count]))


@pytest.mark.parametrize("link", ["RBE2 123456", "RBE2 123", "RBE3"])
def test_links_of_a_shells_deck_are_those_of_dense_algebra(tmp_path: Path, link: str) -> None:
    """RBE2 on 123456 turns the directors of its nodes, on 123 it leaves them, RBE3 follows the nodes in the mean."""
    nodes = end_nodes()
    n = [int(node) + 1 for node in nodes]
    if link == "RBE3":
        card = f"RBE3,5,,900,123456,1.,123,{n[0]},{n[1]}\n+,{n[2]},2.,123,{n[3]},{n[4]}"
    else:
        card = f"RBE2,5,900,{link.split()[1]},{','.join(map(str, n))}"
    model = model_of(tmp_path / "panel.bdf", (*MOTOR, card))
    found = FreeBodySolver(model).modes(8).omega

    fe = assemble(read_structure(tmp_path / "panel.bdf", 1e-3, GivenSections(2e-3), units=(1.0, 1.0)), 1, STEEL)
    midsurface, T = fe.discretisation.mesh.midsurface, fe.T.toarray()  # type: ignore[union-attr]
    assert midsurface is not None
    own = len(midsurface.owner) + nodes
    if link == "RBE3":
        weights = np.array([1.0, 1.0, 1.0, 2.0, 2.0])
        S = rigid_motions(fe.x[own] - AT)
        normal = np.einsum("k,kai,kaj->ij", weights, S, S)
        D = np.linalg.solve(normal, np.einsum("k,kai->ika", weights, S).reshape(6, -1))
        exact = dense_frequencies(fe, D @ rows_of(T, own), np.eye(6))
    else:
        faces = np.flatnonzero(np.isin(midsurface.owner, nodes))
        tied = own if link == "RBE2 123" else np.concatenate([own, faces])
        exact = dense_frequencies(fe, rows_of(T, tied), rigid_motions(fe.x[tied] - AT).reshape(-1, 6))
    assert found == pytest.approx(exact, rel=1e-7)
    assert model.marker("900").position == pytest.approx(AT)


def test_a_mass_beside_a_shells_node_turns_as_the_elements_around_it(tmp_path: Path) -> None:
    node = end_nodes()[3]
    mass = f"CONM2,901,{node + 1},0,0.5,10.,20.,30.\n+,1000.,0.,2000.,0.,0.,1500."
    model = model_of(tmp_path / "panel.bdf", (mass,))
    fe = assemble(read_structure(tmp_path / "panel.bdf", 1e-3, GivenSections(2e-3), units=(1.0, 1.0)), 1, STEEL)
    marker = single_node_marker(fe.discretisation, len(fe.discretisation.x) + node)
    D = marker.columns(len(fe.x), np.eye(3)).reshape(-1, 6).T @ fe.T
    assert FreeBodySolver(model).modes(8).omega == pytest.approx(dense_frequencies(fe, D, np.eye(6)), rel=1e-7)
    x, own = model.x, fe.x
    R, shell = rigid_motions(x).reshape(-1, 6), rigid_motions(own).reshape(-1, 6)
    centre = marker.position + OFFSET
    S = rigid_motions(centre[None])[0]
    whole = shell.T @ (fe.M @ shell) + MASS * S.T @ S
    whole[3:, 3:] += J
    found = R.T @ (model.M @ R)
    assert found == pytest.approx(whole, rel=1e-9, abs=1e-12)


def test_rigid_bodies_of_abaqus_are_those_of_nastran_with_pins_or_without(tmp_path: Path) -> None:
    x, cells = panel()
    ends = ", ".join(str(node + 1) for node in end_nodes())
    at = "{:g}, {:g}, {:g}".format(*AT * 1e3)
    for key, directions in (("TIE NSET", 123456), ("PIN NSET", 123), ("NSET", 123)):
        cards = (MOTOR[0], "CONM2,901,900,0,0.5", f"RBE2,5,900,{directions},{ends}")
        nastran = model_of(tmp_path / "panel.bdf", cards)
        more = f"*NODE\n900, {at}\n*NSET, NSET=END\n{ends}\n*RIGID BODY, REF NODE=900, {key}=END\n"
        more += "*ELEMENT, TYPE=MASS, ELSET=M\n9000, 900\n*MASS, ELSET=M\n0.5"
        write_abaqus(tmp_path / "panel.inp", x, {"S4": cells}, more)
        mesh = read_structure(tmp_path / "panel.inp", 1e-3, GivenSections(2e-3), units=(1.0, None))
        assert mesh.notes[-1] == "links and masses of the file belong to the body: 1 *RIGID BODY, 1 MASS"
        assert mesh.connections is not None
        fe = assemble(mesh, 1, STEEL)
        abaqus = link_points(fe, find_deck_links(mesh.connections, fe))
        both = [FreeBodySolver(each).modes(6).omega for each in (nastran, abaqus)]
        assert both[0] == pytest.approx(both[1], rel=1e-9)
    more = f"*NSET, NSET=END\n{ends}\n*RIGID BODY, REF NODE=1, NSET=END\n"
    write_abaqus(tmp_path / "panel.inp", x, {"S4": cells}, more)
    with pytest.raises(InputError, match=r"BODY 1 has a node of shells or beams as REF NODE.*one of no element at its"):
        read_structure(tmp_path / "panel.inp", 1e-3, GivenSections(2e-3), units=(1.0, None))


def test_a_distributing_coupling_weights_a_shells_nodes_by_the_area_around_them(tmp_path: Path) -> None:
    x, cells = panel()
    more = "*NODE\n900, {:g}, {:g}, {:g}\n".format(*AT * 1e3)
    more += "*ELSET, ELSET=PAD\n21, 22, 23, 24\n*SURFACE, NAME=PAD\nPAD, SPOS\n*COUPLING, REF NODE=900, SURFACE=PAD\n"
    more += "*DISTRIBUTING\n1, 6\n*ELEMENT, TYPE=MASS, ELSET=M\n9000, 900\n*MASS, ELSET=M\n0.5"
    write_abaqus(tmp_path / "panel.inp", x, {"S4": cells}, more)
    mesh = read_structure(tmp_path / "panel.inp", 1e-3, GivenSections(2e-3), units=(1.0, None))
    assert mesh.connections is not None
    fe = assemble(mesh, 1, STEEL)
    (link,) = find_deck_links(mesh.connections, fe).links.values()
    share = dict(zip((link.marker.nodes - len(mesh.points)).tolist(), link.marker.translation_weights, strict=True))
    corners = np.unique(cells[20:24])
    once = [node for node in corners if (cells[20:24] == node).sum() == 1]
    assert sorted(share) == sorted(corners)
    assert sum(share[node] for node in once) == pytest.approx(0.25, rel=1e-2)  # an end each of four alike in a row


def test_masses_of_a_shells_deck_in_millimetres_ask_for_their_unit(tmp_path: Path) -> None:
    x, cells = panel()
    write_nastran(tmp_path / "panel.bdf", x, {"CQUAD4": cells}, "CONM2,901,5,0,0.5")
    with pytest.raises(InputError, match=r"say the file's unit, mesh\.mass_unit"):
        read_structure(tmp_path / "panel.bdf", 1e-3, GivenSections(2e-3))


@pytest.mark.parametrize("rigid", [True, False])
def test_a_disc_on_a_spinning_tube_of_shells_whirls_as_in_the_textbook(rigid: bool) -> None:
    """The disc's arms, and those of the shell's points that a rigid link carries, move in second order."""
    division = SimpleNamespace(divisions=(4, 14), element="quadrilateral")
    points, cells, edges, sides = sheet(SimpleNamespace(length=0.3, radius=0.01, mesh=division))
    mesh = thicken(Sheet(points, cells, np.full(len(cells), 0.002), {}, edges, {}, sides))
    fe = assemble(mesh, 1, Material(200e9, 0.3, 1e-4))
    mass, across, polar, rate = 5.0, 0.02, 0.04, 600.0
    at = np.array([0.32, 0.0, 0.0])
    link = LinkedFace(face_marker(fe.discretisation, mesh.faces["x+"], rigid), at)
    disc = LumpedMass("end", mass, at, np.diag([polar, across, across]))
    model = link_points(fe, Linked({"end": link}, [disc]))
    fixed = (3 * np.flatnonzero(np.abs(fe.x[:, 0]) < 1e-9)[:, None] + np.arange(3)).ravel()
    solver = FreeBodySolver(model, fixed=fixed)
    markers = {"foot": face_marker(fe.discretisation, mesh.faces["x-"]), "disc": model.marker("end")}
    loads = markers["disc"].columns(len(model.x), np.eye(3))[:, :, [1, 5]]
    flexibility = np.einsum("iak,ial->kl", loads, solver.static_response(loads))
    pairs = solver.modes(6)
    body = supported_body(model, pairs.omega, pairs.shapes, markers, "foot", np.zeros((0, 3)))
    axis = np.array([1.0, 0.0, 0.0])
    whole = stiffen_body(body, model, solver, None, moving=markers, elements=False)
    exact = np.abs(rotor_frequencies(flexibility, mass, across, polar, rate) - rate)
    found = rotating_modes(whole, axis, rate)
    mine = 2 * np.pi * found.frequencies_hz
    assert all(np.abs(mine - omega).min() < 1e-5 * omega for omega in exact)
    stiffened = rotating_modes(stiffen_body(body, model, solver, None, moving=markers), axis, rate)
    assert stiffened.frequencies_hz[:4] == pytest.approx(found.frequencies_hz[:4], rel=1e-4)  # nothing pulls the tube
    assert rotating_modes(body, axis, rate).growth.max() > 10.0
