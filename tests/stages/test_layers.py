"""Shells of layers from the scene to the stress of their plies, and scenes with layers that are wrong."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmd
from fmd.accuracy.coarse_mesh import Pair, make_coarse_pair
from fmd.accuracy.error_budget import state_errors
from fmd.accuracy.ply_stress import ply_quantities
from fmd.accuracy.requested_stress import request_key
from fmd.cli.run import _answers
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.fem.layered import Layered
from fmd.output.frequencies import mode_warnings
from fmd.output.plies import draw_plies, find_plies, summarise_plies, write_plies
from fmd.output.result import Result
from fmd.scene.stress_outputs import Plies
from fmd.stages.part_inputs import assembly_inputs, mesh_inputs
from tests.fem.formats.test_import_shell import write_abaqus
from tests.fem.sheets import unit_grid

CARBON = {"E1": "135 GPa", "E2": "10 GPa", "nu12": 0.3, "G12": "5 GPa", "G23": "3.5 GPa", "rho": "1550 kg/m^3"}
STRENGTH = {"Xt": "1500 MPa", "Xc": "1200 MPa", "Yt": "50 MPa", "Yc": "250 MPa", "S": "70 MPa"}
FOAM = {"E1": "70 MPa", "E2": "70 MPa", "nu12": 0.3, "G12": "27 MPa", "rho": "60 kg/m^3"}
METAL = {"E": "70 GPa", "nu": 0.3, "rho": "2700 kg/m^3"}
LAYERS = [
    {"material": "carbon", "thickness": "1 mm", "angle": "30 deg"},
    {"material": "foam", "thickness": "8 mm"},
    {"material": "carbon", "thickness": "1 mm"},
]


def panel(**changes: Any) -> dict[str, Any]:
    """A sandwich plate, swung in a hub, with named elements at its faces."""
    plate = {
        "shape": "plate",
        "length": "0.6 m",
        "width": "0.2 m",
        "mesh": {"divisions": [6, 3]},
        "lamina": {"carbon": CARBON | {"strength": STRENGTH}, "foam": FOAM},
        "layers": LAYERS,
        "modes": {"count": 3, "boundary": "joint", "enrich": "none"},
        "marker": {"root": {"face": "x-"}, "tip": {"face": "x+"}},
        "element": {name: {"at": ["50 mm", "0 mm", z]} for name, z in (("above", "4.9 mm"), ("below", "-4.9 mm"))},
    }
    swing = {"formula": "0.05*(1 - cos(2*pi*t/0.1))", "unit": "rad"}
    return {
        "title": "Panel",
        "body": {"panel": plate | changes},
        "joint": {"hub": {"type": "revolute", "parent": "ground", "child": "panel.root", "axis": [0, 1, 0]}},
        "drive": {"swing": {"type": "motion", "joint": "hub", "angle": swing}},
        "simulation": {
            "duration": "50 ms",
            "output_step": "1 ms",
            "tip": "panel.tip",
            "run": [{"integrator": "generalized-alpha", "step": "0.2 ms"}],
        },
    }


@pytest.fixture(scope="module")
def swung() -> Result:
    return fmd.load(panel())


def test_stress_of_outer_plies_is_the_named_elements_in_their_axes(swung: Result) -> None:
    """The elements' stress is along the body's axes; it is turned by hand, and the index written out."""
    run = swung.run
    (found,) = find_plies(run, "panel")
    number = {name: run.part.elements[name] for name in ("above", "below")}
    for name, k, side, angle in (("above", 2, 1, 0.0), ("below", 0, 0, np.pi / 6)):
        xx, yy, xy = (next(iter(run.element_stress(f"panel.{name}", c).values())) for c in ("xx", "yy", "xy"))
        c, s = np.cos(angle), np.sin(angle)
        one = c**2 * xx + s**2 * yy + 2 * c * s * xy
        two = s**2 * xx + c**2 * yy - 2 * c * s * xy
        shear = (c**2 - s**2) * xy + c * s * (yy - xx)
        X, Y = np.where(one > 0, 1500e6, 1200e6), np.where(two > 0, 50e6, 250e6)
        index = np.sqrt(one**2 / X**2 - one * two / X**2 + two**2 / Y**2 + shear**2 / 70e6**2)
        share = np.max([np.abs(one) / X, np.abs(two) / Y, np.abs(shear) / 70e6], axis=0)
        expected = {"11 max": one.max(), "22 min": two.min(), "12 max": shear.max(), "Tsai-Hill": index.max()}
        for key, value in (expected | {"maximum stress": share.max()}).items():
            assert found.values[key][number[name], k, side] == pytest.approx(value, rel=1e-6, abs=1.0), key
        assert found.frames["Tsai-Hill"][number[name], k, side] == index.argmax()


def test_a_table_and_a_picture_have_the_worst_ply(swung: Result, tmp_path: Path) -> None:
    run = swung.run
    table = Plies(file="plies.csv", body="panel")
    assert write_plies(run, table, tmp_path) == ["plies.csv", "plies-errors.csv"]
    header, *rows = [line.split(",") for line in (tmp_path / "plies.csv").read_text().splitlines()]
    assert [row[1:4] for row in rows][2:4] == [["2", "lower", "foam"], ["2", "upper", "foam"]]
    indices = [row[header.index("tsai_hill_index")] for row in rows]
    assert indices[2:4] == ["nan", "nan"]  # which have no strength
    worst = summarise_plies(run, table)["plies"]["panel"]["Tsai-Hill"]
    assert worst["value"] == pytest.approx(max(float(each) for each in indices if each != "nan"), rel=1e-8)
    assert (worst["material"], worst["position_m"][0]) == ("carbon", pytest.approx(0.05))
    with pytest.raises(InputError, match=r"strength: is missing: failure indices take Xt, Xc, Yt, Yc and S"):
        draw_plies(run, Plies(file="plies.png", body="panel"), tmp_path)


def test_errors_of_plies_are_stated_but_for_shear_across(swung: Result, tmp_path: Path) -> None:
    """Without a budget the table says what makes one; shear across has none at all."""
    write_plies(swung.run, Plies(file="plies.csv", body="panel"), tmp_path)
    rows = (tmp_path / "plies-errors.csv").read_text().splitlines()[1:]
    why = {row.split(",")[0]: row for row in rows}
    assert "no error budget was made" in why["stress_11_max_pa"]
    assert "no error budget was made" in why["tsai_hill_index"]
    assert "a layer along edges as wide as the shell is thick" in why["stress_13_min_pa"]
    worst = {"Tsai-Hill": {"value": 0.5, "ply": 1, "material": "UD", "angle_deg": 0.0, "face": "lower", "element": 3}}
    errors = {"plies.panel.Tsai-Hill.value": "not stated: there is no coarser mesh"}
    (line,) = _answers({"plies": {"panel": worst}, "stated_errors": errors, "final": {}})
    assert line.endswith("lower face, element 3; its error is not stated: there is no coarser mesh")


def test_budgets_of_indices_depend_on_strengths() -> None:
    asked = {"output": [{"type": "plies", "file": "plies.csv", "body": "panel"}]}
    weaker = {"carbon": CARBON | {"strength": STRENGTH | {"S": "60 MPa"}}, "foam": FOAM}
    one, same, other = (fmd.load(panel(**more) | asked).run.scene for more in ({}, {}, {"lamina": weaker}))
    assert request_key(one) == request_key(same)
    assert request_key(one) != request_key(other)


@pytest.mark.long
@pytest.mark.parametrize("layers", [LAYERS, [LAYERS[0] | {"angle": f"{a} deg"} for a in (0, 45, -45, 90)]])
def test_stated_errors_of_plies_hold_a_finer_run(layers: list[dict[str, Any]]) -> None:
    """A mesh of six times as many elements along with twice the modes; the model is the same, and its part left out."""
    asked = {"output": [{"type": "plies", "file": "plies.csv", "body": "panel"}]}
    fine = fmd.load(
        panel(layers=layers, mesh={"divisions": [72, 24]}, modes={"count": 6, "boundary": "joint"}) | asked
    ).run
    run = fmd.load(panel(layers=layers, mesh={"divisions": [12, 6]}) | asked).run
    own, true = (ply_quantities(each.part, each.motion.modal("panel")) for each in (run, fine))
    rows = {row.name: row for row in state_errors(run).details if row.name in own}
    assert set(rows) == set(own)
    for name, row in rows.items():
        error = own[name].error(true[name])
        assert error < row.numerical < 5 * error, name


def flat(a: Array, b: Array) -> Array:
    return np.column_stack([0.6 * a, 0.2 * (b - 0.5), 0 * a])


def distorted(a: Array, b: Array) -> Array:
    """A plate that narrows, whose elements have no right angles."""
    x = 0.6 * a + 0.06 * np.sin(2 * np.pi * b) * a * (1 - a)
    return np.column_stack([x, 0.2 * (b - 0.5) * (1 - 0.4 * a), 0 * a])


def curved(a: Array, b: Array) -> Array:
    angle = 1.2 * (b - 0.5)
    return np.column_stack([0.6 * a, 0.17 * np.sin(angle), 0.17 * np.cos(angle)])


def from_file(path: Path, place: Callable[[Array, Array], Array], n: int, m: int, count: int, **changes: Any) -> Any:
    """Return the run of a panel whose n x m shells come from a file."""
    p, cells = unit_grid(n, m, "quadrilateral")
    write_abaqus(path, place(*p.T), {"S4": cells}, f"*NSET, NSET=TIP, GENERATE\n{n * (m + 1) + 1}, {(n + 1) * (m + 1)}")
    mesh = {"file": path.as_posix(), "unit": "m", "shell": "layers"}
    more = {"mesh": mesh, "modes": {"count": count, "boundary": "joint"}} | changes
    scene = panel(**more) | {"output": [{"type": "plies", "file": "plies.csv", "body": "panel"}]}
    body = scene["body"]["panel"]
    body["marker"] = {"root": {"face": "ROOT"}, "tip": {"face": "TIP"}}
    for key in ("shape", "length", "width", "element"):
        body.pop(key)
    return fmd.load(scene).run


def test_a_files_shells_are_compared_with_those_of_half_the_size(tmp_path: Path) -> None:
    """The same two meshes tell that the coarser one has four times the excess of the finer one."""
    run = from_file(tmp_path / "panel.inp", curved, 4, 4, 2)
    mesh = {"file": (tmp_path / "panel.inp").as_posix(), "unit": "m", "shell": "layers", "halvings": 1}
    own, finer = (
        make_coarse_pair(each) for each in (run, from_file(tmp_path / "panel.inp", curved, 4, 4, 2, mesh=mesh))
    )
    assert isinstance(own, Pair)
    assert isinstance(finer, Pair)
    assert (own.is_coarser, finer.is_coarser) == (False, True)
    assert [each.coarse.part.mesh.n_cells for each in (own, finer)] == [64, 16]
    both = [each.excess_of_modes("panel")[0] for each in (own, finer)]
    assert (both[1] > 0).all()
    np.testing.assert_allclose(both[0], 4 * both[1], rtol=0.1)


@pytest.mark.long
@pytest.mark.parametrize(
    ("place", "angles"), [(flat, (30, 0, 0)), (distorted, (45, -45, -45, 45)), (curved, (0, 45, -45, 90))]
)
def test_stated_errors_of_a_files_plies_hold_a_finer_file(
    tmp_path: Path, place: Callable[[Array, Array], Array], angles: tuple[int, ...]
) -> None:
    """Beside the same shape by sixteen times as many shells and twice the modes: 2.0 to 3.0 times the errors."""
    layers = LAYERS if len(angles) == 3 else [LAYERS[0] | {"angle": f"{a} deg", "thickness": "2 mm"} for a in angles]
    run = from_file(tmp_path / "panel.inp", place, 12, 6, 3, layers=layers)
    fine = from_file(tmp_path / "fine.inp", place, 48, 24, 6, layers=layers)
    own, true = (ply_quantities(each.part, each.motion.modal("panel")) for each in (run, fine))
    rows = [row for row in state_errors(run).details if row.name in own]
    ratios = {row.name: row.numerical / own[row.name].error(true[row.name]) for row in rows}
    assert set(ratios) == set(own)
    assert min(ratios.values()) > 1.0
    assert np.median([*ratios.values()]) < 4.0


def test_a_sandwich_has_the_mass_and_the_density_of_its_layers(swung: Result) -> None:
    part, mass = swung.run.part, 0.6 * 0.2 * (2e-3 * 1550 + 8e-3 * 60)
    assert isinstance(part.material, Layered)
    assert part.mass == pytest.approx(mass, rel=1e-12)
    assert part.fe.mass == pytest.approx(mass, rel=1e-12)
    rotary = 0.6 * 0.2 * (1550 * (10e-3**3 - 8e-3**3) + 60 * 8e-3**3) / 12  # ∫ ρ z²
    z = part.fe.x[:, 2]
    assert z @ part.fe.m @ z == pytest.approx(rotary, rel=1e-9)


def test_modes_that_bend_layers_in_short_waves_are_warned_of() -> None:
    """The panel is 10 mm thick and 200 mm wide; one of a tenth of its width bends in 2 thicknesses across."""
    assert not [each for each in mode_warnings(fmd.load(panel()).run) if each["code"] == "thick-layers"]
    narrow = panel(width="30 mm", length="60 mm")
    (text,) = (each["text"] for each in mode_warnings(fmd.load(narrow).run) if each["code"] == "thick-layers")
    assert "of 3 modes, from" in text
    assert "bend its layers in half waves below 7 thicknesses" in text


def test_strengths_keep_mesh_and_matrices(swung: Result) -> None:
    stronger = {"carbon": CARBON | {"strength": STRENGTH | {"S": "90 MPa"}}, "foam": FOAM}
    one, other, softer = (
        swung.run.part,
        fmd.load(panel(lamina=stronger)).run.part,
        fmd.load(panel(lamina=stronger | {"foam": FOAM | {"E1": "60 MPa"}})).run.part,
    )
    assert one.shape.lamina != other.shape.lamina
    assert mesh_inputs(one) == mesh_inputs(other)
    assert assembly_inputs(one) == assembly_inputs(other)
    assert assembly_inputs(one) != assembly_inputs(softer)


def test_an_offset_moves_the_shell_along_its_normal() -> None:
    z = fmd.load(panel(offset="4 mm")).run.part.mesh.points[:, 2]
    assert (z.min(), z.max()) == pytest.approx((-1e-3, 9e-3), abs=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"layers": [{"material": "glass", "thickness": "1 mm"}]}, r"layers\.0\.material.*no such material"),
        ({"layers": []}, r"E.*is missing, e\.g\."),
        ({"layers": [], "lamina": {}} | METAL, r"thickness.*is missing"),
        ({"layers": [], "thickness": "2 mm"} | METAL, r"lamina: has no effect: its materials are those of layers"),
        (
            {"layers": [], "lamina": {}, "thickness": "2 mm", "layer_direction": [0, 1, 0]} | METAL,
            "layer_direction.*: has no effect: it belongs to layers",
        ),
        ({"thickness": "2 mm"}, "has no effect beside layers, which have thicknesses"),
        ({"E": "70 GPa"}, "has no effect beside layers, which have the materials of lamina"),
        ({"lamina": {"carbon": CARBON | {"nu12": 4.0}, "foam": FOAM}}, r"must be below \(E1/E2\)\^½ = 3\.67"),
        (
            {"layer_direction": [0, 0, 1]},
            r"layer_direction.*: is along the normal of 18 elements; take another direction",
        ),
    ],
)
def test_layers_that_are_wrong_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        fmd.load(panel(**changes)).run.part.fe  # noqa: B018


def test_plies_are_of_bodies_with_layers_in_one_piece(tmp_path: Path) -> None:
    plain = {"layers": [], "lamina": {}, "thickness": "10 mm"} | METAL
    with pytest.raises(InputError, match="has no layers, whose plies have stress of their own"):
        find_plies(fmd.load(panel(**plain)).run, "panel")
    cut = {"pieces": 2, "modes": {"count": 3, "enrich": "none"}}
    with pytest.raises(InputError, match="is in pieces, and the stress of plies is that of bodies in one piece"):
        find_plies(fmd.load(panel(**cut)).run, "panel")
