"""Decks with links that aren't read: refused by name, and never left out in silence."""

from pathlib import Path

import pytest

import fmd
from fmd.core.errors import InputError
from fmd.output.frequencies import mode_warnings

CUBE = """*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
9, 0.5, 0.5, 2
*ELEMENT, TYPE=C3D8, ELSET=ALL
1, 1, 2, 3, 4, 5, 6, 7, 8
*NSET, NSET=TOP
5, 6, 7, 8
*RIGID BODY, NSET=TOP, REF NODE=9
*MPC
BEAM, 1, 2
*EMBEDDED ELEMENT
ALL
"""


def table(repair: bool) -> dict[str, object]:
    mesh = {"file": "cube.inp", "unit": "m", "repair": repair}
    return {
        "title": "Cube",
        "body": {"cube": {"mesh": mesh, "E": 70e9, "nu": 0.3, "rho": 2700.0, "modes": {"count": 2}}},
    }


def test_links_of_a_deck_are_refused_by_name_and_warned_of_where_they_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cube.inp").write_text(CUBE)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"aren't solid \(1 \*MPC, 1 \*EMBEDDED ELEMENT\)"):
        fmd.load(table(repair=False)).mesh  # noqa: B018
    warnings = mode_warnings(fmd.load(table(repair=True)).run)
    (text,) = (each["text"] for each in warnings if each["code"] == "left-out")
    assert "1 *MPC, 1 *EMBEDDED ELEMENT" in text


def test_nodes_that_an_order_adds_are_in_no_link_of_the_deck(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cube.inp").write_text(CUBE.partition("*MPC")[0])
    monkeypatch.chdir(tmp_path)
    scene = table(repair=False)
    scene["body"]["cube"]["mesh"]["order"] = 2  # type: ignore[index]
    with pytest.raises(InputError, match=r"mesh.order = 2: adds nodes that the deck's links don't have"):
        fmd.load(scene).modes  # noqa: B018
    scene["body"]["cube"]["mesh"]["order"] = 1  # type: ignore[index]
    assert fmd.load(scene).modes.n_rigid == 6


def test_a_support_holds_all_nodes_of_a_set_that_is_no_face(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sets = "*NSET, NSET=EDGE\n1, 2\n*NSET, NSET=MORE\n1, 2, 3, 4, 5\n"
    (tmp_path / "cube.inp").write_text(CUBE.partition("*RIGID")[0] + sets)
    monkeypatch.chdir(tmp_path)

    def frequencies(*support: dict[str, object]) -> list[float]:
        scene = table(repair=False)
        scene["body"]["cube"] |= {"support": support}  # type: ignore[index]
        return fmd.load(scene).modes.frequencies_hz.tolist()  # type: ignore[no-any-return]

    edge, upright = {"edge": [[0, 0, 0], [1, 0, 0]]}, {"point": [0, 0, 1]}
    assert frequencies({"face": "EDGE"}) == pytest.approx(frequencies(edge), rel=1e-12)
    more = edge, {"edge": [[0, 1, 0], [1, 1, 0]]}, upright
    assert frequencies({"face": "MORE"}) == pytest.approx(frequencies(*more), rel=1e-12)


def test_sections_that_are_not_read_are_warned_of_where_a_thickness_stands_for_them(tmp_path: Path) -> None:
    grids = [f"GRID,{k},,{x},{y},0." for k, (x, y) in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)], start=1)]
    deck = ["BEGIN BULK", *grids, "CQUAD4,1,1,1,2,3,4", "PSHELL,1,1,0.01,,,,,0.1", "ENDDATA"]
    (tmp_path / "a.bdf").write_text("\n".join(deck))
    scene = table(repair=False)
    scene["body"]["cube"]["mesh"] = {"file": str(tmp_path / "a.bdf"), "unit": "m", "shell": "20 mm"}  # type: ignore[index]
    (warning,) = (each for each in mode_warnings(fmd.load(scene).run) if each["code"] == "left-out")
    assert warning["text"].startswith("cube: sections of shells that aren't read: PSHELL 1 has NSM = 0.1 and 1 more; ")


def test_a_run_whose_output_has_no_place_for_motion_of_second_order_says_so() -> None:
    shaft = {"shape": "shaft", "segment": [{"length": 0.3, "diameter": 0.02}], "mesh": {"size": 0.05}}
    scene = table(repair=False)
    scene["body"]["cube"] |= shaft  # type: ignore[index]
    found = {}
    for to, end in (("mbdyn", "fem"), ("exudyn", "npz"), ("sid", "SID_FEM")):
        scene["output"] = [{"type": "export", "body": "cube", "format": to, "file": f"a.{end}"}]
        found[to] = [each["text"] for each in mode_warnings(fmd.load(scene).run) if "second" in each["code"]]
    assert "format mbdyn has no place" in found["mbdyn"][0]
    assert "format exudyn has no place" in found["exudyn"][0]
    assert found["sid"] == []
