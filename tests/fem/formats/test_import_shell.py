"""Shells from the surface elements of mesh files: formats, sets, mixed elements, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.fem.assembly import assemble
from fmd.fem.formats.import_shell import read_shell
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


def write_nastran(path: Path, x: Array, blocks: dict[str, IntArray], more: str = "") -> None:
    lines = ["BEGIN BULK", *(f"GRID,{k},,{a},{b},{c}" for k, (a, b, c) in enumerate(x, start=1))]
    number = 0
    for kind, cells in blocks.items():
        for row in cells + 1:
            number += 1
            lines.append(f"{kind},{number},7," + ",".join(map(str, row)))
    path.write_text("\n".join([*lines, more, "ENDDATA"]))


def frequencies(mesh: object) -> Array:
    return FreeBodySolver(assemble(mesh, 1, STEEL)).modes(4).omega  # type: ignore[arg-type]


@pytest.mark.parametrize("form", ["inp", "bdf", "vtk", "vtu", "msh"])
@pytest.mark.parametrize("element", ["quadrilateral", "triangle"])
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
    mesh = read_shell(path, 1e-3, 2e-3)
    assert frequencies(mesh) == pytest.approx(frequencies(shell_mesh(x / 1e3, cells, 2e-3)), rel=1e-6)


def test_node_sets_and_element_sets_are_faces_and_parts(tmp_path: Path) -> None:
    x, cells = panel()
    write_abaqus(tmp_path / "panel.inp", x, {"S4": cells}, "*ELSET, ELSET=PAD\n1, 2")
    mesh = read_shell(tmp_path / "panel.inp", 1e-3, 2e-3)
    assert len(mesh.faces["ROOT"]) == 2 * 5  # both faces of five nodes
    assert mesh.faces["PAD"].shape == (4, 3)
    assert mesh.parts["PAD"].tolist() == [0, 1]
    assert len(mesh.faces["top"]) == len(mesh.faces["bottom"]) == len(cells)


def test_quadrilaterals_beside_triangles_are_split_and_it_is_noted(tmp_path: Path) -> None:
    x, cells = panel()
    both = {"CQUAD4": cells[:-2], "CTRIA3": cells[-2:][:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)}
    write_nastran(tmp_path / "panel.bdf", x, both)
    mesh = read_shell(tmp_path / "panel.bdf", 1e-3, 2e-3)
    assert len(mesh.cells) == 2 * len(cells)
    assert mesh.notes == ("22 quadrilaterals beside triangles are split into two triangles each",)
    assert mesh.parts["property-7"].tolist() == list(range(2 * len(cells)))


def test_other_elements_are_refused_by_name(tmp_path: Path) -> None:
    x, cells = panel()
    path = tmp_path / "panel.inp"
    write_abaqus(path, x, {"S4": cells}, "*ELEMENT, TYPE=B31\n900, 1, 2")
    with pytest.raises(InputError, match=r"beside shells of three or four nodes aren't read.*1 line"):
        read_shell(path, 1e-3, 2e-3)
    write_nastran(tmp_path / "linked.bdf", x, {"CQUAD4": cells}, "RBE2,800,1,123456,2,3")
    with pytest.raises(InputError, match="links and masses of decks are of solids; it has RBE2 800"):
        read_shell(tmp_path / "linked.bdf", 1e-3, 2e-3)
    write_abaqus(path, x, {"C3D4": cells})
    with pytest.raises(InputError, match="has solid elements: 24 tetra"):
        read_shell(path, 1e-3, 2e-3)
    write_abaqus(path, x, {"S4": np.concatenate([cells, cells[:1]])[[0, 5, 23]]})
    with pytest.raises(InputError, match="unconnected pieces"):
        read_shell(path, 1e-3, 2e-3)
    twice = cells.copy()
    twice[3, 3] = twice[3, 2]
    write_abaqus(path, x, {"S4": twice})
    with pytest.raises(InputError, match="1 shells have a node more than once"):
        read_shell(path, 1e-3, 2e-3)
    write_abaqus(path, x, {"B31": cells[:, :2]})
    with pytest.raises(InputError, match="there are no shells of three or four nodes"):
        read_shell(path, 1e-3, 2e-3)
