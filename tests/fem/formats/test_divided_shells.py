"""Shells with nodes at the middles of their sides, and halved ones, from mesh files."""

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
from tests.fem.formats.test_ansys import elements, nodes
from tests.fem.formats.test_import_shell import write_abaqus, write_nastran
from tests.fem.sheets import shell_mesh, unit_grid

ALUMINIUM = Material(70e9, 0.33, 2700.0)
SECTION = "*SHELL SECTION, ELSET=ALL-{0}, MATERIAL=M\n0.004"


def quarter(p: Array) -> Array:
    """A quarter of a cylinder, 0.6 m long, of radius 0.3 m."""
    angle = np.pi / 2 * p[:, 1]
    return np.column_stack([0.6 * p[:, 0], 0.3 * np.sin(angle), 0.3 * np.cos(angle)])


def with_middles(n: int, element: str = "quadrilateral") -> tuple[Array, IntArray]:
    """Return parameters and cells of eight or six nodes, corners first, without unused nodes."""
    p, cells = unit_grid(2 * n, 2 * n, "quadrilateral")
    at = np.arange((2 * n + 1) ** 2).reshape(2 * n + 1, 2 * n + 1)
    a, b = (2 * each.ravel() for each in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))

    def nodes(*places: tuple[int, int]) -> IntArray:
        return np.stack([at[a + i, b + j] for i, j in places], axis=1)

    if element == "triangle":
        cells = np.concatenate(
            [
                nodes((0, 0), (2, 0), (2, 2), (1, 0), (2, 1), (1, 1)),
                nodes((0, 0), (2, 2), (0, 2), (1, 1), (1, 2), (0, 1)),
            ]
        )
    else:
        cells = nodes((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
    used, cells = np.unique(cells, return_inverse=True)
    return p[used], cells.reshape(-1, 6 if element == "triangle" else 8)


def nastran_card(name: str, *fields: str) -> str:
    return name + "\n".join("," + ",".join(fields[k : k + 8]) for k in range(0, len(fields), 8))


def frequencies(mesh: object) -> Array:
    return FreeBodySolver(assemble(mesh, 1, ALUMINIUM)).modes(6).omega / (2 * np.pi)  # type: ignore[arg-type]


def test_shells_of_eight_nodes_have_frequencies_of_calculix(tmp_path: Path) -> None:
    """CalculiX 2.20, 6 x 6 free S8R of a quarter of a cylinder 4 mm thick; 12 x 12 are up to 0.9 % below these."""
    p, cells = with_middles(6)
    write_abaqus(tmp_path / "panel.inp", quarter(p), {"S8R": cells}, SECTION.format("S8R"))
    mesh = read_structure(tmp_path / "panel.inp", 1.0, GivenSections())
    assert mesh.notes == ("36 shells of 8 nodes are divided into four of 4 nodes each",)
    over = frequencies(mesh) / [47.671, 92.101, 126.102, 254.492, 264.488, 281.086]
    assert over.min() > 0.999
    assert (over < [1.003, 1.010, 1.011, 1.010, 1.030, 1.001]).all()
    cards = [nastran_card("CQUAD8", str(k), "7", *map(str, row)) for k, row in enumerate(cells + 1, start=1)]
    cards += ["PSHELL,7,1,.004,1,,1", "MAT1,1,7.+10,,.33"]
    write_nastran(tmp_path / "panel.bdf", quarter(p), {}, "\n".join(cards))
    again = frequencies(read_structure(tmp_path / "panel.bdf", 1.0, GivenSections()))
    assert again == pytest.approx(frequencies(mesh), rel=1e-9)


@pytest.mark.parametrize(("card", "element"), [("CTRIA6", "triangle"), ("CQUAD8", "quadrilateral")])
def test_cards_without_their_middles_are_shells_of_their_corners(tmp_path: Path, card: str, element: str) -> None:
    """Nastran lets them out; offset and thickness keep their places in the card."""
    p, cells = with_middles(2, element)
    n = cells.shape[1]
    corners, x = cells[:, : n // 2], np.column_stack([p, 0 * p[:, 0]])
    lines = ["BEGIN BULK", *(f"GRID,{k},,{a},{b},{c}" for k, (a, b, c) in enumerate(x, start=1)), "MAT1,1,7.+10,,.33"]
    thick = [".02"] * (n // 2)
    for number, row in enumerate(corners + 1, start=1):
        rest = [*thick, "", ".002"] if n == 8 else ["", ".002", *thick]
        lines.append(nastran_card(card, str(number), "7", *map(str, row), *[""] * (n // 2), *rest))
    (tmp_path / "flat.bdf").write_text("\n".join([*lines, "PSHELL,7,1,.01,1,,1", "ENDDATA"]))
    mesh = read_structure(tmp_path / "flat.bdf", 1.0, GivenSections())
    assert (mesh.n_cells, mesh.volume) == (len(cells), pytest.approx(0.02, rel=1e-9))
    assert np.unique(mesh.points[:, 2]) == pytest.approx([-0.008, 0.012])


@pytest.mark.parametrize(
    ("kind", "card", "element"), [("STRI65", "CTRIA6", "triangle"), ("S8R", "CQUAD8", "quadrilateral")]
)
def test_flat_shells_with_middles_are_a_mesh_of_half_the_size(
    tmp_path: Path, kind: str, card: str, element: str
) -> None:
    """Thickness varies from corner to corner, an offset is that of each; nodes of sets are those of the finer mesh."""
    p, cells = with_middles(2, element)
    x, n = np.column_stack([p, 0 * p[:, 0]]), cells.shape[1]
    t = 0.01 + 0.01 * x[:, 0]
    write_abaqus(
        tmp_path / "flat.inp",
        x,
        {kind: cells},
        f"*SHELL SECTION, ELSET=ALL-{kind}, NODAL THICKNESS\n1.0\n*NODAL THICKNESS\n"
        + "\n".join(f"{k}, {each}" for k, each in enumerate(t, start=1))
        + f"\n*SURFACE, NAME=RIM\nALL-{kind}, E1\n*NSET, NSET=WHOLE, ELSET=ALL-{kind}",
    )
    mesh = read_structure(tmp_path / "flat.inp", 1.0, GivenSections())
    assert mesh.n_cells == 4 * len(cells)
    assert len(mesh.midsurface.nodes) == 25  # type: ignore[union-attr]
    assert mesh.volume == pytest.approx(0.015, rel=1e-9)
    assert len(mesh.faces["ROOT"]) == 10  # five nodes at both sides
    assert len(mesh.faces["WHOLE"]) == 50
    middles = {6: (3, 4, 5), 8: (4, 5, 6, 7)}[n]
    assert len(np.unique(cells[:, [0, 1, middles[0]]])) == len(mesh.faces["RIM"]) / 2
    corners = t[cells[:, : n // 2]]
    lines = ["BEGIN BULK", *(f"GRID,{k},,{a},{b},{c}" for k, (a, b, c) in enumerate(x, start=1)), "MAT1,1,7.+10,,.33"]
    for number, (row, own) in enumerate(zip(cells + 1, corners, strict=True), start=1):
        thick = [f"{each:.6g}" for each in own]
        fields = [*thick, "", ".002"] if n == 8 else ["", ".002", *thick]
        lines.append(nastran_card(card, str(number), "7", *map(str, row), *fields))
    (tmp_path / "flat.bdf").write_text("\n".join([*lines, "PSHELL,7,1,.01,1,,1", "ENDDATA"]))
    other = read_structure(tmp_path / "flat.bdf", 1.0, GivenSections())
    assert np.sort(other.points, axis=0) == pytest.approx(
        np.sort(mesh.points, axis=0) + np.array([0, 0, 0.002]), abs=1e-6
    )


@pytest.mark.parametrize("program", ["ansys", "gmsh"])
@pytest.mark.parametrize("element", ["triangle", "quadrilateral"])
def test_other_programs_flat_shells_with_middles_are_a_mesh_of_half_the_size(
    tmp_path: Path, program: str, element: str
) -> None:
    """SHELL281, whose triangles repeat a node, and Gmsh's types 9 and 16 of MSH 2.2."""
    p, cells = with_middles(2, element)
    x, n = np.column_stack([p, 0 * p[:, 0]]), cells.shape[1]
    path = tmp_path / {"ansys": "flat.cdb", "gmsh": "flat.msh"}[program]
    if program == "ansys":
        order = [0, 1, 2, 2, 3, 4, 2, 5] if n == 6 else range(8)
        deck = [*nodes(x), "ET,1,281", *elements(cells[:, order] + 1, 1)]
    else:
        rows = [f"{k} {9 if n == 6 else 16} 2 1 1 " + " ".join(map(str, own + 1)) for k, own in enumerate(cells, 1)]
        deck = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(x))]
        deck += [*(f"{k} {a} {b} {c}" for k, (a, b, c) in enumerate(x, 1)), "$EndNodes"]
        deck += ["$Elements", str(len(rows)), *rows, "$EndElements"]
    path.write_text("\n".join(["/PREP7", *deck, "FINISH", ""] if program == "ansys" else deck))
    found = read_structure(path, 1.0, GivenSections(0.01))
    four = cells[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]].reshape(-1, 3)
    q, finer = (p, four) if n == 6 else unit_grid(4, 4, "quadrilateral")
    assert frequencies(found) == pytest.approx(
        frequencies(shell_mesh(np.column_stack([q, 0 * q[:, 0]]), finer, 0.01)), rel=1e-8
    )


def test_a_distributing_surface_of_eight_nodes_has_the_areas_of_the_finer_one(tmp_path: Path) -> None:
    p, cells = with_middles(2)
    more = "*SURFACE, NAME=TOP\nALL-S8R, SPOS\n*NODE\n900, 0.3, 0.4, 1\n*COUPLING, REF NODE=900, SURFACE=TOP, "
    more += "CONSTRAINT NAME=C\n*DISTRIBUTING\n1, 6\n"
    write_abaqus(tmp_path / "flat.inp", np.column_stack([p, 0 * p[:, 0]]), {"S8R": cells}, more)
    links = read_structure(tmp_path / "flat.inp", 1.0, GivenSections(0.01)).connections
    assert links is not None
    (mean,) = links.mean
    assert len(mean.points) == 26
    assert [len(each) for each in mean.facets] == [16]


def test_halved_shells_lie_on_the_curved_midsurface(tmp_path: Path) -> None:
    """Chords of a cylinder are 2.6 mm below it, new nodes 0.03 mm, and 1.3 mm at the rim, where a normal is missing."""
    p, cells = unit_grid(2, 6, "quadrilateral")
    write_abaqus(tmp_path / "panel.inp", quarter(p), {"S4": cells})
    mesh = read_structure(tmp_path / "panel.inp", 1.0, GivenSections(0.004, halvings=1))
    x = mesh.midsurface.nodes  # type: ignore[union-attr]
    depth = 0.3 - np.hypot(x[:, 1], x[:, 2])
    inside = np.abs(np.arctan2(x[:, 1], x[:, 2]) - np.pi / 4) < np.pi / 4 - np.radians(15)
    assert np.abs(depth[inside]).max() < 4e-5
    assert depth.max() == pytest.approx(0.5 * 0.3 * (1 - np.cos(np.radians(7.5))), rel=0.02)
    assert len(mesh.faces["ROOT"]) == 2 * 13


def test_the_rim_of_a_cap_is_as_round_as_its_cylinder(tmp_path: Path) -> None:
    """A regular 24-gon of radius 0.3 m, whose sides' middles are 2.6 mm below the circle; the cap is flat."""
    angle = 2 * np.pi / 24 * np.arange(24)
    ring = np.column_stack([0.3 * np.cos(angle), 0.3 * np.sin(angle), 0 * angle])
    k = np.arange(24)
    wall = np.stack([k, (k + 1) % 24, 24 + (k + 1) % 24, 24 + k], axis=1)
    cap = np.stack([24 + k, 24 + (k + 1) % 24, np.full(24, 48)], axis=1)
    x = np.concatenate([ring, ring + np.array([0, 0, 0.1]), [[0, 0, 0.1]]])
    write_abaqus(tmp_path / "can.inp", x, {"S4": wall, "S3": cap})
    x = read_structure(tmp_path / "can.inp", 1.0, GivenSections(0.004, halvings=1)).midsurface.nodes  # type: ignore[union-attr]
    radius = np.hypot(x[:, 0], x[:, 1])
    assert (np.abs(radius - 0.3) < 4e-5).sum() == 3 * 48
    assert x[radius < 0.29, 2] == pytest.approx(0.1, abs=1e-12)


def test_halved_shells_keep_folds_and_have_the_frequencies_of_the_finer_mesh(tmp_path: Path) -> None:
    p, cells = unit_grid(6, 4, "quadrilateral")
    q, finer = unit_grid(12, 8, "quadrilateral")

    def bent(p: Array) -> Array:
        return np.column_stack([np.minimum(p[:, 0], 0.5), p[:, 1], np.maximum(p[:, 0] - 0.5, 0)])

    write_abaqus(tmp_path / "bent.inp", bent(p), {"S4": cells})
    halved = read_structure(tmp_path / "bent.inp", 1.0, GivenSections(0.01, halvings=1))
    assert frequencies(halved) == pytest.approx(frequencies(shell_mesh(bent(q), finer, 0.01)), rel=1e-9)


def test_what_can_not_be_divided_is_refused_by_name(tmp_path: Path) -> None:
    corners = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    block = np.array([[0, 1, 3, 2, 4, 5, 7, 6]])
    plate = np.array([[0, 1, 9, 8]])
    x = np.concatenate([corners, [[0, -1, 0], [1, -1, 0]]])
    write_abaqus(tmp_path / "both.inp", x, {"C3D8": block, "S4": plate})
    with pytest.raises(
        InputError, match=r"mesh\.halvings is of shells alone, and the elements are 1 hexahedron, 1 quad"
    ):
        read_structure(tmp_path / "both.inp", 1.0, GivenSections(0.01, halvings=1))
    write_abaqus(tmp_path / "collapsed.inp", x, {"S4": np.array([[0, 1, 3, 3]])})
    with pytest.raises(InputError, match=r"1 shells have a node more than once, as collapsed ones do"):
        read_structure(tmp_path / "collapsed.inp", 1.0, GivenSections(0.01, halvings=1))
    p, cells = with_middles(1)
    flat = np.column_stack([p, 0 * p[:, 0]])
    write_abaqus(tmp_path / "eight.inp", flat, {"S8R": cells})
    with pytest.raises(InputError, match=r"no solid elements.*mesh.shell = '2 mm' takes"):
        read_mesh(tmp_path / "eight.inp", 1.0)
    middles = np.array([(a + b) / 2 for a, b in [(0, 1), (1, 9), (9, 8), (8, 0)] for a, b in [(x[a], x[b])]])
    more = np.array([(x[a] + x[b]) / 2 for a, b in [(1, 3), (3, 2), (2, 0)]])
    both = np.array([[0, 1, 9, 8, 10, 11, 12, 13], [0, 1, 3, 2, 10, 14, 15, 16]])
    write_abaqus(tmp_path / "some.inp", np.concatenate([x, middles, more]), {"C3D8": block, "S8": both})
    with pytest.raises(InputError, match="of 2 quad8 some are faces of solids and some are shells; put them apart"):
        read_structure(tmp_path / "some.inp", 1.0, GivenSections(0.01))
