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
