"""Shells from the surface elements of mesh files: formats, sets, mixed elements, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.fem.assembly import assemble
from fmd.fem.formats.import_joined import read_structure
from fmd.fem.formats.import_mesh import read_mesh
from fmd.fem.formats.import_shell import GivenSections
from fmd.fem.material import Material
from fmd.reduction.eigen import FreeBodySolver
from tests.fem.sheets import shell_mesh, unit_grid

STEEL = Material(210e9, 0.3, 7850.0)


def panel(element: str = "quadrilateral") -> tuple[Array, IntArray]:
    """A panel that bends out of its plane, in mm."""
    p, cells = unit_grid(6, 4, element)
    return np.column_stack([300 * p[:, 0], 200 * p[:, 1], 40 * p[:, 0] ** 2]), cells


def write_abaqus(path: Path, x: Array, blocks: dict[str, IntArray], more: str = "") -> None:
    lines = ["*NODE", *(f"{k}, {a}, {b}, {c}" for k, (a, b, c) in enumerate(x, start=1))]
    number = 0
    for kind, cells in blocks.items():
        lines.append(f"*ELEMENT, TYPE={kind}, ELSET=ALL-{kind}")
        for row in cells + 1:
            number += 1
            lines.append(f"{number}, " + ", ".join(map(str, row)))
    lines += ["*NSET, NSET=ROOT", ", ".join(str(k + 1) for k in np.flatnonzero(x[:, 0] == 0)), more]
    path.write_text("\n".join(lines))


def write_nastran(path: Path, x: Array, blocks: dict[str, IntArray], more: str = "", tail: str = "") -> None:
    lines = ["BEGIN BULK", *(f"GRID,{k},,{a},{b},{c}" for k, (a, b, c) in enumerate(x, start=1))]
    number = 0
    for kind, cells in blocks.items():
        for row in cells + 1:
            number += 1
            lines.append(f"{kind},{number},7," + ",".join(map(str, row)) + tail)
    path.write_text("\n".join([*lines, more, "ENDDATA"]))


def frequencies(mesh: object) -> Array:
    return FreeBodySolver(assemble(mesh, 1, STEEL)).modes(4).omega  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("form", "element"),
    [
        *((form, element) for form in ("inp", "bdf") for element in ("quadrilateral", "triangle")),
        *(("vtk", "quadrilateral"), ("vtu", "triangle"), ("msh", "quadrilateral")),
    ],
)
def test_each_format_gives_the_same_shell(tmp_path: Path, form: str, element: str) -> None:
    x, cells = panel(element)
    path = tmp_path / f"panel.{form}"
    if form == "inp":
        write_abaqus(path, x, {"S4R" if element == "quadrilateral" else "S3": cells})
    elif form == "bdf":
        write_nastran(path, x, {"CQUAD4" if element == "quadrilateral" else "CTRIA3": cells})
    else:
        import meshio

        cell = "quad" if element == "quadrilateral" else "triangle"
        meshio.Mesh(x, [(cell, cells)]).write(path)
    mesh = read_structure(path, 1e-3, GivenSections(2e-3))
    assert frequencies(mesh) == pytest.approx(frequencies(shell_mesh(x / 1e3, cells, 2e-3)), rel=1e-6)


def test_an_offset_of_a_sheet_whose_normals_are_mixed_is_to_one_side(tmp_path: Path) -> None:
    x, cells = panel()
    mixed = np.where(np.arange(len(cells))[:, None] < len(cells) // 2, cells, cells[:, ::-1])
    points = []
    for name, own in (("one", cells), ("mixed", mixed)):
        write_abaqus(tmp_path / f"{name}.inp", x, {"S4": own})
        points.append(np.sort(read_structure(tmp_path / f"{name}.inp", 1e-3, GivenSections(2e-3, 5e-3)).points, axis=0))
    assert points[0] == pytest.approx(points[1], abs=1e-12)


def test_node_sets_and_element_sets_are_faces_and_parts(tmp_path: Path) -> None:
    x, cells = panel()
    write_abaqus(tmp_path / "panel.inp", x, {"S4": cells}, "*ELSET, ELSET=PAD\n1, 2")
    mesh = read_structure(tmp_path / "panel.inp", 1e-3, GivenSections(2e-3))
    assert len(mesh.faces["ROOT"]) == 2 * 5  # both faces of five nodes
    assert mesh.faces["PAD"].shape == (4, 3)
    assert mesh.parts["PAD"].tolist() == [0, 1]
    assert len(mesh.faces["top"]) == len(mesh.faces["bottom"]) == len(cells)


def test_quadrilaterals_beside_triangles_are_split_and_it_is_noted(tmp_path: Path) -> None:
    x, cells = panel()
    both = {"CQUAD4": cells[:-2], "CTRIA3": cells[-2:][:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)}
    write_nastran(tmp_path / "panel.bdf", x, both)
    mesh = read_structure(tmp_path / "panel.bdf", 1e-3, GivenSections(2e-3))
    assert len(mesh.cells) == 2 * len(cells)
    assert mesh.notes == ("22 quadrilaterals beside triangles are split into two triangles each",)
    assert mesh.parts["property-7"].tolist() == list(range(2 * len(cells)))


def test_a_mesh_of_shells_that_is_read_as_a_solid_says_how_to_read_it(tmp_path: Path) -> None:
    x, cells = panel()
    write_nastran(tmp_path / "panel.bdf", x, {"CQUAD4": cells})
    with pytest.raises(InputError, match=r"no solid elements.*mesh.shell = '2 mm' takes"):
        read_mesh(tmp_path / "panel.bdf", 1e-3)


def test_other_elements_are_refused_by_name(tmp_path: Path) -> None:
    """Gmsh writes shells as CPS4, which are said to be taken; elements of plane strain or of revolution aren't."""
    x, cells = panel()
    path = tmp_path / "panel.inp"
    for kind in ("CAX4", "CPE4"):
        write_abaqus(path, x, {kind: cells})
        with pytest.raises(InputError, match=f"no shells of three or four nodes; the elements: 24 {kind}"):
            read_structure(path, 1e-3, GivenSections(2e-3))
    write_abaqus(path, x, {"CPS4": cells})
    told = "CPS4 are taken as shells, which they aren't in Abaqus"
    assert read_structure(path, 1e-3, GivenSections(2e-3)).notes == (told,)
    write_abaqus(path, x, {"CPS4": cells}, "*SURFACE, NAME=SIDE\nALL-CPS4, S1")
    with pytest.raises(InputError, match="surface SIDE: S1 of CPS4 is an edge there; name it by its nodes"):
        read_structure(path, 1e-3, GivenSections(2e-3))
    write_abaqus(path, x, {"S4": cells}, "*ELEMENT, TYPE=B31\n900, 1, 2")
    with pytest.raises(InputError, match=r"beside shells of three or four nodes aren't read.*1 line"):
        read_structure(path, 1e-3, GivenSections(2e-3))
    write_abaqus(path, x, {"S4": cells, "B31": cells[:3, :2]})  # all of a named set, as stiffeners are
    with pytest.raises(InputError, match=r"beside shells of three or four nodes aren't read.*3 line"):
        read_structure(path, 1e-3, GivenSections(2e-3))
    write_nastran(path.with_suffix(".bdf"), x, {"CQUAD4": cells}, "CBAR,901,8,1,2,0.,0.,1.")
    with pytest.raises(InputError, match=r"beside shells of three or four nodes aren't read.*1 line"):
        read_structure(path.with_suffix(".bdf"), 1e-3, GivenSections(2e-3))
    write_abaqus(path, x, {"C3D4": cells})
    with pytest.raises(InputError, match="has solid elements: 24 tetra"):
        read_structure(path, 1e-3, GivenSections(2e-3))
    write_abaqus(path, x, {"S4": np.concatenate([cells, cells[:1]])[[0, 5, 23]]})
    with pytest.raises(InputError, match="unconnected pieces"):
        read_structure(path, 1e-3, GivenSections(2e-3))
    twice = cells.copy()
    twice[3, 3] = twice[3, 2]
    write_abaqus(path, x, {"S4": twice})
    with pytest.raises(InputError, match="1 shells have a node more than once"):
        read_structure(path, 1e-3, GivenSections(2e-3))
    write_abaqus(path, x, {"B31": cells[:, :2]})
    with pytest.raises(InputError, match="there are no shells of three or four nodes"):
        read_structure(path, 1e-3, GivenSections(2e-3))


def test_thickness_and_offset_come_from_the_sections_of_a_deck(tmp_path: Path) -> None:
    x, cells = panel()
    write_nastran(tmp_path / "panel.bdf", x, {"CQUAD4": cells}, "PSHELL,7,1,2.0,1,,1\nMAT1,1,2.1+5,,.3", ",,1.5")
    write_abaqus(
        tmp_path / "panel.inp", x, {"S4R": cells}, "*SHELL SECTION, ELSET=ALL-S4R, MATERIAL=M, OFFSET=-0.75\n2.0, 5"
    )
    plain = shell_mesh(x / 1e3, cells, 2e-3)
    for name in ("panel.bdf", "panel.inp"):
        mesh = read_structure(tmp_path / name, 1e-3, GivenSections())
        assert mesh.volume == pytest.approx(plain.volume, rel=2e-3)  # a bent sheet's is another off its middle
        n = len(mesh.points) // 2
        assert mesh.midsurface is not None
        half, middle = (mesh.points[n:] - mesh.points[:n]) / 2, (mesh.points[n:] + mesh.points[:n]) / 2
        assert np.linalg.norm(half, axis=1) == pytest.approx(1e-3, rel=1e-12)
        assert middle - mesh.midsurface.nodes[mesh.midsurface.owner[:n]] == pytest.approx(1.5 * half, abs=1e-12)
    # Moved by its offset, the shell is the same as one whose nodes are in the middle.
    flat = np.column_stack([x[:, :2], 0 * x[:, 0]])
    write_nastran(tmp_path / "flat.bdf", flat, {"CQUAD4": cells}, "PSHELL,7,1,2.0,1", ",,1.5")
    moved = frequencies(read_structure(tmp_path / "flat.bdf", 1e-3, GivenSections()))
    assert moved == pytest.approx(frequencies(shell_mesh(flat / 1e3, cells, 2e-3)), rel=1e-8)


def test_single_parts_have_a_thickness_of_their_own(tmp_path: Path) -> None:
    """They are the shells of a deck with a section for each part; of parts within parts the smallest counts."""
    x, cells = panel()
    sets = ["*ELSET, ELSET=RIB, GENERATE\n1, 12", "*ELSET, ELSET=PAD\n5, 6", "*ELSET, ELSET=LEFT, GENERATE\n13, 24"]
    own = [("LEFT", 2), ("RIB", 3), ("PAD", 5)]
    sections = [f"*SHELL SECTION, ELSET={name}, MATERIAL=M\n{t}" for name, t in own]
    write_abaqus(tmp_path / "sets.inp", x, {"S4": cells}, "\n".join(sets))
    write_abaqus(tmp_path / "deck.inp", x, {"S4": cells}, "\n".join(sets + sections))
    given = GivenSections(2e-3, by_part={"pad": 5e-3, "RIB": 3e-3})
    mesh, deck = (
        read_structure(tmp_path / "sets.inp", 1e-3, given),
        read_structure(tmp_path / "deck.inp", 1e-3, GivenSections()),
    )
    assert mesh.points.tolist() == deck.points.tolist()
    with pytest.raises(InputError, match=r"mesh\.thickness of LID, and the parts are ALL-S4, RIB, PAD, LEFT"):
        read_structure(tmp_path / "sets.inp", 1e-3, GivenSections(2e-3, by_part={"LID": 1e-3}))
    write_abaqus(tmp_path / "some.inp", x, {"S4": cells}, "\n".join([*sets, sections[1]]))
    some = read_structure(tmp_path / "some.inp", 1e-3, GivenSections(by_part={"LEFT": 2e-3, "PAD": 5e-3}))
    assert some.points.tolist() == deck.points.tolist()  # the deck has the rib's alone
    across = "*ELSET, ELSET=ACROSS, GENERATE\n6, 7"
    write_abaqus(tmp_path / "across.inp", x, {"S4": cells}, "\n".join([*sets, across]))
    with pytest.raises(InputError, match=r"mesh\.thickness of PAD and of ACROSS, which share 1 shells"):
        read_structure(tmp_path / "across.inp", 1e-3, GivenSections(2e-3, by_part={"PAD": 5e-3, "ACROSS": 3e-3}))
    layered = "*SHELL SECTION, ELSET=LEFT, COMPOSITE\n1.0, 3, M, 0\n1.0, 3, M, 90"
    write_abaqus(tmp_path / "deck.inp", x, {"S4": cells}, "\n".join([*sets, *sections[1:], layered]))
    with pytest.raises(InputError, match=r"mesh\.thickness of LEFT, whose shells have layers by the deck"):
        read_structure(tmp_path / "deck.inp", 1e-3, GivenSections(by_part={"LEFT": 1e-3}))


@pytest.mark.parametrize("deck", ["absolute", "relative", "abaqus"])
def test_thickness_comes_from_the_nodes_of_a_deck(deck: str, tmp_path: Path) -> None:
    """It grows along the panel from 2 to 4 mm; of half of its elements the normals are turned."""
    x, cells = panel()
    cells[::2] = cells[::2, ::-1]
    t = 2.0 + 2.0 * (x[:, 0] - x[:, 0].min()) / np.ptp(x[:, 0])
    path = tmp_path / ("panel.inp" if deck == "abaqus" else "panel.bdf")
    if deck == "abaqus":
        at_nodes = "".join(f"\n{k + 1}, {each!r}" for k, each in enumerate(t.tolist()))
        write_abaqus(
            path, x, {"S4": cells}, f"*SHELL SECTION, ELSET=ALL-S4, NODAL THICKNESS\n1.0\n*NODAL THICKNESS{at_nodes}"
        )
    else:
        unit, flag = (2.5, "1") if deck == "relative" else (1.0, "")
        own = [f"\n+,,{flag},{','.join(f'{each / unit:.6g}' for each in t[cell])}" for cell in cells]
        write_nastran(path, x, {"CQUAD4": cells}, "PSHELL,7,1,2.5,1")
        lines = path.read_text().splitlines()
        given = iter(own)
        path.write_text("\n".join(line + (next(given) if line.startswith("CQUAD4") else "") for line in lines))
    mesh = read_structure(path, 1e-3, GivenSections())
    n = len(mesh.points) // 2
    assert mesh.midsurface is not None
    half = np.linalg.norm(mesh.points[n:] - mesh.points[:n], axis=1) / 2
    assert half == pytest.approx(t[mesh.midsurface.owner[:n]] / 2e3, rel=1e-5)


@pytest.mark.parametrize(
    ("section", "tail", "message"),
    [
        ("", "", "24 of its 24 shells have no thickness"),
        ("PSHELL,7,1,2.0,1,1.3", "", "PSHELL 7 has 12I/T"),
        ("PSHELL,7,1,2.0", "", "PSHELL 7 bends by another material"),
        ("PCOMPG,7", "", "PCOMPG 7"),
        ("PSHELL,7,1,2.0,1,,1\nSNORM,3,,0.,0.,1.", "", "SNORM 3"),
        ("PCOMP,7\n+,1,2.0", "\n+,,,2.0,2.0,2.1,2.1", "PCOMP 7 is of elements with thicknesses of their own and 23"),
    ],
)
def test_sections_that_are_more_than_a_thickness_are_refused(
    tmp_path: Path, section: str, tail: str, message: str
) -> None:
    x, cells = panel()
    write_nastran(tmp_path / "panel.bdf", x, {"CQUAD4": cells}, section, tail)
    with pytest.raises(InputError, match=message):
        read_structure(tmp_path / "panel.bdf", 1e-3, GivenSections())
    assert read_structure(tmp_path / "panel.bdf", 1e-3, GivenSections(2e-3)).volume > 0


NODAL = "*SHELL SECTION, ELSET=ALL-S4, NODAL THICKNESS\n1.0\n*NODAL THICKNESS"


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ("", "says no thickness of its shells"),
        ("*SHELL SECTION, ELSET=ALL-S4, NODAL THICKNESS\n1.0, 3, M", "24 of its 24 shells have no thickness"),
        ("*SHELL SECTION, ELSET=ALL-S4, NODAL THICKNESS, OFFSET=0.5\n1.0", "NODAL THICKNESS and OFFSET"),
        (NODAL + ", GENERATE\n1, 35, 1, 2.0", r"\*NODAL THICKNESS with GENERATE; give"),
        (NODAL + "\n3, 2.0\n99, 2.0", "THICKNESS of 99, which is no node and no set of nodes"),
        (NODAL + "\nedges, 2.0", "THICKNESS of edges, which is no node"),
        ("*SHELL SECTION, ELSET=ALL-S4, SHELL THICKNESS=D\n1.0", "with SHELL THICKNESS"),
        ("*SHELL GENERAL SECTION, ELSET=ALL-S4\n1.0", "SHELL GENERAL SECTION"),
        ("*SHELL SECTION, ELSET=ALL-S4\n1.0\n*NORMAL\n1, 1, 0., 0.6, 0.8", r"read: \*NORMAL, their normals; give"),
        ("*SHELL SECTION, ELSET=ALL-S4, OFFSET=EDGE\n1.0", "neither a share nor SPOS"),
        ("*SHELL SECTION, ELSET=ALL-S4\n,5", "has no thickness"),
    ],
)
def test_sections_of_abaqus_that_are_more_than_a_thickness_are_refused(
    tmp_path: Path, section: str, message: str
) -> None:
    x, cells = panel()
    write_abaqus(tmp_path / "panel.inp", x, {"S4": cells}, section)
    with pytest.raises(InputError, match=message):
        read_structure(tmp_path / "panel.inp", 1e-3, GivenSections())


def test_a_panel_of_shear_alone_is_no_shell(tmp_path: Path) -> None:
    path = tmp_path / "a.bdf"
    grid = "".join(
        f"GRID,{k},,{x},{y},0.\n" for k, x, y in ((1, 0.0, 0.0), (2, 1.0, 0.0), (3, 1.0, 1.0), (4, 0.0, 1.0))
    )
    path.write_text(f"BEGIN BULK\n{grid}CSHEAR,1,7,1,2,3,4\nCQUAD4,2,7,1,2,3,4\nENDDATA\n")
    with pytest.raises(InputError, match="CSHEAR"):
        read_structure(path, 1.0, GivenSections(0.01))
