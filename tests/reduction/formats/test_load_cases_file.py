"""Decks of load cases as text: what of the body's deck they take, and what stands beside it."""

from pathlib import Path

import numpy as np
import pytest

from fmd.core.errors import InputError
from fmd.core.rotations import rigid_motions
from fmd.reduction.formats.body_format import LoadCases
from fmd.reduction.formats.load_cases_file import write_load_cases

X = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
HEAD = """*NODE
1,0,0,0
2,1,0,0
3,0,1,0
4,0,0,1
*ELEMENT,TYPE=C3D4,ELSET=A
1,1,2,3,4
"""
SECTIONS = """*SOLID SECTION, MATERIAL=M,
 ELSET=A
*Solid  Section,ELSET="B 1",MATERIAL=M
** *SOLID SECTION, ELSET=OLD
*SOLID SECTION, ELSET=A, MATERIAL=M
"""
DAT = (
    "\n stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set A and time  0.{0}000000E+01\n\n 1 1 {0} 2 3 4 5 6\n"
)


def cases(sections: str = SECTIONS) -> LoadCases:
    load = np.zeros((4, 3))
    load[1, 2], load[3, 0] = 2.5, -1.0
    tail = "*STEP\n*FREQUENCY\n1\n*SOLID SECTION, ELSET=LATER\n*END STEP\n"
    rigid = rigid_motions(X).reshape(-1, 6)
    return LoadCases(HEAD + sections + tail, np.array([1, 2, 3, 4]), rigid, {"spin-xx": load}, {"mode-1": 2 * load})


def test_a_deck_has_the_body_a_support_and_a_step_for_each_load(tmp_path: Path) -> None:
    path = tmp_path / "cases.inp"
    assert write_load_cases(path, cases()) == [path]
    model, support, *steps = path.read_text().replace("*BOUNDARY", "@*BOUNDARY").replace("*STEP", "@*STEP").split("@")
    assert model == HEAD + SECTIONS
    held = np.array([line.split(",")[:2] for line in support.split("\n")[1:-1]], dtype=int)
    rows = rigid_motions(X).reshape(-1, 6)[3 * (held[:, 0] - 1) + held[:, 1] - 1]
    assert rows.shape == (6, 6)
    assert abs(np.linalg.det(rows)) > 0.1  # no motion of the whole is free, and none is held twice
    assert [step.splitlines()[1] for step in steps] == ["** spin-xx", "** mode-1"]
    assert "2, 3, 2.500000000000e+00\n4, 1, -1.000000000000e+00\n*NODE FILE\nU\n*EL FILE\nS\n" in steps[0]
    assert steps[1].count("*EL PRINT") == 2
    assert '*EL PRINT, ELSET=A\nS\n*EL PRINT, ELSET="B 1"\nS\n*END STEP' in steps[1]


def test_the_stress_of_the_deck_gives_one_for_each_load_that_stiffens(tmp_path: Path) -> None:
    path = tmp_path / "cases.inp"
    (tmp_path / "cases.dat").write_text(DAT.format(1) + DAT.format(2))
    written = write_load_cases(path, cases())
    assert [own.name for own in written] == ["cases.inp", "cases-kg-spin-xx.inp"]
    text = written[1].read_text()
    assert text.startswith(HEAD + SECTIONS + "*INITIAL CONDITIONS, TYPE=STRESS\n1,1,1,2,3,4,5,6\n*BOUNDARY\n1, 1, 2\n")
    assert text.endswith("*FREQUENCY, SOLVER=MATRIXSTORAGE\n1\n*END STEP\n")
    assert "LATER" not in text
    (tmp_path / "cases.dat").write_text(DAT.format(1))
    with pytest.raises(InputError, match=r"cases\.dat: has the stress of 1 steps, and cases\.inp has 2; run it anew"):
        write_load_cases(path, cases())


def test_a_deck_without_sections_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"has no \*SOLID SECTION"):
        write_load_cases(tmp_path / "cases.inp", cases("*MATERIAL, NAME=M\n"))
