"""Layers of decks, Nastran's PCOMP and Abaqus' COMPOSITE, beside the same laminates made by hand."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmd
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.fem.assembly import assemble
from fmd.fem.formats.nastran import read_nastran
from fmd.fem.formats.shell_sections import orientation_direction
from fmd.fem.laminate import Lamina, Laminate, Ply
from fmd.fem.layered import Layered
from fmd.reduction.eigen import FreeBodySolver
from tests.fem.formats.test_import_shell import panel, write_abaqus
from tests.fem.sheets import shell_mesh

CARBON = {"E1": "135 GPa", "E2": "10 GPa", "nu12": 0.3, "G12": "5 GPa", "G13": "5 GPa", "G23": "3 GPa"}
LAMINA = Lamina(135e9, 10e9, 0.3, 5e9, 5e9, 3e9, 1550.0)
X, CELLS = panel()
N = len(CELLS) // 2


def part(path: Path, **more: Any) -> Any:
    body = {"mesh": {"file": str(path), "unit": "mm", "shell": "deck"}, "modes": {"count": 4}}
    return fmd.load({"title": "Deck", "body": {"panel": body | more}}).run.part


def by_hand(*plies: tuple[float, float], offset: float = 0.0) -> Array:
    laminate = Laminate(tuple(Ply(LAMINA, t, np.radians(a)) for t, a in plies))
    mesh = shell_mesh(X / 1e3, CELLS, laminate.thickness, offset)
    material = Layered(laminate, np.tile([1.0, 0, 0], (len(CELLS), 1)))
    return np.asarray(FreeBodySolver(assemble(mesh, 1, material)).modes(4).omega)


def write_nastran(path: Path, properties: str, theta: str = "") -> None:
    """Write the panel, the second half of its elements with their normals to the other side and property 8."""
    lines = ["BEGIN BULK", *(f"GRID,{k},,{a},{b},{c}" for k, (a, b, c) in enumerate(X, start=1))]
    for k, row in enumerate(CELLS + 1):
        own, name = (row, 7) if k < N else (row[[1, 0, 3, 2]], 8)
        lines.append(f"CQUAD4,{k + 1},{name}," + ",".join(map(str, own)) + f",{theta}")
    path.write_text("\n".join([*lines, properties, "ENDDATA"]))


def test_layers_of_nastran_are_those_of_each_element_on_both_sides_of_a_sheet(tmp_path: Path) -> None:
    deck = tmp_path / "panel.bdf"
    write_nastran(
        deck,
        "PCOMP,7\n+,1,0.5,30.,YES,,1.0,90.,YES\n+,1,0.25,0.\n"  # a blank material is the one before
        "PCOMP,8\n+,1,0.25,0.,,,1.0,-90.\n+,1,0.5,-30.",
    )
    found = part(deck, lamina={"1": CARBON | {"rho": "1550 kg/m^3"}})
    assert found.modes.omega == pytest.approx(by_hand((0.5e-3, 30), (1e-3, 90), (0.25e-3, 0)), rel=1e-9)


def test_symmetric_layers_and_materials_axes_of_nastran(tmp_path: Path) -> None:
    deck = tmp_path / "panel.bdf"
    half = "PCOMP,{},,,,,,,SYM\n+,1,0.5,{},,,0.25,0."
    lamina = {"1": CARBON | {"rho": "1550 kg/m^3"}}
    expected = by_hand((0.5e-3, 30), (0.25e-3, 10), (0.25e-3, 10), (0.5e-3, 30))
    # Along the other normal THETA turns to the other side: 10° there are −10° here, from which −40° are 40°.
    half8 = "PCOMP,8,,,,,,,SYM\n+,1,0.5,-40.,,,0.25,-20."
    write_nastran(deck, half.format(7, "20.") + "\n" + half8, theta="10.")
    assert part(deck, lamina=lamina).modes.omega == pytest.approx(expected, rel=1e-3)
    system = f"CORD2R,5,,0.,0.,0.,0.,0.,1.\n+,{np.cos(np.pi / 18)},{np.sin(np.pi / 18)},0."
    write_nastran(deck, half.format(7, "20.") + "\n" + half.format(8, "-20.") + "\n" + system, theta="5")
    assert part(deck, lamina=lamina).material.materials[0].directions[0] == pytest.approx(
        [np.cos(np.pi / 18), np.sin(np.pi / 18), 0.0]
    )


def test_angles_on_triangles_of_nastran_turn_about_their_normal() -> None:
    deck = "GRID,1,,0.,0.,0.\nGRID,2,,2.,0.,0.\nGRID,3,,0.,1.,0.\nCTRIA3,1,7,1,2,3,30.\nPCOMP,7\n+,1,1.0"
    (shells,) = read_nastran(f"BEGIN BULK\n{deck}\nENDDATA").shells
    assert shells.direction[0] == pytest.approx([np.cos(np.pi / 6), 0.5, 0.0])


def test_orientations_that_no_shell_names_may_be_of_any_form() -> None:
    assert "isn't by numbers" in orientation_direction({"NAME": "OF-SOLIDS"}, [["distribution-1"]])


def test_layers_of_abaqus_have_an_orientation_and_an_offset(tmp_path: Path) -> None:
    deck, c, s = tmp_path / "panel.inp", np.cos(np.pi / 6), np.sin(np.pi / 6)
    section = "*SHELL SECTION, ELSET=ALL-S4, COMPOSITE, OFFSET=SNEG{}\n0.5, 3, Carbon, {}\n1.0, 3, CARBON, {}"
    expected = by_hand((0.5e-3, 30), (1e-3, 90), offset=0.75e-3)
    lamina = {"carbon": CARBON | {"rho": "1550 kg/m^3"}}
    write_abaqus(deck, X, {"S4": CELLS}, section.format("", "30.", "90"))
    assert part(deck, lamina=lamina).modes.omega == pytest.approx(expected, rel=1e-9)
    turned = f"*ORIENTATION, NAME=PLY\n{c}, {s}, 0., {-s}, {c}, 0.\n3, 0.\n"
    write_abaqus(deck, X, {"S4": CELLS}, turned + section.format(", ORIENTATION=ply", "0.", "60."))
    assert part(deck, lamina=lamina).modes.omega == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(
    ("properties", "message"),
    [
        ("PCOMP,7,,0.3\n+,1,1.0\nPCOMP,8\n+,1,1.0", r"PCOMP 7 has NSM = 0\.3"),
        ("PCOMP,7,,,,,,,SMEAR\n+,1,1.0\nPCOMP,8\n+,1,1.0", "PCOMP 7 has LAM = SMEAR"),
        ("PCOMP,7\n+,1,1.0\nPCOMP,8\n+,2,1.0", r"lamina\.2.*is missing: it is a material of the deck's layers"),
        ("PCOMP,7\n+,1,1.0\nPSHELL,8,1,1.0,1", r"body\.panel\.E.*is missing: some of the shells have no layers"),
        ("PSHELL,7,1,1.0,1\nPSHELL,8,1,1.0,1", r"lamina.*no shells have layers by the deck"),
    ],
)
def test_layers_of_decks_that_are_not_read_are_refused(tmp_path: Path, properties: str, message: str) -> None:
    write_nastran(tmp_path / "panel.bdf", properties)
    with pytest.raises(InputError, match=message):
        part(tmp_path / "panel.bdf", lamina={"1": CARBON | {"rho": "1550 kg/m^3"}}).fe  # noqa: B018


@pytest.mark.parametrize("direction", [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
def test_a_direction_of_layers_is_refused_where_the_deck_has_theirs(
    tmp_path: Path, direction: tuple[float, ...]
) -> None:
    write_nastran(tmp_path / "panel.bdf", "PCOMP,7\n+,1,1.0\nPCOMP,8\n+,1,1.0")
    lamina = {"1": CARBON | {"rho": "1550 kg/m^3"}}
    with pytest.raises(
        InputError, match=r"layer_direction.*: has no effect: it belongs to layers, and those of a deck"
    ):
        part(tmp_path / "panel.bdf", lamina=lamina, layer_direction=direction)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ("*SHELL SECTION, ELSET=ALL-S4, COMPOSITE\n1.0, 3, M, PLY", "a layer along orientation PLY"),
        ("*SHELL SECTION, ELSET=ALL-S4, COMPOSITE, ORIENTATION=PLY\n1.0, 3, M", "no *ORIENTATION above it"),
        (
            "*ORIENTATION, NAME=PLY, SYSTEM=CYLINDRICAL\n0,0,0,0,0,1\n"
            "*SHELL SECTION, ELSET=ALL-S4, COMPOSITE, ORIENTATION=PLY\n1.0, 3, M",
            "a system that isn't rectangular",
        ),
        (
            "*ORIENTATION, NAME=PLY\n1,0,0,0,1,0\n3, 30.\n"
            "*SHELL SECTION, ELSET=ALL-S4, COMPOSITE, ORIENTATION=PLY\n1.0, 3, M",
            "a turn about an axis",
        ),
    ],
)
def test_orientations_of_abaqus_that_are_not_read_are_refused(tmp_path: Path, section: str, message: str) -> None:
    write_abaqus(tmp_path / "panel.inp", X, {"S4": CELLS}, section)
    with pytest.raises(InputError) as caught:
        part(tmp_path / "panel.inp", lamina={"M": CARBON | {"rho": "1550 kg/m^3"}}).fe  # noqa: B018
    assert message in str(caught.value)
