"""Solids beside shells and beams in one body, from a deck to modes, motion and stress."""

from itertools import count, pairwise
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

import fmd
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.fem.formats.export import write_mesh
from fmd.fem.geometric_stiffness import reduced_geometric_stiffness
from fmd.fem.joined import JoinedSpace
from fmd.fem.model import FEModel
from fmd.output.formats import write_format
from fmd.output.frequencies import mode_warnings
from fmd.output.plies import summarise_plies
from fmd.reduction.body import supported_body
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.rotating import rotating_modes
from fmd.reduction.stiffening import stiffen_body
from fmd.scene.stress_outputs import Plies
from fmd.stages.part import FlexiblePart
from tests.reduction.test_links import rotor_frequencies

METAL = {"E": "70 GPa", "nu": 0.33, "rho": "2700 kg/m^3"}
RING = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]


class Deck:
    """A deck of Abaqus, made piece by piece."""

    def __init__(self) -> None:
        self.nodes: list[Array] = []
        self.elements: dict[str, list[list[int]]] = {}
        self.sets: dict[str, list[int]] = {}
        self.more: list[str] = []
        self.towards = [0.0, 1.0, 0.0]  # in the plane of the first axis of the beams' section

    def node(self, *x: float) -> int:
        """Add a node, or find the one there."""
        self.nodes.append(np.array(x))
        return len(self.nodes)

    def block(self, *ways: Array) -> dict[tuple[int, int, int], int]:
        """Add hexahedra between the places along three axes."""
        number = {
            (i, j, k): self.node(x, y, z)
            for i, x in enumerate(ways[0])
            for j, y in enumerate(ways[1])
            for k, z in enumerate(ways[2])
        }
        self.elements.setdefault("C3D8I, ELSET=BLOCK", []).extend(
            [number[i + a, j + b, k + c] for a, b, c in RING]
            for i in range(len(ways[0]) - 1)
            for j in range(len(ways[1]) - 1)
            for k in range(len(ways[2]) - 1)
        )
        return number

    def write(self, path: Path, turned: Array | None = None) -> None:
        """Write it, turned as a whole if a rotation is given."""
        R, number = np.eye(3) if turned is None else turned, count(1)
        lines = ["*NODE"]
        lines += [f"{k}, " + ", ".join(repr(float(c)) for c in R @ x) for k, x in enumerate(self.nodes, start=1)]
        for kind, cells in self.elements.items():
            lines += [f"*ELEMENT, TYPE={kind}"]
            lines += [f"{next(number)}, " + ", ".join(map(str, cell)) for cell in cells]
        for name, nodes in self.sets.items():
            lines += [f"*NSET, NSET={name}", ",\n".join(map(str, nodes))]
        lines += ["*SHELL SECTION, ELSET=FIN, MATERIAL=M", "0.004", "*SOLID SECTION, ELSET=BLOCK, MATERIAL=M"]
        if "B31, ELSET=BAR" in self.elements:
            towards = ", ".join(repr(float(c)) for c in R @ self.towards)
            lines += ["*BEAM SECTION, ELSET=BAR, MATERIAL=M, SECTION=RECT", "0.01, 0.02", towards]
        path.write_text("\n".join([*lines, "*MATERIAL, NAME=M", "*ELASTIC", "70e9, 0.33", *self.more]) + "\n")


def finned(across: Array, own_nodes: bool, coarse: bool = False) -> Deck:
    """A block of 20 × 40 × 20 mm with a fin of 4 mm, 60 mm high, in the middle of its top."""
    deck, n = Deck(), len(across) // 2
    x, z, heights = np.linspace(0, 0.02, 5), np.linspace(-0.02, 0, 9), np.linspace(0, 0.06, 25)
    if coarse:
        x, z, heights = np.linspace(0, 0.02, 3), np.array([-0.02, -0.008, 0.0]), np.linspace(0, 0.06, 9)
    block = deck.block(x, across, z)
    top = [node for (_, _, k), node in block.items() if k == len(z) - 1]
    root = [deck.node(each, 0, 0) if own_nodes else block[i, n, len(z) - 1] for i, each in enumerate(x)]
    rows = [root] + [[deck.node(each, 0, height) for each in x] for height in heights[1:]]
    deck.elements["S4, ELSET=FIN"] = [
        [a[i], a[i + 1], b[i + 1], b[i]] for a, b in pairwise(rows) for i in range(len(x) - 1)
    ]
    deck.sets = {
        "ROOT": root,
        "TOP": top,
        "TIP": rows[-1],
        "BASE": [node for (i, _, _), node in block.items() if not i],
    }
    return deck


def barred(own_node: bool = True, joint: str = "") -> Deck:
    """A cube of 40 mm with a bar of 20 × 10 mm, 300 mm long, on its face."""
    deck = Deck()
    y = np.linspace(-0.02, 0.02, 5)
    block = deck.block(np.linspace(-0.04, 0, 5), y, y)
    face = [node for (i, _, _), node in block.items() if i == 4]
    root = deck.node(0, 0, 0) if own_node else block[4, 2, 2]
    line = [root] + [deck.node(each, 0, 0) for each in np.linspace(0, 0.3, 7)[1:]]
    deck.elements["B31, ELSET=BAR"] = [list(ends) for ends in pairwise(line)]
    deck.sets = {"FACE": face, "ROOT": [root], "TIP": line[-1:], "BACK": [n for (i, _, _), n in block.items() if not i]}
    coupling = f"*SURFACE, NAME=S, TYPE=NODE\nFACE\n*COUPLING, REF NODE={root}, SURFACE=S, CONSTRAINT NAME=C"
    joints = {
        "": [],
        "rigid": [f"*RIGID BODY, TIE NSET=FACE, REF NODE={root}"],
        "kinematic": [coupling, "*KINEMATIC", "1, 6"],
        "mean": [coupling, "*DISTRIBUTING", "1, 6"],
    }
    deck.more = joints[joint]
    return deck


def body(file: Path, **mesh: Any) -> dict[str, Any]:
    """A body of a deck."""
    return {"mesh": {"file": str(file), "unit": "m", **mesh}, **METAL, "modes": {"count": 5}}


def part_of(table: dict[str, Any]) -> FlexiblePart:
    return fmd.load({"title": "Structure", "body": {"b": table}}).run.parts["b"]


def pressed(fin: dict[str, Any]) -> dict[str, Any]:
    """A scene in which 10 N along y press the tip of a fin, damped so that it soon rests."""
    marker = {"base": {"face": "BASE"}, "tip": {"face": "TIP"}}
    return {
        "title": "Fin",
        "body": {"b": fin | {"marker": marker, "modes": {"count": 4, "boundary": "joint", "damping": 0.5}}},
        "joint": {"hub": {"type": "fixed", "parent": "ground", "child": "b.base"}},
        "drive": {"push": {"type": "point force", "marker": "b.tip", "force": "10 N", "direction": [0, 1, 0]}},
        "simulation": {
            "duration": "10 ms",
            "output_step": "1 ms",
            "tip": "b.tip",
            "run": [{"integrator": "runge-kutta", "tolerance": 1e-6}],
        },
    }


TIE = [{"face": "ROOT", "onto": "TOP"}]
TETRAHEDRA = ((0, 1, 3, 7), (0, 1, 7, 5), (0, 5, 7, 4), (1, 2, 3, 7), (1, 2, 7, 6), (1, 6, 7, 5))  # of a hexahedron


@pytest.fixture(scope="module")
def solid_fin(tmp_path_factory: pytest.TempPathFactory) -> FlexiblePart:
    """The block with its fin, of hexahedra with 20 nodes."""
    folder = tmp_path_factory.mktemp("solid")
    solid = Deck()  # nodes at the fin's sides, and the fin of two elements through its thickness
    y = 1e-3 * np.array([-20, -8, -4, -2, 0, 2, 4, 8, 20])
    x, z = np.linspace(0, 0.02, 3), 1e-3 * np.array([-20, -8, -3, -1, 0, 1, 3, 7, 13, 20, 30, 40, 50, 60])
    solid.block(x, y, z)
    cells = solid.elements["C3D8I, ELSET=BLOCK"]
    middles = np.array([np.mean([solid.nodes[k - 1] for k in cell], axis=0) for cell in cells])
    kept = (middles[:, 2] < 0) | (np.abs(middles[:, 1]) < 0.002)
    solid.elements = {"C3D8, ELSET=BLOCK": [cell for cell, mine in zip(cells, kept, strict=True) if mine]}
    solid.write(folder / "solid.inp")
    part = part_of(body(folder / "solid.inp", order=2))
    assert len(part.modes.omega) == 5
    return part


def test_a_fin_in_two_halves_that_are_tied_is_that_in_one(tmp_path: Path) -> None:
    whole = finned(np.linspace(-0.02, 0.02, 5), own_nodes=True, coarse=True)
    halves = finned(np.linspace(-0.02, 0.02, 5), own_nodes=True, coarse=True)
    cells = halves.elements["S4, ELSET=FIN"]
    middle = [node for node, x in enumerate(halves.nodes, 1) if x[1] == 0 and abs(x[2] - 0.03) < 1e-9]
    again = {node: halves.node(*halves.nodes[node - 1]) for node in middle}
    upper = [cell for cell in cells if halves.nodes[cell[2] - 1][2] > 0.031]
    for cell in upper:
        cell[:] = [again.get(node, node) for node in cell]
    halves.sets |= {"LOWER": middle, "UPPER": list(again.values())}
    found = []
    for deck, ties in ((whole, TIE), (halves, [*TIE, {"face": "UPPER", "onto": "LOWER"}])):
        deck.write(tmp_path / "fin.inp")
        found.append(part_of(body(tmp_path / "fin.inp", shell="deck", tie=ties)).modes.omega)
    assert found[1] == pytest.approx(found[0], rel=1e-9)
    halves.write(tmp_path / "fin.inp")
    with pytest.raises(InputError, match="shells follow solids and shells, beams follow solids"):
        _ = part_of(body(tmp_path / "fin.inp", shell="deck", tie=[*ties, {"face": "BASE", "onto": "LOWER"}])).mesh


@pytest.mark.parametrize("own_nodes", [True, False])
def test_a_fin_of_shells_on_a_block_has_the_frequencies_of_solids(
    solid_fin: FlexiblePart, tmp_path: Path, own_nodes: bool
) -> None:
    finned(np.linspace(-0.02, 0.02, 41), own_nodes).write(tmp_path / "fin.inp")
    fin = part_of(body(tmp_path / "fin.inp", shell="deck", tie=TIE))
    assert fin.modes.omega == pytest.approx(solid_fin.modes.omega, rel=1e-2)
    assert fin.mass == pytest.approx(solid_fin.mass)


def test_a_fin_of_shells_on_coarse_tetrahedra_of_second_order_has_the_frequencies_of_solids(
    solid_fin: FlexiblePart, tmp_path: Path
) -> None:
    deck = finned(1e-3 * np.array([-20.0, -4.0, 0.0, 4.0, 20.0]), own_nodes=True, coarse=True)
    middles: dict[tuple[int, int], int] = {}

    def between(a: int, b: int) -> int:
        key = min(a, b), max(a, b)
        if key not in middles:
            middles[key] = deck.node(*(deck.nodes[a - 1] + deck.nodes[b - 1]) / 2)
        return middles[key]

    corners = [[cell[i] for i in own] for cell in deck.elements.pop("C3D8I, ELSET=BLOCK") for own in TETRAHEDRA]
    sides = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
    tetrahedra = [cell + [between(cell[a], cell[b]) for a, b in sides] for cell in corners]
    deck.elements = {"C3D10, ELSET=BLOCK": tetrahedra, **deck.elements}
    deck.write(tmp_path / "fin.inp")
    fin = part_of(body(tmp_path / "fin.inp", shell="deck", tie=TIE))
    assert fin.modes.omega[:4] == pytest.approx(solid_fin.modes.omega[:4], rel=0.03)
    assert fin.mass == pytest.approx(solid_fin.mass)


def test_a_fin_whose_nodes_are_solids_alone_hangs_on_a_hinge_and_says_what_clamps_it(tmp_path: Path) -> None:
    finned(np.linspace(-0.02, 0.02, 5), own_nodes=False).write(tmp_path / "fin.inp")
    part = part_of(body(tmp_path / "fin.inp", shell="deck"))
    with pytest.raises(InputError, match=r"found 7 rigid-body modes.*5 nodes of shells.*mesh\.tie"):
        _ = part.modes


def test_layers_of_one_material_beside_solids_are_the_shell_that_they_are(tmp_path: Path) -> None:
    finned(np.linspace(-0.02, 0.02, 3), own_nodes=True).write(tmp_path / "fin.inp")
    plain = part_of(body(tmp_path / "fin.inp", shell="deck", tie=TIE)).modes.omega
    text, plies = (tmp_path / "fin.inp").read_text(), "0.001, 3, M, 30.\n0.002, 3, M, 0.\n0.001, 3, M, 90."
    layered = text.replace("ELSET=FIN, MATERIAL=M\n0.004", f"ELSET=FIN, COMPOSITE\n{plies}")
    (tmp_path / "fin.inp").write_text(layered)
    lamina = {"M": {"E1": 70e9, "E2": 70e9, "nu12": 0.33, "G12": 70e9 / 2.66, "rho": 2700.0}}
    table = body(tmp_path / "fin.inp", shell="deck", tie=TIE) | {"lamina": lamina}
    assert layered != text
    assert part_of(table).modes.omega == pytest.approx(plain, rel=1e-8)
    lamina["M"]["strength"] = dict.fromkeys(("Xt", "Xc", "Yt", "Yc", "S"), 1e8)
    run = fmd.load(pressed(table | {"lamina": lamina})).run
    worst = summarise_plies(run, Plies(file="plies.csv", body="b"))["plies"]["b"]["Tsai-Hill"]
    middles = [x for own in run.parts["b"].mesh.members for x in own.points[own.cells].mean(axis=1)]
    assert worst["element"] > len(run.parts["b"].mesh.members[0].cells)  # solids come first
    assert worst["position_m"] == pytest.approx(middles[worst["element"]], abs=1e-12)


def test_a_tripod_whose_feet_are_hinges_holds_and_warns(tmp_path: Path) -> None:
    deck, way = Deck(), np.linspace(0, 0.04, 3)
    block = deck.block(way, way, way)
    apex = deck.node(0.02, 0.02, 0.1)
    deck.elements["B31, ELSET=BAR"] = [[block[foot], apex] for foot in ((0, 0, 2), (2, 0, 2), (1, 2, 2))]
    deck.towards = [0.3, 0.4, 1.0]
    deck.write(tmp_path / "tripod.inp")
    run = fmd.load({"title": "Tripod", "body": {"b": body(tmp_path / "tripod.inp", beam="deck")}}).run
    assert run.parts["b"].modes.n_rigid == 6
    (text,) = (each["text"] for each in mode_warnings(run) if each["code"] == "hinge")
    assert text.startswith("b: 3 nodes of beams are solids' too")
    assert "by mesh.tie" in text


def sheet_with_bar(n: int, lying: bool) -> Deck:
    """A sheet of n × n shells, and a bar from its middle, upright or along it."""
    deck, way = Deck(), np.linspace(-0.1, 0.1, n + 1)
    grid = {(i, j): deck.node(x, y, 0) for i, x in enumerate(way) for j, y in enumerate(way)}
    deck.elements["S4, ELSET=FIN"] = [
        [grid[i, j], grid[i + 1, j], grid[i + 1, j + 1], grid[i, j + 1]] for i in range(n) for j in range(n)
    ]
    middle = n // 2
    end = grid[middle + 1, middle] if lying else deck.node(0, 0, 0.1)
    deck.elements["B31, ELSET=BAR"] = [[grid[middle, middle], end]]
    deck.sets = {"TIP": [end], "RIM": [node for place, node in grid.items() if {0, n} & {*place}]}
    return deck


def test_a_bar_upright_on_one_node_of_a_sheet_turns_it_the_more_the_finer_the_mesh_and_warns(tmp_path: Path) -> None:
    """A couple M turns a thin plate by M ln 2 / (4 π D) more with each halving of its elements, by shear yet more."""
    turned = []
    for n in (8, 16):
        sheet_with_bar(n, lying=False).write(tmp_path / "bar.inp")
        run = fmd.load({"title": "Strut", "body": {"b": body(tmp_path / "bar.inp", shell="deck", beam="deck")}}).run
        part = run.parts["b"]
        fe, end = part.fe, part.mesh.faces["TIP"]
        free = clamped(fe, part.mesh.faces["RIM"])
        f = np.zeros((len(fe.x), 3))
        f[end, 0] = 1 / len(end)
        y = spsolve((fe.T.T @ fe.K @ fe.T)[free][:, free].tocsc(), (fe.T.T @ f.ravel())[free])
        turned.append((fe.T[:, free] @ y).reshape(-1, 3)[end, 0].mean() / 0.1**2)
    D = 70e9 * 0.004**3 / 12 / (1 - 0.33**2)
    assert 1.0 < (turned[1] - turned[0]) / (np.log(2) / (4 * np.pi * D)) < 4.0
    (text,) = (each["text"] for each in mode_warnings(run) if each["code"] == "point-moment")
    assert text.startswith("b: 1 nodes of shells each bear the end of a beam alone")
    sheet_with_bar(8, lying=True).write(tmp_path / "bar.inp")
    assert not part_of(body(tmp_path / "bar.inp", shell="deck", beam="deck")).mesh.notes


def clamped(model: FEModel, held: Array) -> Array:
    """Unknowns that move none of the held points."""
    rows = model.T[(3 * held[:, None] + np.arange(3)).ravel()]
    return np.flatnonzero(np.asarray(abs(rows).sum(axis=0)) == 0)


@pytest.mark.parametrize("own_node", [True, False])
@pytest.mark.parametrize("joint", ["rigid", "kinematic", "mean"])
def test_a_bar_on_a_face_of_a_block_bends_as_both_one_after_the_other(
    tmp_path: Path, joint: str, own_node: bool
) -> None:
    deck = barred(own_node, joint)
    if joint == "mean":  # of the others
        deck.sets["FACE"] = [node for node in deck.sets["FACE"] if own_node or node != deck.sets["ROOT"][0]]
    deck.write(tmp_path / "bar.inp")
    part = part_of(body(tmp_path / "bar.inp", beam="deck"))
    assert "hinges" not in str(part.mesh.notes)
    fe = part.fe
    free = clamped(fe, part.mesh.faces["BACK"])
    K = (fe.T.T @ fe.K @ fe.T)[free][:, free]

    def moved(at: str, force: Array) -> Array:
        """Displacement and rotation of a section by a force on the tip."""
        nodes, end = part.mesh.faces[at], part.mesh.faces["TIP"]
        f = np.zeros((len(fe.x), 3))
        f[end] = force / len(end)
        y = spsolve(K.tocsc(), (fe.T.T @ f.ravel())[free])
        u = (fe.T[:, free] @ y).reshape(-1, 3)
        arms = fe.x[nodes] - fe.x[nodes].mean(axis=0)
        turn = np.linalg.lstsq(np.vstack([_cross(r) for r in arms]), (u[nodes] - u[nodes].mean(axis=0)).ravel())[0]
        return np.concatenate([u[nodes].mean(axis=0), turn])

    E, nu, L, A = 70e9, 0.33, 0.3, 2e-4
    push = np.array([0.0, 1.0, 1.0])
    tip, root = (moved(at, push) for at in ("TIP", "ROOT"))
    carried = root[:3] + np.cross(root[3:], [L, 0, 0])
    shear = L / (5 / 6 * E / (2 * (1 + nu)) * A)
    bent = [L**3 / (3 * E * b * h**3 / 12) + shear for b, h in ((0.02, 0.01), (0.01, 0.02))]
    assert sorted((tip[:3] - carried)[1:]) == pytest.approx(sorted(bent), rel=1e-6)
    assert np.linalg.norm(root[3:]) * L > 1e-3 * np.linalg.norm(tip[:3])  # the block does yield
    assert moved("FACE", push) == pytest.approx(root, rel=1e-6, abs=1e-6 * np.abs(root).max())


@pytest.mark.parametrize("joint", ["rigid", "mean"])
def test_a_disc_on_a_bar_on_a_block_whirls_as_in_the_textbook(tmp_path: Path, joint: str) -> None:
    """A disc on a light bar, whose flexibility is that of the static answers; in axes that turn ω − Ω.

    Without the second-order motion of the bar's nodes on the face, and of the disc's arms, it would be another rotor.
    """
    mass, J, Jp, rate = 5.0, 0.02, 0.04, 600.0
    deck = barred(joint=joint)
    (tip,) = deck.sets["TIP"]
    deck.elements |= {"MASS, ELSET=DISC": [[tip]], "ROTARYI, ELSET=DISCS": [[tip]]}
    deck.more += [f"*MASS, ELSET=DISC\n{mass}", f"*ROTARY INERTIA, ELSET=DISCS\n{Jp}, {J}, {J}, 0, 0, 0"]
    deck.write(tmp_path / "bar.inp")
    text = (tmp_path / "bar.inp").read_text().replace("0.01, 0.02", "0.018, 0.018")
    (tmp_path / "bar.inp").write_text(text)
    table = body(tmp_path / "bar.inp", beam="deck", mass_unit="kg", force_unit="N") | {"rho": "1e-4 kg/m^3"}
    part = part_of(table | {"marker": {"foot": {"face": "BACK"}, "disc": {"link": "TIP"}}})
    fe, markers = part.fe, part.model.markers
    solver = FreeBodySolver(fe, fixed=(3 * part.mesh.faces["BACK"].ravel()[:, None] + np.arange(3)).ravel())
    loads = markers["disc"].columns(len(fe.x), np.eye(3))[:, :, [1, 5]]
    flexibility = np.einsum("iak,ial->kl", loads, solver.static_response(loads))
    pairs = solver.modes(6)
    whole = supported_body(fe, pairs.omega, pairs.shapes, markers, "foot", np.zeros((0, 3)))
    found = rotating_modes(stiffen_body(whole, fe, solver, None, moving=markers, elements=False), np.eye(3)[0], rate)
    exact = np.abs(rotor_frequencies(flexibility, mass, J, Jp, rate) - rate)
    assert all(np.abs(2 * np.pi * found.frequencies_hz - omega).min() < 1e-4 * omega for omega in exact)
    assert found.growth.max() < 1e-5


def _cross(r: Array) -> Array:
    """Matrix of ``θ × r``."""
    return np.array([[0, r[2], -r[1]], [-r[2], 0, r[0]], [r[1], -r[0], 0]])


def framed(rng: np.random.Generator) -> Deck:
    """A finned block, whose fin has a bar along its rim and a strut across it, all turned at random."""
    deck = finned(np.linspace(-0.02, 0.02, 5), own_nodes=bool(rng.integers(2)))
    rim = deck.sets["TIP"]
    foot = deck.nodes[rim[2] - 1]
    strut = [deck.node(*(foot + np.array([0, each, 0]))) for each in np.linspace(0, 0.05, 4)[1:] + 0.01 * rng.random()]
    deck.elements["B31, ELSET=BAR"] = [list(ends) for ends in [*pairwise(rim), *pairwise([rim[2], *strut])]]
    deck.towards = [0.3, 0.4, 1.0]
    return deck


@pytest.mark.parametrize("seed", range(1, 3))
def test_random_structures_have_six_rigid_motions_and_the_mass_of_their_elements(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turned *= np.sign(np.linalg.det(turned))
    deck = framed(rng)
    deck.write(tmp_path / "frame.inp", turned)
    part = part_of(body(tmp_path / "frame.inp", shell="deck", beam="deck", tie=TIE))
    fe = part.fe
    rigid = fe.rigid_modes
    y = spsolve((fe.T.T @ fe.T).tocsc(), fe.T.T @ rigid)
    assert np.abs(fe.T @ y - rigid).max() < 1e-10  # each rigid motion is one of the unknowns'
    assert np.abs(fe.K @ rigid).max() < 1e-9 * abs(fe.K).max()
    assert part.modes.n_rigid == 6
    volume = sum(own.space.volumes.sum() for own in part.space.members)
    assert fe.mass == pytest.approx(2700 * volume)
    strut = np.linalg.norm(deck.nodes[-1] - deck.nodes[deck.sets["TIP"][2] - 1])
    drawn = 0.02 * 0.04 * 0.02 + 0.02 * 0.06 * 0.004 + 0.01 * 0.02 * (0.02 + strut)
    assert volume == pytest.approx(drawn)
    # the stress of a motion stiffens each kind of elements by itself
    assert isinstance(part.space, JoinedSpace)
    q = rng.normal(size=(fe.T.shape[1], 2)) * 1e-6
    u = (fe.T @ q).reshape(-1, 3, 2)
    found = reduced_geometric_stiffness(fe, u, u)
    alone = [FEModel(own.space, own.material(part.material), fe.K, fe.m) for own in part.space.members]
    moved = [own.of_shapes(u) for own in part.space.members]
    each = [reduced_geometric_stiffness(own, mine, mine) for own, mine in zip(alone, moved, strict=True)]
    assert found == pytest.approx(sum(each), rel=1e-9)
    assert np.abs(found).max() > 0


def test_a_structure_moves_with_stress_of_solids_and_of_both_faces_of_shells(tmp_path: Path) -> None:
    deck = finned(np.linspace(-0.02, 0.02, 5), own_nodes=True)
    deck.write(tmp_path / "fin.inp")
    named = {side: {"at": [0.0125, y, 0.03125], "part": "FIN"} for side, y in (("left", 0.002), ("right", -0.002))}
    scene = pressed(body(tmp_path / "fin.inp", shell="deck", tie=TIE) | {"element": named})
    scene["simulation"]["stiffening"] = "on"
    run = fmd.load(scene).run
    left, right = (next(iter(run.element_stress(f"b.{side}", "zz").values()))[-1] for side in ("left", "right"))
    bending = 6 * 10 * 0.02875 / (0.02 * 0.004**2)  # 6 F (h - z) / b t², pressed on the side that it moves to
    assert (right - left) / 2 == pytest.approx(bending, rel=2e-2)
    assert abs(right + left) < 2e-2 * bending
    assert len(run.parts["b"].surface.nodes) == run.stress_of("b").modal.shape[0]


def test_a_structure_is_a_mesh_of_other_programs(tmp_path: Path) -> None:
    finned(np.linspace(-0.02, 0.02, 5), own_nodes=True).write(tmp_path / "fin.inp")
    mesh = part_of(body(tmp_path / "fin.inp", shell="deck", tie=TIE)).mesh
    for suffix in (".med", ".vtu", ".msh", ".bdf"):
        write_mesh(mesh, tmp_path / f"mesh{suffix}")
        back = meshio.read(tmp_path / f"mesh{suffix}")
        assert sum(len(own.data) for own in back.cells) == mesh.n_cells
        assert back.points == pytest.approx(np.concatenate([own.points for own in mesh.members]), abs=1e-12)


def test_what_structures_lack_is_refused_by_name(tmp_path: Path) -> None:
    deck = finned(np.linspace(-0.02, 0.02, 5), own_nodes=True)
    deck.write(tmp_path / "fin.inp")
    table = body(tmp_path / "fin.inp", shell="deck")
    with pytest.raises(InputError, match="2 unconnected pieces; join them at common nodes"):
        _ = part_of(table).mesh
    with pytest.raises(InputError, match=r"mesh\.tie.*the node at .* m is 0\.0.* m off the face"):
        _ = part_of(body(tmp_path / "fin.inp", shell="deck", tie=[{"face": "TIP", "onto": "TOP"}])).fe
    framed(np.random.default_rng(0)).write(tmp_path / "frame.inp")
    with pytest.raises(InputError, match=r"solids, shells and beams: 96 quad; mesh\.shell takes triangles and quadri"):
        _ = part_of(body(tmp_path / "frame.inp", beam="deck")).mesh
    with pytest.raises(InputError, match="no pieces and no contacts"):
        _ = part_of(body(tmp_path / "fin.inp", shell="deck", tie=TIE)).plain_space
    scene = fmd.load({"title": "Structure", "body": {"b": body(tmp_path / "fin.inp", shell="deck", tie=TIE)}})
    with pytest.raises(InputError, match=r"body\.b\.shape: has shells or beams, whose full matrices aren't written"):
        write_format(scene.run, "full", "b", tmp_path / "fin.mtx")
