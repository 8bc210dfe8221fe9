"""Beams of decks: the same frame from Nastran and Abaqus, orientation, offsets, links, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

import fmd
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.fem.assembly import assemble
from fmd.fem.beams import BeamLine, Beams, extrude
from fmd.fem.deck_links import find_deck_links
from fmd.fem.formats.beam_sections import DeckBeams, take_abaqus_section
from fmd.fem.formats.import_joined import read_structure
from fmd.fem.formats.import_mesh import read_mesh
from fmd.fem.links import link_points
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.sections import (
    NumberedSection,
    Section,
    box_section,
    i_section,
    numbered_section,
    rectangular_section,
    round_section,
)
from fmd.fem.strain import TENSOR
from fmd.output.frequencies import mode_warnings
from fmd.recovery.stress import modal_stress
from fmd.reduction.eigen import FreeBodySolver


def read_beams(path: Path, scale: float, mass_unit: float | None = None) -> SolidMesh:
    mesh = read_structure(path, scale, None, True, units=(mass_unit, None))
    assert isinstance(mesh, SolidMesh)
    return mesh


STEEL = Material(210e9, 0.3, 7850.0)
X = np.array([(0.0, 0, 0), (300, 0, 0), (300, 400, 50), (0, 400, 0), (600, 0, 100)])  # mm
ENDS = np.array([(0, 1), (1, 2), (2, 3), (1, 4)])
TOWARDS = np.array([(0.0, 1, 0.2), (0, 0, 1), (0.1, 0, 1), (0, 1, 0)])
# What a deck calls it in Nastran and in Abaqus [mm], and what it is [m]; first axes are alike.
SECTIONS = {
    "rectangle": (("BAR", "30.", "20."), ("RECT", "20, 30"), rectangular_section(0.02, 0.03)),
    "round": (("ROD", "12."), ("CIRC", "12"), round_section(0.024)),
    "tube": (("TUBE", "12.", "9."), ("PIPE", "12, 3"), round_section(0.024, 0.018)),
    "box": (("BOX", "30.", "20.", "2.", "2."), ("BOX", "20, 30, 2, 2, 2, 2"), box_section(0.02, 0.03, 0.002)),
}


def frequencies(mesh: SolidMesh) -> Array:
    fe = assemble(mesh, 1, STEEL)
    if mesh.connections is not None:
        fe = link_points(fe, find_deck_links(mesh.connections, fe))
    return FreeBodySolver(fe).modes(8).omega


def turned_ends(path: Path, kind: str = "CORD2R") -> Path:
    """The frame with all points moving in a system whose x is the basic y, by GRDSET, and vectors and offsets in it."""
    text = nastran(path, SECTIONS["rectangle"][0], tail=",\n+,,,3.,-0.,5.,3.,-0.,8.").read_text()
    for v in TOWARDS:
        text = text.replace(f",{v[0]},{v[1]},{v[2]},", f",{v[1]},{-v[0]},{v[2]},")
    path.write_text(text.replace("ENDDATA", f"{kind},5,,0.,0.,0.,0.,0.,1.\n,0.,1.,0.\nGRDSET,,,,,,5\nENDDATA"))
    return path


def test_vectors_and_offsets_are_in_the_systems_that_their_ends_move_in(tmp_path: Path) -> None:
    offsets = np.tile(np.array([(0.0, 3, 5), (0, 3, 8)]), (4, 1, 1))
    exact = frequencies(frame(SECTIONS["rectangle"][2], offsets=offsets))
    assert frequencies(read_beams(turned_ends(tmp_path / "a.bdf"), 1e-3)) == pytest.approx(exact, rel=1e-8)
    with pytest.raises(InputError, match="CBAR 1 has a vector or an offset in the round coordinate system 5 of grid"):
        read_beams(turned_ends(tmp_path / "a.bdf", "CORD2C"), 1e-3)


def frame(section: Section, turned: bool = False, offsets: Array | None = None) -> SolidMesh:
    axes = []
    for k, (a, b) in enumerate(X[ENDS] + (0.0 if offsets is None else offsets)):
        x = (b - a) / np.linalg.norm(b - a)
        z = np.cross(x, TOWARDS[k])
        z /= np.linalg.norm(z)
        y = np.cross(z, x)
        axes.append([x, -z, y] if turned else [x, y, z])
    of = np.zeros(len(ENDS), dtype=int)
    moved = None if offsets is None else offsets / 1e3
    return extrude(Beams(X / 1e3, ENDS, np.array(axes), (section,), of, {}, {}, moved))


def nastran(path: Path, section: tuple[str, ...], *more: str, tail: str = "") -> Path:
    lines = ["BEGIN BULK", *(f"GRID,{k},,{a},{b},{c}" for k, (a, b, c) in enumerate(X, start=1))]
    for k, ((a, b), v) in enumerate(zip(ENDS + 1, TOWARDS, strict=True), start=1):
        lines.append(f"CBAR,{k},7,{a},{b},{v[0]},{v[1]},{v[2]}" + tail)
    lines.append(f"PBARL,7,1,,{section[0]}\n+,{','.join(section[1:])}")
    path.write_text("\n".join([*lines, *more, "ENDDATA"]))
    return path


def abaqus(path: Path, section: tuple[str, str]) -> Path:
    lines = ["*NODE", *(f"{k}, {a}, {b}, {c}" for k, (a, b, c) in enumerate(X, start=1))]
    for k, ((a, b), v) in enumerate(zip(ENDS + 1, TOWARDS, strict=True), start=1):
        lines += [f"*ELEMENT, TYPE=B31, ELSET=E{k}", f"{k}, {a}, {b}"]
        lines += [f"*BEAM SECTION, ELSET=E{k}, MATERIAL=M, SECTION={section[0]}", section[1], "{}, {}, {}".format(*v)]
    path.write_text("\n".join([*lines, "*NSET, NSET=ROOT", "1"]))
    return path


@pytest.mark.parametrize("name", SECTIONS)
def test_a_frame_is_the_same_from_nastran_and_abaqus(tmp_path: Path, name: str) -> None:
    of_nastran, of_abaqus, section = SECTIONS[name]
    exact = frequencies(frame(section))
    assert frequencies(read_beams(nastran(tmp_path / "a.bdf", of_nastran), 1e-3)) == pytest.approx(exact, rel=1e-8)
    found = read_beams(abaqus(tmp_path / "a.inp", of_abaqus), 1e-3)
    assert frequencies(found) == pytest.approx(exact, rel=1e-8)
    assert sorted(found.parts) == ["E1", "E2", "E3", "E4"]
    assert found.points[found.faces["ROOT"]].mean(axis=0) == pytest.approx(0.0, abs=1e-9)


def test_beams_of_three_nodes_are_two_of_two(tmp_path: Path) -> None:
    """Sets have both, by ELSET, by numbers and by ranges; the orientation is that of the whole."""
    deck = abaqus(tmp_path / "b.inp", ("RECT", "4, 6")).read_text()
    middles = [f"{k}, {a}, {b}, {c}" for k, (a, b, c) in enumerate(X[ENDS].mean(axis=1), start=100)]
    deck = deck.replace("*NODE", "\n".join(["*NODE", *middles]))
    deck += "\n*ELSET, ELSET=TWO, GENERATE\n1, 2\n*ELSET, ELSET=ONE\n3\n*NSET, NSET=BOTH, ELSET=E1"
    three, two = deck.replace("=B31", "=B32"), deck
    for k, (a, b) in enumerate(ENDS + 1, start=1):
        three = three.replace(f"\n{k}, {a}, {b}\n", f"\n{k}, {a}, {99 + k}, {b}\n")
        two = two.replace(f"\n{k}, {a}, {b}\n", f"\n{k}, {a}, {99 + k}\n{10 + k}, {99 + k}, {b}\n")
    (tmp_path / "two.inp").write_text(two)
    (tmp_path / "three.inp").write_text(three)
    found, same = (read_beams(tmp_path / f"{name}.inp", 1e-3) for name in ("three", "two"))
    assert frequencies(found) == pytest.approx(frequencies(same), rel=1e-9)
    assert len(found.parts["ONE"]) == len(found.parts["E1"]) == len(same.parts["E1"])
    assert len(found.parts["TWO"]) == 2 * len(found.parts["ONE"])
    assert len(found.faces["BOTH"]) == len(same.faces["BOTH"]) > 3 * len(found.faces["ROOT"])
    assert found.notes == (f"beams of three nodes, two of two nodes in place of each: {len(ENDS)}",)


def test_a_circle_is_by_abaqus_radius_which_is_said_or_by_calculix_two_diameters(tmp_path: Path) -> None:
    """CalculiX 2.20 has 1375.3 Hz for 200 mm of free steel by CIRC 12: slender theory has 1381.3 for 12 mm across."""
    by_radius = read_beams(abaqus(tmp_path / "a.inp", ("CIRC", "12")), 1e-3)
    assert "E1: CIRC 12 is a radius, as in Abaqus, here and elsewhere; CalculiX takes it for the" in by_radius.notes[0]
    mesh = {"file": str(tmp_path / "a.inp"), "unit": "mm", "beam": "deck"}
    body = {"mesh": mesh, "E": "210 GPa", "nu": 0.3, "rho": "7850 kg/m^3", "modes": {"count": 2}}
    (warning,) = mode_warnings(fmd.load({"title": "Frame", "body": {"frame": body}}).run)
    assert warning == {"code": "radius", "body": "frame", "text": f"frame: {by_radius.notes[0]}"}
    by_diameters = read_beams(abaqus(tmp_path / "a.inp", ("CIRC", "24, 24")), 1e-3)
    assert by_diameters.notes == ()
    deck = DeckBeams(notes=["another note"])
    for name in ("ONE", "TWO"):
        take_abaqus_section(deck, name, {"SECTION": "CIRC"}, [["12"]])
    assert [note[:24] for note in deck.notes] == ["another note", "*BEAM SECTION of ONE: CI"]
    assert by_diameters.points == pytest.approx(by_radius.points, abs=1e-15)


def test_an_i_has_its_web_along_nastrans_first_axis_and_abaqus_second(tmp_path: Path) -> None:
    section = i_section(0.02, 0.04, 0.002, 0.003)
    path = nastran(tmp_path / "a.bdf", ("I", "40.", "20.", "20.", "2.", "3.", "3."))
    assert frequencies(read_beams(path, 1e-3)) == pytest.approx(frequencies(frame(section, turned=True)), rel=1e-8)
    path = abaqus(tmp_path / "a.inp", ("I", "20, 40, 20, 20, 3, 3, 2"))
    assert frequencies(read_beams(path, 1e-3)) == pytest.approx(frequencies(frame(section)), rel=1e-8)


def test_offsets_and_vectors_towards_points_are_those_of_the_cards(tmp_path: Path) -> None:
    offsets = np.tile(np.array([(0.0, 3, 5), (0, 3, 8)]), (4, 1, 1))
    path = nastran(tmp_path / "a.bdf", SECTIONS["rectangle"][0], tail=",\n+,,,0.,3.,5.,0.,3.,8.")
    exact = frequencies(frame(SECTIONS["rectangle"][2], offsets=offsets))
    assert frequencies(read_beams(path, 1e-3)) == pytest.approx(exact, rel=1e-8)
    text = nastran(path, SECTIONS["rectangle"][0], "GRID,90,,0.,100.,20.").read_text()
    path.write_text(text.replace("CBAR,1,7,1,2,0.0,1.0,0.2", "CBAR,1,7,1,2,90"))
    exact = frequencies(frame(SECTIONS["rectangle"][2]))
    assert frequencies(read_beams(path, 1e-3)) == pytest.approx(exact, rel=1e-8)


def test_a_mesh_of_beams_that_is_read_as_a_solid_says_how_to_read_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no solid elements.*mesh\.beam = 'deck' takes lines as beams"):
        read_mesh(nastran(tmp_path / "a.bdf", SECTIONS["tube"][0]), 1e-3)


def test_a_mass_beside_a_beams_node_turns_with_its_section(tmp_path: Path) -> None:
    """CONM2 with an offset on the node is one at the end of an RBE2's arm."""
    own = nastran(tmp_path / "a.bdf", SECTIONS["tube"][0], "CONM2,90,5,0,0.5,0.,40.,0.")
    one = frequencies(read_beams(own, 1e-3, mass_unit=1.0))
    arm = nastran(
        tmp_path / "b.bdf", SECTIONS["tube"][0], "GRID,80,,600.,40.,100.", "RBE2,81,5,123456,80", "CONM2,90,80,0,0.5"
    )
    assert frequencies(read_beams(arm, 1e-3, mass_unit=1.0)) == pytest.approx(one, rel=1e-8)
    assert one[0] < 0.9 * frequencies(read_beams(nastran(own, SECTIONS["tube"][0]), 1e-3))[0]


@pytest.mark.parametrize(
    ("section", "more", "message"),
    [
        (("HAT", "1.", "2.", "3.", "4."), (), "PBARL 7 of type HAT; ROD, TUBE"),
        (("BOX", "30.", "20.", "2.", "3."), (), "PBARL 7 has walls that differ"),
        (("BAR", "30."), (), "PBARL 7 has fewer measures"),
        (("BAR", "30.", "20.", "1."), (), "PBARL 7 has fewer measures than its type, a mass"),
        (
            ("BAR", "30.", "20."),
            ("PBAR,8,1,1.,2.,3.",),
            "PBAR 8 has an area, a moment of inertia or a torsion constant",
        ),
        (("BAR", "30.", "20."), ("PBAR,8,1,1.,1-6,1-6,1.",), "PBAR 8 has moments of inertia as of a rod"),
        (("BAR", "30.", "20."), ("PBAR,8,1,1.,1.,1.,1.,inf",), "PBAR 8 has a number that isn't finite"),
        (
            ("BAR", "30.", "20."),
            ("PBAR,8,1,9.,9.,9.,9.\n,\n,.5,.6,1.",),
            "PBAR 8 has I12 and two factors of shear",
        ),
        (("BAR", "30.", "20."), ("PBEAM,8,1,9.,9.,9.,,9.\n,\n,YES,.5,9.",), "PBEAM 8 has stations, shear relief"),
        (("BAR", "30.", "20."), ("PROD,8,1,9.",), "PROD 8; PBAR, PBEAM, PBARL and PBEAML are read"),
        (("BAR", "30.", "20."), ("CROD,90,7,1,3",), "CROD 90; CBAR and CBEAM are read"),
        (("BAR", "30.", "20."), ("CBAR,90,8,1,3,0.,0.,1.",), "CBAR 90 has no section"),
        (("BAR", "30.", "20."), ("CBAR,90,7,1,3",), "CBAR 90 has no orientation vector"),
        (("BAR", "30.", "20."), ("CBAR,90,7,1,2,1.,0.,0.",), "CBAR 90 has an orientation vector along itself"),
        (("BAR", "30.", "20."), ("CBAR,90,7,1,3,0.,0.,1.,GGO",), "CBAR 90 has OFFT other than GGG"),
        (("BAR", "30.", "20."), ("CTRIA3,90,9,1,2,3",), "is of beams of two nodes alone; the elements: .*1 triangle"),
    ],
)
def test_beams_that_are_not_read_are_refused_by_name(
    tmp_path: Path, section: tuple[str, ...], more: tuple[str, ...], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read_beams(nastran(tmp_path / "a.bdf", section, *more), 1e-3)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        (("TRAPEZOID", "1, 2, 3, 4"), "with SECTION = TRAPEZOID; CIRC, PIPE"),
        (("CIRC", "12, 6"), "E1 with SECTION = CIRC of two thicknesses is an ellipse"),
        (("RECT", "20"), r"\*BEAM SECTION of E1 has not the 2 measures"),
        (("I", "20, 40, 20, 30, 3, 3, 2"), "walls that differ from side to side"),
        (("RECT", "20, 30\n*TRANSVERSE SHEAR STIFFNESS\n1., 1."), r"\*TRANSVERSE SHEAR STIFFNESS behind a section"),
        (
            ("RECT", "20, 30\n*BEAM GENERAL SECTION, ELSET=E1\n1., 1., 0., 1., 1., 2."),
            r"\*BEAM GENERAL SECTION of E1 has not A, I11, I12, I22 and J alone",
        ),
    ],
)
def test_sections_of_abaqus_that_are_not_read_are_refused_by_name(
    tmp_path: Path, section: tuple[str, str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read_beams(abaqus(tmp_path / "a.inp", section), 1e-3)


def numbers_of(section: Section, scale: float = 1e3) -> tuple[float, float, float, float, Array]:
    """Area, ∫ z², ∫ y² and J in the file's unit, and shares of shear."""
    about_y, about_z = scale**4 * section.moments * section.bending**2
    return scale**2 * section.area, about_y, about_z, scale**4 * section.torsion, section.shear_areas(STEEL.nu)


def moved_by_nodes(fe: FEModel) -> Array:
    """Displacements of all points by displacements and then rotations of the nodes."""
    line = fe.discretisation.mesh.midsurface
    assert line is not None
    assert fe.T is not None
    assert fe.arms is not None
    n = 3 * len(line.nodes)
    shown = sp.vstack([fe.T[3 * len(line.owner) :][:n], (fe.arms.turn @ fe.T)[:n]])
    return np.asarray(np.linalg.solve(shown.toarray().T, fe.T.toarray().T).T)


def on_nodes(mesh: SolidMesh) -> tuple[Array, Array]:
    """Stiffness and mass by displacements and then rotations of the nodes."""
    fe = assemble(mesh, 1, STEEL)
    T = moved_by_nodes(fe)
    return T.T @ fe.K @ T, T.T @ sp.kron(fe.m, np.eye(3)) @ T


def turned_numbers(about_y: float, about_z: float, a: float) -> tuple[float, float, float]:
    """∫ z², ∫ y² and ∫ y z of a section whose y is turned by a from the beam's first axis."""
    mean, half = 0.5 * (about_z + about_y), 0.5 * (about_z - about_y)
    return mean - half * np.cos(2 * a), mean + half * np.cos(2 * a), half * np.sin(2 * a)


@pytest.mark.parametrize("name", SECTIONS)
def test_a_section_by_its_numbers_has_the_matrices_of_the_drawn_one(tmp_path: Path, name: str) -> None:
    section = SECTIONS[name][2]
    A, about_y, about_z, J, (k_y, k_z) = numbers_of(section)
    wanted = on_nodes(frame(section))
    text = nastran(tmp_path / "a.bdf", SECTIONS["rectangle"][0]).read_text()
    path = tmp_path / "b.bdf"
    for card in (
        f"PBAR,7,1,{A},{about_z},{about_y},{J}\n,\n,{k_y},{k_z}",
        f"PBEAM,7,1,{A},{about_z},{about_y},,{J}\n,\n,{k_y},{k_z}",
        f"PBEAM,7,1,{A},{about_z},{about_y},,{J}\n,\n,YES,1.,{A},{about_z},,,{J}\n,\n,{k_y},{k_z}",
    ):
        path.write_text(text.replace("PBARL,7,1,,BAR\n+,30.,20.", card))
        for found, exact in zip(on_nodes(read_beams(path, 1e-3)), wanted, strict=True):
            assert abs(found - exact).max() < 1e-12 * abs(exact).max()


def test_numbers_of_a_section_that_stands_obliquely_turn_it(tmp_path: Path) -> None:
    """By PBAR, ``*BEAM GENERAL SECTION``, and a mass beside the section's own."""
    drawn, a = rectangular_section(0.02, 0.03), 0.3
    A, about_y, about_z, J, _ = numbers_of(drawn)
    own = numbered_section(drawn.area, (drawn.moments[0], drawn.moments[1]), drawn.torsion, (1.0, 1.0))
    line = frame(own).midsurface
    assert isinstance(line, BeamLine)
    x, y, z = line.axes[np.unique(line.beam, return_index=True)[1]].transpose(1, 0, 2)
    axes = np.stack([x, np.cos(a) * y + np.sin(a) * z, np.cos(a) * z - np.sin(a) * y], axis=1)
    wanted = on_nodes(extrude(Beams(X / 1e3, ENDS, axes, (own,), np.zeros(4, dtype=int), {}, {})))
    about_y, about_z, product = turned_numbers(about_y, about_z, a)
    path = nastran(tmp_path / "a.bdf", SECTIONS["rectangle"][0])
    heavy = f"PBAR,7,1,{A},{about_z},{about_y},{J},0.002\n,\n,1.,1.,{product}"
    path.write_text(path.read_text().replace("PBARL,7,1,,BAR\n+,30.,20.", heavy))
    with pytest.raises(InputError, match=r"mass of their own, NSM, whose unit is wanted: mesh\.mass_unit"):
        read_beams(path, 1e-3)
    length = sum(float(np.linalg.norm(X[e] - X[b])) for b, e in ENDS) / 1e3
    mass = assemble(read_beams(path, 1e-3, mass_unit=1.0), 1, STEEL).mass
    assert mass == pytest.approx((2.0 + STEEL.rho * drawn.area) * length, rel=1e-9)
    in_metres = assemble(read_beams(path, 1.0), 1, STEEL).mass  # kg, as of all files in metres
    assert in_metres == pytest.approx((0.002 + STEEL.rho * A) * 1e3 * length, rel=1e-9)
    path.write_text(path.read_text().replace(f"{J},0.002", f"{J},"))
    general = abaqus(tmp_path / "a.inp", ("RECT", f"{A}, {about_y}, {product}, {about_z}, {J}"))
    general.write_text(
        general.read_text().replace("*BEAM SECTION", "*BEAM GENERAL SECTION").replace("=RECT", "=GENERAL")
    )
    points = "*SECTION POINTS\n10., 15., -10., 15., -10., -15., 10., -15."
    general.write_text(general.read_text().replace("*NSET", points + "\n*NSET"))
    line = read_beams(general, 1e-3).midsurface
    assert isinstance(line, BeamLine)
    section = line.sections[-1]
    assert isinstance(section, NumberedSection)
    assert section.seen is not None
    along = TOWARDS[-1] / np.linalg.norm(TOWARDS[-1])  # the second axis is across the last beam and this, the first
    x = line.axes[-1, 0]
    first = along - (along @ x) * x
    first /= np.linalg.norm(first)
    at = section.seen @ line.axes[-1, 1:] @ np.stack([first, np.cross(x, first)]).T
    assert sorted((1e3 * at).round(6).tolist()) == [[-10, -15], [-10, 15], [10, -15], [10, 15]]
    for mesh in (read_beams(path, 1e-3), read_beams(general, 1e-3)):
        for found, exact in zip(on_nodes(mesh), wanted, strict=True):
            assert abs(found - exact).max() < 1e-11 * abs(exact).max()


def test_stress_of_a_section_by_its_numbers_is_that_at_its_points(tmp_path: Path) -> None:
    """Along each beam that at the corners of the box that has these numbers, and none without points."""
    section, rng = SECTIONS["box"][2], np.random.default_rng(1)
    A, about_y, about_z, J, (k_y, k_z) = numbers_of(section)
    text = nastran(tmp_path / "a.bdf", SECTIONS["box"][0]).read_text()
    box, path, extremes = read_beams(tmp_path / "a.bdf", 1e-3), tmp_path / "b.bdf", []
    card = f"PBAR,7,1,{A},{about_z},{about_y},{J}\n,{{}}\n,{k_y},{k_z}"
    points = "10.,15.,-10.,15.,-10.,-15.,10.,-15."
    path.write_text(text.replace("PBARL,7,1,,BOX\n+,30.,20.,2.,2.", card.format(points)))
    y = rng.normal(size=6 * len(X)) * 1e-5
    for mesh in (box, read_beams(path, 1e-3)):
        fe, line = assemble(mesh, 1, STEEL), mesh.midsurface
        assert isinstance(line, BeamLine)
        shapes = (moved_by_nodes(fe) @ y).reshape(-1, 3, 1)[: len(mesh.points)]
        stress = modal_stress(fe.discretisation, STEEL, shapes, np.arange(len(mesh.points)))
        along = np.zeros(len(mesh.points))
        single = np.isin(line.owner, [0, 3, 4])  # nodes of one beam alone
        for cell, axes in zip(mesh.cells, line.axes[:, 0], strict=True):
            along[cell] = np.einsum("a,nab,b->n", axes, stress[cell][:, TENSOR, 0], axes)
        extremes.append([(along[single & (line.owner == k)].min(), along[line.owner == k].max()) for k in (0, 3, 4)])
    assert np.array(extremes[1]) == pytest.approx(np.array(extremes[0]), rel=1e-9)
    path.write_text(text.replace("PBARL,7,1,,BOX\n+,30.,20.,2.,2.", card.format("")))
    fe = assemble(read_beams(path, 1e-3), 1, STEEL)
    with pytest.raises(InputError, match="sections by numbers without points, C to F of PBAR, so no stress"):
        modal_stress(fe.discretisation, STEEL, np.zeros((len(fe.discretisation.x), 3, 1)), np.array([0]))


@pytest.mark.parametrize("share", [0.0, 1e9])
def test_a_beam_without_a_share_of_shear_is_that_of_bernoulli(share: float) -> None:
    section = numbered_section(6e-4, (2e-8, 4.5e-8), 4e-8, (share, share))
    ends, axes, one = np.array([(0, 1)]), np.eye(3)[None], np.zeros(1, dtype=int)
    K, _ = on_nodes(extrude(Beams(np.array([(0.0, 0, 0), (1, 0, 0)]), ends, axes, (section,), one, {}, {})))
    EI, G = STEEL.E * section.moments, STEEL.E / 2.6
    wanted = [STEEL.E * 6e-4, 12 * EI[1], 12 * EI[0], G * 4e-8, 4 * EI[0], 4 * EI[1]]
    assert np.sort(np.diag(K)) == pytest.approx(np.sort([*wanted, *wanted]), rel=1e-8)


@pytest.mark.parametrize("full", [0.05, 0.95, 3.0])
def test_a_section_by_its_numbers_has_them_thin_or_full(full: float) -> None:
    area, squares = full * 72e-4, np.array([4e-4, 9e-4])
    section = numbered_section(area, (area * squares[0], area * squares[1]), 1e-8, (0.5, 0.0))
    assert section.area == pytest.approx(area, rel=1e-12)
    assert section.moments == pytest.approx(area * squares, rel=1e-12)


@pytest.mark.parametrize("full", [1e-3, 1.2, 15.0])
def test_points_of_a_section_stay_apart_however_long_the_beams_are(full: float) -> None:
    area, squares = full * 144e-6, np.array([9e-6, 16e-6])
    section = numbered_section(area, (area * squares[0], area * squares[1]), 1e-9, (1.0, 1.0))
    ends, axes = np.array([(0, 1), (1, 2)]), np.repeat(np.eye(3)[None], 2, axis=0)
    x = np.array([(0.0, 0, 0), (100, 0, 0), (200, 0, 0)])
    mesh = extrude(Beams(x, ends, axes, (section,), np.zeros(2, dtype=int), {}, {}))
    assert len(mesh.points) == 3 * len(section.points)
    K, _ = on_nodes(mesh)
    EA, EI = STEEL.E * area, STEEL.E * area * squares
    assert np.diag(K)[[0, 9, 10, 11]] == pytest.approx([EA / 100, 1e-9 * STEEL.E / 260, *(EI / 25)], rel=1e-5)


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_shear_stress_of_a_section_by_its_numbers_is_force_over_area(share: float) -> None:
    seen = np.array([(0.01, 0.015), (-0.01, 0.015), (-0.01, -0.015), (0.01, -0.015)])
    section = numbered_section(6e-4, (4.5e-8, 2e-8), 4e-8, (share, share), seen=seen)
    x, one = np.array([(0.0, 0, 0), (1, 0, 0)]), np.zeros(1, dtype=int)
    fe = assemble(extrude(Beams(x, np.array([(0, 1)]), np.eye(3)[None], (section,), one, {}, {})), 1, STEEL)
    T, free, n = moved_by_nodes(fe), np.array([3, 4, 5, 9, 10, 11]), len(fe.discretisation.x)
    y = np.zeros(12)
    y[free] = np.linalg.solve((T.T @ fe.K @ T)[np.ix_(free, free)], [0.0, 600.0, -300.0, 0.0, 0.0, 0.0])
    stress = modal_stress(fe.discretisation, STEEL, (T @ y).reshape(-1, 3, 1)[:n], np.arange(n))[:, TENSOR, 0]
    assert stress[:, 0, 1] == pytest.approx(1e6, rel=1e-6)
    assert stress[:, 0, 2] == pytest.approx(-0.5e6, rel=1e-6)
    assert stress[:, 0, 0].max() == pytest.approx(600 * 0.01 / 2e-8 + 300 * 0.015 / 4.5e-8, rel=1e-9)
