"""Parts of a file that are tied, by its deck or by the scene: one body, as if their nodes were the same."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmd
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.fem.formats.abaqus import read_abaqus
from fmd.output.frequencies import mode_warnings

TIE = """*SURFACE, NAME=LOW
LOWER, S2
*SURFACE, NAME=UP, TYPE=NODE
ROOF
*TIE, NAME=SEAM, POSITION TOLERANCE=0.01
UP, LOW
"""


def deck(apart: bool) -> str:
    """Two bars of four hexahedra, one on the other, with common nodes between them or each with its own."""
    place = {}
    for part in (0, 1):
        for level in (part, part + 1):
            for k in range(10):
                place[part * apart, level, k] = (0.3 * (k % 5), 0.4 * (k // 5), 0.1 * level * (level + 1))
    number = {key: k for k, key in enumerate(place, start=1)}
    lines = ["*NODE", *(f"{number[key]}, {x}, {y}, {z}" for key, (x, y, z) in place.items())]
    for part, name in enumerate(("LOWER", "UPPER")):
        lines.append(f"*ELEMENT, TYPE=C3D8, ELSET={name}")
        for k in range(4):
            nodes = [number[part * apart, part + up, k + j] for up in (0, 1) for j in (0, 1, 6, 5)]
            lines.append(", ".join(map(str, (4 * part + k + 1, *nodes))))
    lines += ["*NSET, NSET=ROOF", ", ".join(str(number[apart * 1, 1, k]) for k in range(10))]
    lines += ["*NSET, NSET=FLOOR", ", ".join(str(number[0, 1, k]) for k in range(10)), ""]
    return "\n".join(lines)


def frequencies(folder: Path, text: str, **mesh: Any) -> Array:
    (folder / "bars.inp").write_text(text)
    table = {"file": "bars.inp", "unit": "m"} | mesh
    body = {"mesh": table, "E": 70e9, "nu": 0.3, "rho": 2700.0, "modes": {"count": 6}}
    return np.asarray(fmd.load({"title": "Bars", "body": {"bars": body}}).modes.frequencies_hz)


@pytest.mark.parametrize("order", [1, 2])
def test_a_tie_of_meshes_that_match_is_as_good_as_common_nodes(
    order: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    wanted = frequencies(tmp_path, deck(apart=False), order=order)
    by_deck = frequencies(tmp_path, deck(apart=True) + TIE, order=order)
    by_scene = frequencies(tmp_path, deck(apart=True), order=order, tie=[{"face": "roof", "onto": "FLOOR"}])
    assert by_deck == pytest.approx(wanted, rel=1e-9)
    assert by_scene == pytest.approx(wanted, rel=1e-9)


def test_parts_that_a_tie_alone_joins_are_not_cut(tmp_path: Path) -> None:
    (tmp_path / "bars.inp").write_text(deck(apart=True) + TIE)
    body = {"mesh": {"file": str(tmp_path / "bars.inp"), "unit": "m"}, "E": 70e9, "nu": 0.3, "rho": 2700.0}
    body |= {"modes": {"count": 4}, "pieces": 2, "marker": {"root": {"face": "FLOOR"}}}
    joint = {"hinge": {"type": "revolute", "parent": "ground", "child": "bars.root", "axis": [0, 1, 0]}}
    times = {"duration": "1 ms", "output_step": "1 ms", "tip": "bars.root", "run": [{"integrator": "runge-kutta"}]}
    scene = {"title": "Bars", "body": {"bars": body}, "joint": joint, "simulation": times}
    with pytest.raises(InputError, match="pieces = 2: its deck's links or ties alone join parts of the mesh"):
        _ = fmd.load(scene).run.division


@pytest.mark.parametrize(
    ("text", "mesh", "message"),
    [
        ("", {"tie": [{"face": "roof", "onto": "flor"}]}, "mesh.tie.0: no face flor; the faces: ROOF, FLOOR"),
        ("", {"tie": [{"face": "roof", "onto": "floor"}], "shell": "2 mm"}, "mesh.shell is of shells alone"),
        (TIE.replace("SEAM", "SEAM, CYCLIC SYMMETRY"), {}, r"aren't solid \(1 \*TIE with CYCLIC SYMMETRY\)"),
        (TIE.replace("UP, LOW\n", "UP\n"), {}, r"\*TIE SEAM needs two surfaces"),
        (TIE.replace("S2", "S1"), {}, r"\*TIE SEAM: its faces don't lie against each other"),
    ],
)
def test_ties_that_are_wrong_are_refused(
    text: str, mesh: dict[str, Any], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message):
        frequencies(tmp_path, deck(apart=True) + text, **mesh)


def sheets(apart: bool) -> str:
    """Two plates of four shells side by side, with common nodes between them or each with its own."""
    x = {
        (part * apart, i, j): (0.3 * i, 0.2 * j)
        for part in (0, 1)
        for i in range(2 * part, 2 * part + 3)
        for j in (0, 1, 2)
    }
    number = {key: k for k, key in enumerate(x, start=1)}
    lines = ["*NODE", *(f"{number[key]}, {a}, {b}, 0." for key, (a, b) in x.items())]
    for part, name in enumerate(("LEFT", "RIGHT")):
        lines.append(f"*ELEMENT, TYPE=S4, ELSET={name}")
        for k, (i, j) in enumerate((i, j) for i in (0, 1) for j in (0, 1)):
            ring = ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))
            nodes = [number[part * apart, 2 * part + a, b] for a, b in ring]
            lines.append(", ".join(map(str, (4 * part + k + 1, *nodes))))
        lines += [f"*SHELL SECTION, ELSET={name}, MATERIAL=M", "0.01"]
    lines += ["*NSET, NSET=SEAM", ", ".join(str(number[apart * 1, 2, j]) for j in (0, 1, 2))]
    return "\n".join([*lines, "*NSET, NSET=RIM", ", ".join(str(number[0, 2, j]) for j in (0, 1, 2)), ""])


@pytest.mark.parametrize("edges", ["5, E4\n6, E4", "5, S6\n6, S6"], ids=["Abaqus", "CalculiX"])
def test_edges_of_shells_are_tied_by_a_deck_and_by_the_scene(
    edges: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    wanted = frequencies(tmp_path, sheets(apart=False), shell="deck")
    surfaces = f"*SURFACE, NAME=ONE\n{edges}\n*SURFACE, NAME=OTHER, TYPE=ELEMENT\nLEFT, SPOS\n"
    of_its_name = sheets(apart=True) + "*NSET, NSET=ONE\n1\n" + surfaces
    assert read_abaqus(of_its_name).point_sets["ONE"].tolist() == [0]
    by_deck = frequencies(tmp_path, of_its_name + "*TIE, NAME=T\nONE, OTHER\n", shell="deck")
    by_scene = frequencies(tmp_path, sheets(apart=True), shell="deck", tie=[{"face": "seam", "onto": "rim"}])
    assert by_deck == pytest.approx(wanted, rel=1e-9)
    assert by_scene == pytest.approx(wanted, rel=1e-9)
    with pytest.raises(InputError, match="surface ONE: shells of 4 corners have no edge E5"):
        frequencies(
            tmp_path, sheets(apart=True) + surfaces.replace("5, E4", "5, E5").replace("5, S6", "5, E5"), shell="deck"
        )
    surfaces = surfaces.replace(edges, f"{edges}\n7, SPOS")
    with pytest.raises(InputError, match="names the surface ONE, which has faces and edges of shells; split it"):
        frequencies(tmp_path, sheets(apart=True) + surfaces + "*TIE, NAME=T\nONE, OTHER\n", shell="deck")


def test_a_tie_of_a_part_of_an_edge_is_told_with_its_share(tmp_path: Path) -> None:
    file = tmp_path / "sheets.inp"
    file.write_text(sheets(apart=True) + "*NSET, NSET=HALF\n7, 8\n")
    mesh = {"file": str(file), "unit": "m", "shell": "deck", "tie": [{"face": "SEAM", "onto": "HALF"}]}
    body = {"mesh": mesh, "E": 70e9, "nu": 0.3, "rho": 2700.0, "modes": {"count": 2}}
    (found,) = mode_warnings(fmd.load({"title": "Sheets", "body": {"sheets": body}}).run)
    assert found["code"] == "tie-in-part"
    told = r"tie of SEAM to HALF holds [56]\d % of its edge; beside the rest is nothing near"  # half, and what is near
    assert re.search(told, found["text"])


def test_named_curves_of_gmsh_are_tied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    wanted = frequencies(tmp_path, sheets(apart=False), shell="deck")
    nodes = {k: (0.3 * (k // 3 - k // 9), 0.2 * (k % 3), 0.0) for k in range(18)}  # the third row twice
    quads = [(a, a + 3, a + 4, a + 1) for a in (0, 1, 3, 4, 9, 10, 12, 13)]
    lines = [(6, 7), (7, 8), (9, 10), (10, 11)]
    elements = [(3, 1 + k // 4, quad) for k, quad in enumerate(quads)] + [
        (1, 3 + k // 2, line) for k, line in enumerate(lines)
    ]
    text = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "4", '2 1 "left"', '2 2 "right"']
    text += ['1 3 "rim"', '1 4 "seam"', "$EndPhysicalNames", "$Nodes", str(len(nodes))]
    text += [f"{k + 1} {x} {y} {z}" for k, (x, y, z) in nodes.items()]
    text += ["$EndNodes", "$Elements", str(len(elements))]
    rows = [(kind, 2, of, of, *(n + 1 for n in own)) for kind, of, own in elements]
    text += [" ".join(map(str, (k, *row))) for k, row in enumerate(rows, start=1)]
    (tmp_path / "sheets.msh").write_text("\n".join([*text, "$EndElements", ""]))
    mesh = {"file": "sheets.msh", "unit": "m", "shell": "10 mm", "tie": [{"face": "seam", "onto": "RIM"}]}
    body = {"mesh": mesh, "E": 70e9, "nu": 0.3, "rho": 2700.0, "modes": {"count": 6}}
    found = fmd.load({"title": "Sheets", "body": {"sheets": body}}).modes.frequencies_hz
    assert found == pytest.approx(wanted, rel=1e-9)
