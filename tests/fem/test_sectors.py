"""Sectors of own meshes: repeated they are the whole body, whose modes are those of a mesh of the whole."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmd import load_scene
from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.fem.assembly import assemble
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.sectors import repeat_sector
from fmd.meshes.gmsh_session import gmsh_model
from fmd.reduction.cyclic import CyclicSolver
from fmd.reduction.eigen import FreeBodySolver
from fmd.stages.pipeline import Pipeline

STEEL = Material(E=210e9, nu=0.3, rho=7850.0)
COUNT = 5


def lobed_ring(sectors: float, bore: float = 20.0) -> tuple[Array, IntArray]:
    """Return points [mm] and hexahedra of a ring of 50 mm whose outline has five lobes, or of some of its sectors."""
    n_around, n_radial, n_axial = round(4 * sectors), 2, 2
    closed = sectors == COUNT
    a, r, z = np.meshgrid(
        np.arange(n_around + (not closed)) * 2 * np.pi / (4 * COUNT),
        np.linspace(0.0, 1.0, n_radial + 1),
        np.linspace(0.0, 12.0, n_axial + 1),
        indexing="ij",
    )
    radius = bore + r * (50.0 * (1 + 0.15 * np.cos(COUNT * a)) - bore)
    points = np.stack([radius * np.cos(a), radius * np.sin(a), z], axis=-1).reshape(-1, 3)
    number = np.arange(a.size).reshape(a.shape)
    following = np.roll(number, -1, axis=0)[:n_around]
    number = number[:n_around]
    sides = [(number[:, j : j + n_radial], following[:, j : j + n_radial]) for j in (0, 1)]
    low, high = ([m[:, :, k : k + n_axial] for here, next_ in sides for m in (here, next_)] for k in (0, 1))
    order = (0, 2, 3, 1)
    return points, np.stack([*(low[k] for k in order), *(high[k] for k in order)], axis=-1).reshape(-1, 8)


def sector_mesh(bore: float = 20.0) -> SolidMesh:
    points, cells = lobed_ring(1, bore)
    angle = np.arctan2(points[:, 1], points[:, 0])
    faces = {"first": np.flatnonzero(abs(angle) < 1e-9), "second": np.flatnonzero(angle > 2 * np.pi / COUNT - 1e-9)}
    faces["top"] = np.flatnonzero(points[:, 2] > 11.9)
    return SolidMesh(1e-3 * points, cells, "hexahedron", {"rim": np.arange(4)}, faces)


@pytest.mark.parametrize("cuts", [("first", "second"), ("second", "first")])
def test_a_repeated_sector_is_the_whole_body_with_its_frequencies(cuts: tuple[str, str]) -> None:
    points, cells = lobed_ring(COUNT)
    whole = SolidMesh(1e-3 * points, cells, "hexahedron", {}, {})
    repeated = repeat_sector(sector_mesh(), COUNT, cuts)
    assert repeated.volume == pytest.approx(whole.volume, rel=1e-12)
    assert (len(repeated.points), len(repeated.cells)) == (len(points), len(cells))
    assert repeated.sectors == COUNT
    assert {*repeated.faces} == {"top", *(f"top-{k}" for k in range(1, 6))}
    assert len(np.unique(repeated.faces["top"])) == len(points) // 3
    assert len(repeated.parts["rim"]) == 4 * COUNT
    np.testing.assert_array_equal(repeated.parts["sector-2"], np.arange(16, 32))
    expected = FreeBodySolver(assemble(whole, 1, STEEL)).modes(9).omega
    found = CyclicSolver(assemble(repeated, 1, STEEL), COUNT).modes(9).omega
    np.testing.assert_allclose(found, expected, rtol=1e-8)


@pytest.mark.parametrize("cuts", [("first", "second"), ("second", "first")])
def test_a_node_of_either_cut_that_the_other_lacks_is_told(cuts: tuple[str, str]) -> None:
    mesh = sector_mesh()
    between = mesh.points[mesh.faces["second"][:2]].mean(axis=0)
    points = np.concatenate([mesh.points, between[None]])
    faces = mesh.faces | {"second": np.append(mesh.faces["second"], len(mesh.points))}
    with pytest.raises(ValueError, match=r"1 of the 10 nodes of second|1 nodes of second have none"):
        repeat_sector(replace(mesh, points=points, faces=faces), COUNT, cuts)


def test_sectors_that_meet_on_the_axis_are_solved_together() -> None:
    block = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    quarter = SolidMesh(
        block * 0.1, np.arange(8)[None], "hexahedron", {}, {"x": np.array([0, 1, 4, 5]), "y": np.array([0, 3, 4, 7])}
    )
    whole = repeat_sector(quarter, 4, ("x", "y"))
    assert (whole.sectors, len(whole.points), whole.volume) == (1, 18, pytest.approx(4e-3))
    assert whole.notes == ("2 nodes lie on the axis, so all sectors are solved together",)


def write_deck(path: Path, mesh: SolidMesh) -> None:
    """Write a sector as an Abaqus deck in mm, its faces as node sets and each half of it as an element set."""
    lines = ["*NODE", *(f"{k + 1}, {', '.join(f'{x:.6f}' for x in 1e3 * row)}" for k, row in enumerate(mesh.points))]
    lines += ["*ELEMENT, TYPE=C3D8", *(f"{k + 1}, {', '.join(map(str, row + 1))}" for k, row in enumerate(mesh.cells))]
    for name, nodes in mesh.faces.items():
        lines += [f"*NSET, NSET={name}", *map(str, np.unique(nodes) + 1)]
    path.write_text("\n".join(lines))


SCENE = """
title = "wheel"
[body.wheel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
modes = { count = 6 }
marker = { centre = { at = ["0 m", "0 m", "0 m"] } }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    write_deck(folder / "sector.inp", sector_mesh())
    (folder / "wheel.toml").write_text(SCENE)
    return folder


def wheel(folder: Path, mesh: str, *more: str) -> Pipeline:
    return Pipeline(load_scene(folder / "wheel.toml", [f"body.wheel.mesh={mesh}", "body.wheel.marker={}", *more]))


DECK = "{file = 'sector.inp', unit = 'mm', cyclic = 5, cuts = ['FIRST', 'second']}"


def test_a_sector_of_a_deck_is_a_body_of_a_scene_and_one_mistuned_sector_splits_its_pairs(folder: Path) -> None:
    part = wheel(folder, DECK).wholes["wheel"]
    points, cells = lobed_ring(COUNT)
    whole = assemble(SolidMesh(1e-3 * points, cells, "hexahedron", {}, {}), 1, STEEL)
    expected = FreeBodySolver(whole).modes(6).omega / (2 * np.pi)
    np.testing.assert_allclose(part.modes.frequencies_hz[:6], expected, rtol=1e-7)
    assert isinstance(part.model.solver, CyclicSolver)
    stiff = "body.wheel.material={sector-2 = {E = '231 GPa', nu = 0.3, rho = '7850 kg/m^3'}}"
    tuned, mistuned = part.modes.frequencies_hz, wheel(folder, DECK, stiff).wholes["wheel"].modes.frequencies_hz
    assert abs(tuned[1] / tuned[0] - 1) < 1e-8  # a pair, of which one mode feels the stiffer sector more
    assert 1e-3 < mistuned[1] / mistuned[0] - 1 < 0.1


@pytest.mark.parametrize(
    ("mesh", "text"),
    [
        (DECK.replace("5", "6"), "of the 9 nodes of first, turned by 60° about z, lie on none of second, up to"),
        (DECK.replace("second", "secnd"), "no such face; did you mean 'second'?"),
        (DECK.replace(", cyclic = 5", ""), "belong together: cyclic = 6, cuts = ['low', 'high']"),
        (DECK.replace("5", "2"), "greater than or equal to 3"),
        (DECK.replace("unit", "shell = '2 mm', unit"), "cyclic = 5: is of solids, not of shells or beams"),
    ],
)
def test_what_is_no_sector_is_refused(folder: Path, mesh: str, text: str) -> None:
    with pytest.raises(InputError) as fault:
        wheel(folder, mesh).wholes["wheel"].mesh  # noqa: B018
    assert text in str(fault.value)


@pytest.mark.slow
def test_a_sector_from_cad_is_meshed_alike_on_its_cuts(folder: Path) -> None:
    """A wedge of a disc with a hole on one side: volume by its closed form, modes beside those without symmetry."""
    with gmsh_model("wedge") as gmsh:
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        occ = gmsh.model.occ
        wedge = occ.addCylinder(0, 0, 0, 0, 0, 8, 50, angle=2 * np.pi / 6)
        cut, _ = occ.cut([(3, wedge)], [(3, occ.addCylinder(0, 0, -1, 0, 0, 10, 20))])
        occ.cut(cut, [(3, occ.addCylinder(33, 12, -1, 0, 0, 10, 5))])
        occ.synchronize()
        planes = [tag for _, tag in gmsh.model.getEntities(2) if gmsh.model.getType(2, tag) == "Plane"]
        sides = [tag for tag in planes if abs(gmsh.model.getNormal(tag, [0.5, 0.5])[2]) < 0.1]
        gmsh.write(str(folder / "wedge.step"))
    names = ", ".join(f"'face-{tag}'" for tag in sides)
    run = wheel(folder, f"{{cad = 'wedge.step', size = '40 mm', cyclic = 6, cuts = [{names}]}}")
    part = run.wholes["wheel"]
    exact = np.pi * (0.05**2 - 0.02**2) * 0.008 - 6 * np.pi * 0.005**2 * 0.008
    assert part.mesh.volume == pytest.approx(exact, rel=2e-3)
    assert part.mesh.sectors == 6
    alone = FreeBodySolver(part.fe).modes(6).omega
    np.testing.assert_allclose(part.modes.omega[:6], alone, rtol=1e-6)
    with pytest.raises(InputError, match=r"doesn't carry one of mesh\.cuts onto the other"):
        wheel(folder, f"{{cad = 'wedge.step', size = '40 mm', cyclic = 5, cuts = [{names}]}}").wholes["wheel"].mesh  # noqa: B018
