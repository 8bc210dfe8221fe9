"""Ansys' decks: those of its reader's samples, and decks written here in their form beside the same of Nastran."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.core.rotations import rigid_motions
from fmd.fem.assembly import assemble
from fmd.fem.formats.ansys import read_ansys
from fmd.fem.formats.import_joined import read_structure
from fmd.fem.formats.import_mesh import read_mesh
from fmd.fem.formats.import_shell import GivenSections
from fmd.fem.formats.raw_mesh import MeshFileError
from fmd.fem.links import mean_motion
from fmd.fem.markers import weighted_marker
from fmd.fem.material import Material
from fmd.reduction.eigen import FreeBodySolver
from tests.reduction.test_deck_links import BRACKET, CALCULIX_HZ, MYSTRAN_HZ, clamped_hz, linked, on_face

CUBE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1.0]])
BAR = np.array([[0, 0, 0.0], [0.5, 0, 0], [0.8, 0.4, 0.1], [0.8, 0.4, 0.5]])


def nodes(x: Array, first: int = 1) -> list[str]:
    rows = (f"{k:9}{0:9}{0:9}" + "".join(f"{c:21.13E}" for c in p) for k, p in enumerate(x.tolist(), start=first))
    return ["NBLOCK,6,SOLID", "(3i9,6e21.13e3)", *rows, "N,R5.3,LOC,       -1,"]


def elements(cells: Sequence[Sequence[int]] | IntArray, kind: int, first: int = 1, real: int = 1) -> list[str]:
    out = ["EBLOCK,19,SOLID", "(19i10)"]
    for k, own in enumerate(cells, start=first):
        row = [1, kind, real, 1, 0, 0, 0, 0, len(own), 0, k, *own]
        out += ["".join(f"{item:10}" for item in part) for part in (row[:19], row[19:]) if len(part)]
    return [*out, "        -1"]


def equation(number: int, terms: Sequence[tuple[int, str, float]]) -> list[str]:
    out = [f"CE,R5.0,DEFI,{len(terms):8},{number:8},  0.00000000    "]
    for k in range(0, len(terms), 2):
        own = ",".join(f"{node:10},{name:4},{value: .9G}" for node, name, value in terms[k : k + 2])
        out += [f"CE,R5.0,NODE,{own},"]
    return out


def rigid(x: Array, slaves: IntArray, master: int, at: Array) -> list[str]:
    """Return what CERIG makes: a sum for each displacement of nodes on arms from a master."""
    out, names = list[str](), ("UX", "UY", "UZ", "ROTX", "ROTY", "ROTZ")
    for slave in slaves:
        row = rigid_motions((x[slave - 1] - at)[None])[0]
        for d in range(3):
            turns = [(master, names[3 + k], -row[d, 3 + k]) for k in range(3) if row[d, 3 + k]]
            out += equation(3 * slave + d, [(slave, names[d], 1.0), (master, names[d], -1.0), *turns])
    return out


def read(tmp_path: Path, *lines: str) -> Path:
    path = tmp_path / "deck.cdb"
    path.write_text("\n".join(["/PREP7", *lines, "FINISH", ""]))
    return path


@pytest.mark.parametrize("twice", [False, True])
def test_cerig_with_a_mass_has_the_frequencies_of_calculix(tmp_path: Path, twice: bool) -> None:
    """Once as equations of CERIG, once half of them and half as rigid beams, MPC184."""
    bracket = read_mesh(BRACKET, 1.0)
    x, at = bracket.points, np.array([0.042, 0.0, 0.03])
    bore, foot = on_face(bracket, "BORE") + 1, on_face(bracket, "FOOT") + 1
    half = len(bore) // 2 if twice else len(bore)
    deck = ["ET,1,187", "ET,2,21", "KEYOP,2,3,2", "ET,3,184", "KEYOP,3,1,1", *nodes(x), *nodes(at[None], 9001)]
    deck += [*elements(bracket.cells + 1, 1), *elements([[9001]], 2, 90001)]
    deck += elements([[9001, node] for node in bore[half:]], 3, 91001)
    deck += ["RLBLOCK,1,1,6,7", "(2i8,6g16.9)", "(7g16.9)", f"{1:8}{1:8}{0.4:16.9f}"]
    deck += [f"CMBLOCK,FOOT,NODE,{len(foot)}", "(8i10)"]
    deck += ["".join(f"{node:10}" for node in foot[k : k + 8]) for k in range(0, len(foot), 8)]
    mesh = read_mesh(read(tmp_path, *deck, *rigid(x, bore[:half], 9001, at)), 1.0)
    assert mesh.connections is not None
    assert mesh.connections.count().keys() == {"CERIG", "MASS21"} | ({"MPC184"} if twice else set())
    assert np.round(clamped_hz(linked(mesh, mass_order=2), on_face(mesh, "FOOT")), 3).tolist() == CALCULIX_HZ


def test_sums_of_rbe3_with_a_mass_have_the_frequencies_of_mystran(tmp_path: Path) -> None:
    """Sums whose first term is the reference's, as RBE3 makes them, here by the mean motion of the bore's nodes."""
    bracket = read_mesh(BRACKET, 1.0)
    x, at = bracket.points, np.array([0.042, 0.0, 0.03])
    bore, names = on_face(bracket, "BORE"), ("UX", "UY", "UZ", "ROTX", "ROTY", "ROTZ")
    rows = mean_motion(weighted_marker(bore, x[bore], np.ones(len(bore))), at).reshape(6, -1, 3)
    deck = ["ET,1,187", "ET,2,21", "KEYOP,2,3,2", *nodes(x), *nodes(at[None], 9001)]
    deck += [*elements(bracket.cells + 1, 1), *elements([[9001]], 2, 90001), "R,1,0.4"]
    for d, row in enumerate(rows):
        terms = [(node + 1, names[k], float(w[k])) for node, w in zip(bore, row, strict=True) for k in range(3) if w[k]]
        deck += equation(d + 1, [(9001, names[d], -1.0), *terms])
    hz = clamped_hz(linked(read_mesh(read(tmp_path, *deck), 1.0), mass_order=2), on_face(bracket, "FOOT"))
    assert [float(f"{f:.7g}") for f in hz] == MYSTRAN_HZ


def test_the_readers_samples_have_the_frequencies_of_ansys() -> None:
    """HexBeam: file.rst beside it has these of the free bar; SOLID186 integrates stiffness at fewer points."""
    examples = pytest.importorskip("ansys.mapdl.reader.examples", reason="ansys-mapdl-reader isn't installed")
    mesh = read_mesh(Path(examples.hexarchivefile), 1.0)
    assert mesh.faces.keys() == {"NCOMP2", "NODE_SELECTION"}
    assert {name: len(cells) for name, cells in mesh.parts.items()} == {"material-1": 40, "ECOMP1": 22, "ECOMP2": 22}
    hz = FreeBodySolver(assemble(mesh, 2, Material(1.69e7, 0.31, 4.1408e-4))).modes(6).omega / (2 * np.pi)
    ansys = np.array([7366.49504, 7366.49504, 11504.89524, 17285.70459, 17285.70459, 20137.19299])
    assert (hz / ansys - 1 > 0).all()
    assert hz / ansys - 1 == pytest.approx(0.0, abs=4e-3)  # torsion 3.7e-3, bending 2.3e-4, along the bar 4e-6
    assert read_ansys(Path(examples.sector_archive_file).read_text()).count_elements() == {
        "hexahedron": 101,
        "wedge": 4,
    }
    assert len(read_mesh(Path(examples.tetarchivefile), 1.0).cells) == 3913


@pytest.mark.parametrize(
    ("corners", "kind", "volume"),
    [
        ([0, 1, 2, 2, 4, 5, 6, 6], "wedge", 1 / 2),
        ([0, 1, 2, 3, 4, 4, 4, 4], "pyramid", 1 / 3),
        ([0, 1, 2, 2, 4, 4, 4, 4], "tetra", 1 / 6),
        (range(8), "hexahedron", 1.0),
    ],
)
@pytest.mark.parametrize("order", [1, 2])
def test_collapsed_bricks_are_what_they_look_like(
    tmp_path: Path, corners: Sequence[int], kind: str, volume: float, order: int
) -> None:
    corner = list(corners)
    x, own = CUBE, [k + 1 for k in corner]
    if order == 2:
        pairs = [(k, (k + 1) % 4) for k in range(4)] + [(4 + k, 4 + (k + 1) % 4) for k in range(4)]
        for a, b in (*pairs, *((k, 4 + k) for k in range(4))):
            i, j = corner[a], corner[b]
            x = np.concatenate([x, (CUBE[[i]] + CUBE[[j]]) / 2]) if i != j else x
            own.append(len(x) if i != j else i + 1)
    path = read(tmp_path, f"ET,1,{185 if order == 1 else 186}", *nodes(x), *elements([own], 1))
    mesh = read_mesh(path, 1.0, repair=True)
    assert mesh.cell_type.rstrip("0123456789") == kind
    assert assemble(mesh, order, Material(1.0, 0.3, 1.0)).mass == pytest.approx(volume)


def test_shells_and_beams_are_those_of_the_same_deck_of_nastran(tmp_path: Path) -> None:
    nastran = tmp_path / "deck.bdf"
    sheet = np.stack([*np.meshgrid(np.arange(4) / 4, np.arange(3) / 3), np.zeros((3, 4))], axis=-1).reshape(-1, 3)
    cells = [[k, k + 1, k + 5, k + 4] for k in (1, 2, 3, 5, 6, 7)]
    cells[-1:] = [[7, 8, 12, 12], [7, 12, 11, 11]]
    deck = ["ET,1,SHELL181", *nodes(sheet), *elements(cells, 1), "SECTYPE,1,SHELL", "SECOFFSET,BOT", "SECBLOCK,1"]
    ours = read_structure(read(tmp_path, *deck, "  0.02, 1, 0.0, 3"), 1.0, GivenSections())
    cards = [f"GRID,{k},,{p[0]},{p[1]},{p[2]}" for k, p in enumerate(sheet.tolist(), start=1)]
    for k, own in enumerate(cells, start=1):
        three = own[2] == own[3]
        cards += [f"{'CTRIA3' if three else 'CQUAD4'},{k},1,{','.join(map(str, own[: 4 - three]))},,0.01"]
    with pytest.raises(InputError, match=r"SHELL181 with KEYOPT\(1\) = 1, a part of a shell's stiffness"):
        read_structure(read(tmp_path, "KEYOPT,1,1,1", *deck, "  0.02, 1, 0.0, 3"), 1.0, GivenSections())
    nastran.write_text("\n".join(["BEGIN BULK", *cards, "PSHELL,1,1,0.02,1,,1", "ENDDATA"]))
    theirs = read_structure(nastran, 1.0, GivenSections())
    assert ours.points == pytest.approx(theirs.points, abs=1e-12)
    assert np.array_equal(ours.cells, theirs.cells)

    ends = [[1, 2, 5], [2, 3], [3, 4]]
    up = ["0.,0.3,1.", "0.,0.,1.", "-1.,0.,0."]  # z axes: by node 5, level, and of an upright beam
    for section, data, card in (
        ("RECT", "0.02, 0.05", "BAR\n+,0.02,0.05"),
        ("HREC", "0.03, 0.05, 0.002, 0.002, 0.002, 0.002", "BOX\n+,0.03,0.05,0.002,0.002"),
        ("I", "0.03, 0.03, 0.05, 0.003, 0.003, 0.002", "I\n+,0.05,0.03,0.03,0.002,0.003,0.003"),
        ("CTUBE", "0.01, 0.02", "TUBE\n+,0.02,0.01"),
        (
            "ASEC",
            "6e-4, 3e-8, 1e-8, 5e-8, 0, 4e-8, 0, 0, 0, 0, 0.02, 0.03, 0.8, 0.8",
            "PBAR,1,1,6e-4,3e-8,5e-8,4e-8\n,.01,.015,.01,-.015,-.01,.015,-.01,-.015\n,0.8,0.8,-1e-8",
        ),
    ):
        at = np.concatenate([BAR, [[0.2, 0.3, 1.0]]])
        deck = ["ET,1,188", *nodes(at), *elements(ends, 1), f"SECTYPE,1,BEAM,{section}", f"SECDATA,{data}"]
        ours = read_structure(read(tmp_path, *deck), 1.0, None, True)
        cards = [f"GRID,{k},,{p[0]},{p[1]},{p[2]}" for k, p in enumerate(BAR.tolist(), start=1)]
        cards += [f"CBAR,{k},1,{own[0]},{own[1]},{z}" for k, (own, z) in enumerate(zip(ends, up, strict=True), start=1)]
        own = card if card.startswith("PBAR") else f"PBARL,1,1,,{card}"
        nastran.write_text("\n".join(["BEGIN BULK", *cards, own, "ENDDATA"]))
        meshes = ours, read_structure(nastran, 1.0, None, True)
        seen = [getattr(mesh.midsurface.sections[0], "seen", np.zeros(0)) for mesh in meshes]  # type: ignore[union-attr]
        assert seen[0] == pytest.approx(seen[1])
        assert len(seen[0]) == 0 or np.array_equal(np.sign(seen[0]), [(1, 1), (-1, 1), (-1, -1), (1, -1)])  # as drawn
        material = Material(70e9, 0.3, 2700.0)
        hz = [FreeBodySolver(assemble(m, 1, material)).modes(6).omega for m in meshes]
        assert hz[0] == pytest.approx(hz[1], rel=1e-9)


def test_springs_and_sums_of_displacements_are_those_that_the_deck_says(tmp_path: Path) -> None:
    x = np.concatenate([CUBE, CUBE + np.array([0, 0, 1.5])])
    solids = [range(1, 9), range(9, 17)]
    deck = ["ET,1,185", "ET,2,14", "KEYOP,2,2,3", "ET,3,14", *nodes(x), *elements(solids, 1)]
    deck += [*elements([[5, 9]], 2, 10, real=3), *elements([[6, 11]], 3, 11, real=4), "R,3,2.5", "R,4,7.0"]
    deck += [*equation(1, [(5, "UX", 1.0), (9, "UX", -1.0)]), *equation(2, [(7, "UY", 2.0), (8, "UY", -2.0)])]
    raw = read_ansys("\n".join(deck))
    along, diagonal = raw.connections.springs
    assert (along.points.tolist(), along.directions.tolist(), along.stiffness) == ([4, 8], [2, 2], 2.5)
    span = (x[10] - x[5]) / np.linalg.norm(x[10] - x[5])
    assert diagonal.coefficients == pytest.approx(np.concatenate([span, -span]))
    assert [each.label for each in raw.connections.equations] == ["CE 1", "CE 2"]
    assert raw.connections.equations[1].coefficients.tolist() == [2.0, -2.0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("ET,1,185", "ET,1,278"), "there are no solid elements; the elements: 1 element type 278"),
        (("ET,1,185", "ET,1,174"), "there are no solid elements; the elements: 1 CONTA174"),
        (("ET,1,185", "ET,2,185"), "element 1 has type 1, which no ET gives"),
        (("EBLOCK,19,SOLID", "EBLOCK,10"), "EBLOCK isn't in the form SOLID; write the deck by CDWRITE,DB"),
        (("NBLOCK,6,SOLID", "N,1,0,0,0"), "N isn't read; write the deck by CDWRITE,DB"),
        (("(19i10)", "none"), r"no format like \(19i10\) follows"),
        (("         8\n", "        99\n"), "element 1 names node 99, which isn't there"),
        (("        -1\nFINISH", ""), "line 21: EBLOCK is cut off or has fields that aren't numbers"),
        (("        3        0", "        x        0"), "line 11: NBLOCK is cut off or has fields that aren't numbers"),
        (("FINISH", "CP,R5.0,1,UX,2"), r"elements that aren't solid \(1 CP\): left out"),
        (("FINISH", "CE,NEXT,0,1,UX,1,2,UX,-1"), "CE as a command isn't read"),
        (("FINISH", "CE,R5.0,DEFI,2,1,0.5"), "CE 1 has the constant 0.5; sums that are 0 are read"),
        (("FINISH", "\n".join(elements([[1]], 3, 5))), "MASS21 5 has masses that aren't alike in x, y and z"),
        (("FINISH", "\n".join(elements([[1]], 3, 1))), "element 1 is given twice"),
        (("FINISH", "\n".join(nodes(np.ones((1, 3))))), "node 1 is given twice, at two places"),
        (("FINISH", "\n".join(elements([[1, 2]], 4, 5))), r"elements that aren't solid \(1 MPC184\): left out"),
        (
            ("FINISH", "\n".join(elements([[*range(1, 9), 1, 2, 3, 4]], 5, 5))),
            "element 5 lacks 8 of its 12 nodes",
        ),
    ],
)
def test_what_is_not_read_is_refused_by_name(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    kinds = ["ET,1,185", "ET,3,21", "R,1,1.,2.,3.", "ET,4,184", "ET,5,186"]
    path = read(tmp_path, *kinds, *nodes(CUBE), *elements([range(1, 9)], 1))
    assert change[0] in path.read_text()
    path.write_text(path.read_text().replace(*change, 1))
    with pytest.raises(InputError, match=message):
        read_mesh(path, 1.0)


def test_masses_at_nodes_that_are_turned_are_refused() -> None:
    turned = nodes(CUBE)
    turned[2] += f"{30.0:21.13E}"
    with pytest.raises(MeshFileError, match="MASS21 2 is at node 1, which is turned by NROTAT"):
        read_ansys("\n".join(["ET,1,185", "ET,2,21", *turned, *elements([range(1, 9)], 1), *elements([[1]], 2, 2)]))
