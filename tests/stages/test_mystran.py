"""Solids, shells and bars of one deck of Nastran, joined by rigid links, beside MYSTRAN's frequencies."""

from itertools import count, pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.stages.test_structures import METAL, Deck, part_of

# MYSTRAN 17.0 (77d970d), modes 7 to 14 of this deck with a CONM2 at each node of the bars for their rotary inertia,
# which its CBAR hasn't: ρ l (I1 + I2) about the bar, ρ l I1 and ρ l I2 across. Without it the second is 589.0 Hz.
MYSTRAN_HZ = [215.1675, 562.1248, 744.9549, 1463.384, 2209.294, 2687.844, 3793.625, 4507.349]


def card(*fields: object) -> str:
    """A card in free fields, eight and its name a line."""
    name, *rest = map(str, fields)
    return ",+\n+,".join(",".join(rest[i : i + 8]) for i in range(0, len(rest), 8)).join([f"{name},", ""])


def write_nastran(deck: Deck, more: list[str], path: Path) -> None:
    """Write nodes and elements of a deck as Nastran's bulk data, and further cards."""
    number = count(1)
    lines = [f"GRID,{k},,{x:.6f},{y:.6f},{z:.6f}" for k, (x, y, z) in enumerate(deck.nodes, start=1)]
    for kind, property_number in (("C3D8I, ELSET=BLOCK", 1), ("S4, ELSET=FIN", 2), ("B31, ELSET=BAR", 3)):
        name = ("CHEXA", "CQUAD4", "CBAR")[property_number - 1]
        towards = deck.towards if name == "CBAR" else []
        lines += [card(name, next(number), property_number, *cell, *towards) for cell in deck.elements[kind]]
    lines += ["PSOLID,1,1,,TWO", "PSHELL,2,1,.004,1,,1", "PBARL,3,1,,BAR,,,,,+", "+,.01,.02", "MAT1,1,7.+10,,.33,2700."]
    path.write_text("\n".join(["BEGIN BULK", *lines, *more, "ENDDATA", ""]))


def test_solids_shells_and_bars_by_rigid_links_have_the_frequencies_of_mystran(tmp_path: Path) -> None:
    deck, x, y = Deck(), np.linspace(0, 0.02, 5), np.linspace(-0.02, 0.02, 9)
    block = deck.block(x, y, np.linspace(-0.02, 0, 9))
    near = [n for (_, j, k), n in block.items() if k == 8 and abs(y[j]) < 0.006]
    low = [n for (_, _, k), n in block.items() if not k]
    rows = [[deck.node(each, 0, z) for each in np.linspace(0, 0.02, 9)] for z in np.linspace(0, 0.06, 25)]
    deck.elements["S4, ELSET=FIN"] = [[a[i], a[i + 1], b[i + 1], b[i]] for a, b in pairwise(rows) for i in range(8)]
    root = deck.node(0.01, 0, 0)
    strut = [deck.node(0.01, each, 0.06) for each in np.linspace(0, 0.08, 17)]
    hung = [deck.node(0.01, 0, -0.02 - each) for each in np.linspace(0, 0.1, 21)]
    deck.elements["B31, ELSET=BAR"] = [list(ends) for line in (strut, hung) for ends in pairwise(line)]
    deck.towards = [1.0, 0.5, 0.3]
    links = [(root, *rows[0], *near), (strut[0], *rows[-1]), (hung[0], *low)]
    cards = [card("RBE2", 9001 + k, first, 123456, *others) for k, (first, *others) in enumerate(links)]
    mass = [f"CONM2,9009,{hung[-1]},,.05,,,,,+", "+,1.-5,,1.-5,,,1.-5"]
    write_nastran(deck, [*cards, *mass], tmp_path / "a.bdf")
    mesh = {"file": str(tmp_path / "a.bdf"), "unit": "m", "mass_unit": "kg", "force_unit": "N"}
    part = part_of({"mesh": mesh | {"shell": "deck", "beam": "deck"}, **METAL, "modes": {"count": 8}})
    assert part.modes.omega / (2 * np.pi) == pytest.approx(MYSTRAN_HZ, rel=3.5e-3)
