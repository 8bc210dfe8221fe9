"""Bodies with links and masses from the scene file to their motion, and scenes with links that are wrong."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmd
from fmd.core.arrays import Array
from fmd.core.errors import InputError

MASS, HEIGHT = 0.4, 0.05
INERTIA = ["1e-4 kg m^2", "2e-4 kg m^2", "2e-4 kg m^2"]
AT = ["0.3 m", "0 m", f"{HEIGHT} m"]


BAR = {
    "shape": "bar",
    "length": "0.3 m",
    "depth": "10 mm",
    "width": "10 mm",
    "mesh": {"element": "hexahedron", "order": 2, "divisions": [6, 1, 1]},
}
PLATE = {"shape": "plate", "length": "0.3 m", "width": "50 mm", "thickness": "5 mm", "mesh": {"divisions": [6, 2]}}


def scene(linked: bool = True, shape: dict[str, Any] = BAR, **changes: Any) -> dict[str, Any]:
    """A bar on a hinge along y, whose free end carries a motor beside it, linked or as a rigid body of its own."""
    bar = shape | {
        "E": "70 GPa",
        "nu": 0.3,
        "rho": "2700 kg/m^3",
        "modes": {"count": 6, "boundary": "interface"},
        "marker": {"root": {"face": "x-"}, "end": {"face": "x+", "attachment": "rigid"}},
    }
    linked_bar = bar | {
        "marker": {"root": {"face": "x-"}, "end": {"link": "end"}},
        "link": {"end": {"face": "x+", "type": "rigid", "at": AT}},
        "mass": {"motor": {"at": "end", "mass": f"{MASS} kg", "inertia": INERTIA}},
    }
    motor = {
        "shape": "rigid",
        "mass": f"{MASS} kg",
        "inertia": INERTIA,
        "marker": {"seat": {"at": ["0 m", "0 m", f"{-HEIGHT} m"]}, "end": {"at": ["0 m", "0 m", "0 m"]}},
    }
    bolt = {"type": "fixed", "parent": "bar.end", "child": "motor.seat"}
    return {
        "title": "Bar with a motor",
        "body": {"bar": linked_bar | changes} if linked else {"bar": bar, "motor": motor},
        "joint": {"hinge": {"type": "revolute", "parent": "ground", "child": "bar.root", "axis": [0, 1, 0]}}
        | ({} if linked else {"bolt": bolt}),
        "simulation": {
            "duration": "0.1 s",
            "output_step": "2 ms",
            "gravity": ["0 m/s^2", "0 m/s^2", "-9.81 m/s^2"],
            "tip": "bar.end" if linked else "motor.end",
            "run": [{"integrator": "runge-kutta", "tolerance": 1e-9}],
        },
    }


@pytest.mark.parametrize("shape", [BAR, PLATE], ids=["solid", "shell"])
def test_a_linked_motor_moves_as_a_rigid_body_that_is_bolted_on(shape: dict[str, Any]) -> None:
    paths: list[Array] = []
    for linked in (True, False):
        paths.append(np.asarray(fmd.load(scene(linked, shape)).motion.tip_position))
    fall = np.abs(paths[0] - paths[0][0]).max()
    assert fall > 0.02
    assert np.abs(paths[0] - paths[1]).max() < 1e-5 * fall


def test_mass_is_that_of_bar_and_motor_and_stress_that_of_the_bars_own_surface() -> None:
    result = fmd.load(scene())
    bar = 2700.0 * 0.3 * 0.01**2
    assert result.body.integrals.mass == pytest.approx(bar + MASS, rel=1e-9)
    J = bar * (0.3**2 / 3 + 0.01**2 / 12) + 2e-4 + MASS * (0.3**2 + HEIGHT**2)  # about the hinge
    assert result.body.inertia_about_joint == pytest.approx(J, rel=1e-9)
    assert result.stress.nodes.max() < len(result.fe.discretisation.x)
    assert len(result.body.x) == len(result.fe.discretisation.x) + 14


@pytest.mark.parametrize("shape", [BAR, PLATE], ids=["solid", "shell"])
def test_a_body_with_links_is_cut_where_no_link_is(shape: dict[str, Any]) -> None:
    whole, cut = scene(shape=shape, modes={"count": 10}), scene(shape=shape, modes={"count": 10}, pieces=2)
    for table in (whole, cut):
        table["simulation"]["duration"] = "4 ms"
    one, two = fmd.load(whole), fmd.load(cut)
    divided = two.run.division.divided["bar"]
    first, last = divided.pieces
    assert (last.mass - first.mass, first.mass + last.mass) == pytest.approx((MASS, one.run.part.mass), rel=1e-9)
    assert divided.frequencies_hz[:3] == pytest.approx(one.modes.frequencies_hz[:3], rel=1e-3)
    assert two.motion.tip_position == pytest.approx(np.asarray(one.motion.tip_position), abs=1e-8)  # it falls by 78 µm
    side = {"pieces": 2, "link": {"end": {"face": "y+" if shape is BAR else "z+", "type": "average"}}}
    with pytest.raises(InputError, match=r"body\.bar\.link\.end: its face extends over 2 of the body's 2 pieces"):
        _ = fmd.load(scene(shape=shape, modes={"count": 4}, **side)).run.division


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"mass": {"motor": {"at": "and", "mass": "1 kg"}}},
            r"mass.motor.at = 'and': no such link; did you mean",
        ),
        ({"marker": {"root": {"face": "x-"}, "end": {"link": "tip"}}}, r"marker.end.link = 'tip': no such link"),
        ({"link": {"end": {"face": "x*", "type": "rigid"}}}, r"link.end.face = 'x\*': no such face"),
        ({"link": {"end": {"type": "rigid"}}}, "link.end.face: is missing"),
        (
            {"link": {"end": {"face": "x+", "plane": "x = 0", "type": "rigid"}}},
            "link.end.plane = .* can't stand",
        ),
        ({"mass": {"motor": {"at": "end", "mass": "1 kg", "inertia": [*INERTIA[:2], "1 kg m^2"]}}}, "isn't any body's"),
    ],
)
def test_links_that_are_wrong_are_refused_by_key(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        fmd.load(scene(**changes))


DECK_SCENE = """
title = "Bracket with a motor, by its deck"

[body.bracket]
mesh = { file = "bracket.inp", unit = "m" }
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
modes = { count = 4, boundary = "joint" }
marker = { foot = { face = "FOOT" }, seat = { link = 9001 }, again = { link = "motor" } }

[joint.base]
type = "revolute"
parent = "ground"
child = "bracket.foot"
axis = [0, 1, 0]

[simulation]
duration = "20 ms"
output_step = "1 ms"
gravity = ["0 m/s^2", "0 m/s^2", "-9.81 m/s^2"]
tip = "bracket.seat"

[[simulation.run]]
integrator = "runge-kutta"
"""
MOTOR = """*NODE, NSET=MOTOR
9001, 0.042, 0.0, 0.03
*RIGID BODY, NSET=BORE, REF NODE=9001
*ELEMENT, TYPE=MASS, ELSET=LUMP
90001, 9001
*MASS, ELSET=LUMP
0.4
"""


@pytest.fixture
def deck(tmp_path: Path) -> Path:
    """A scene with the bracket and its motor by a deck, and a deck without beside it."""
    text = (Path(__file__).parents[1] / "fem" / "formats" / "decks" / "bracket.inp").read_text()
    (tmp_path / "bracket.inp").write_text(text + MOTOR)
    (tmp_path / "bare.inp").write_text(text)
    (tmp_path / "deck.toml").write_text(DECK_SCENE)
    return tmp_path / "deck.toml"


def test_a_link_of_a_deck_is_that_of_the_scenes_keys_from_modes_to_motion(deck: Path) -> None:
    by_keys = (
        DECK_SCENE.replace('"bracket.inp"', '"bare.inp"')
        .replace('{ link = 9001 }, again = { link = "motor" }', '{ link = "bore" }')
        .replace("[joint.base]", MOTOR_KEYS + "[joint.base]")
    )
    other = deck.with_name("keys.toml")
    other.write_text(by_keys)
    found, wanted = fmd.load(deck), fmd.load(other)
    assert found.modes.frequencies_hz == pytest.approx(wanted.modes.frequencies_hz, rel=1e-7)
    assert found.body.integrals.mass == pytest.approx(wanted.body.integrals.mass, rel=1e-12)
    assert found.body.markers["again"].position == pytest.approx([0.042, 0.0, 0.03])
    paths = [np.asarray(each.motion.tip_position) for each in (found, wanted)]
    assert np.abs(paths[0] - paths[1]).max() < 1e-6 * np.abs(paths[0] - paths[0][0]).max()
    assert found.run.part.mass == pytest.approx(found.body.integrals.mass, rel=1e-9)
    assert found.run.part.mesh_notes[-1] == "links and masses of the file belong to the body: 1 *RIGID BODY, 1 MASS"


BAR_LINKS = """*NODE
901, 0.3, 0.005, 0.05
902, 0.3, 0.005, 0.05
*RIGID BODY, NSET=END, REF NODE=901
*ELEMENT, TYPE=MASS, ELSET=LUMP
2001, 901
*MASS, ELSET=LUMP
0.4
*ELEMENT, TYPE=MASS, ELSET=WEIGHT
2002, {middle}
*MASS, ELSET=WEIGHT
0.02
*ELEMENT, TYPE=SPRING2, ELSET=SPRING
2003, 901, 902
*SPRING, ELSET=SPRING
3, 3
5e4
*ELEMENT, TYPE=MASS, ELSET=HUNG
2004, 902
*MASS, ELSET=HUNG
0.1
*EQUATION
2
902, 1, 1., 901, 1, -1.
*EQUATION
2
902, 2, 1., 901, 2, -1.
"""


def bar_deck(shells: bool) -> str:
    """A bar of 12 hexahedra, or a strip of 24 shells, with a weight in the middle, links and a spring at its end."""
    n, rows = 12, 3 if shells else 4
    y = {k: (0.005 * k, 0.0) if shells else (0.01 * (k in (1, 2)), 0.01 * (k in (2, 3))) for k in range(rows)}
    lines = ["*NODE", *(f"{rows * i + k + 1}, {0.3 * i / n}, {y[k][0]}, {y[k][1]}" for i in range(n + 1) for k in y)]
    lines.append(f"*ELEMENT, TYPE={'S4' if shells else 'C3D8'}, ELSET=ALL")
    for i in range(n):
        here, there = rows * i + 1, rows * (i + 1) + 1
        if shells:
            rings = [(here + k, there + k, there + k + 1, here + k + 1) for k in (0, 1)]
        else:
            rings = [(*range(here, here + 4), *range(there, there + 4))]
        lines += [", ".join(map(str, (10 * i + k + 1, *ring))) for k, ring in enumerate(rings)]
    lines += ["*SHELL SECTION, ELSET=ALL", "0.01"] if shells else []
    end = range(rows * (n - shells) + 1, rows * (n + 1) + 1)  # of shells the last two rows, about which they can turn
    for name, nodes in (("ROOT", range(1, rows + 1)), ("END", end)):
        lines += [f"*NSET, NSET={name}", ", ".join(map(str, nodes))]
    return "\n".join([*lines, BAR_LINKS.format(middle=rows * n // 2 + 1)])


@pytest.mark.parametrize("shells", [False, True], ids=["solid", "shell"])
def test_a_body_is_cut_with_its_decks_links_springs_and_masses(shells: bool, tmp_path: Path) -> None:
    (tmp_path / "bar.inp").write_text(bar_deck(shells))
    table = scene()
    body = table["body"]["bar"]
    for key in ("shape", "length", "depth", "width"):
        del body[key]
    body |= {"mesh": {"file": str(tmp_path / "bar.inp"), "unit": "m"} | ({"shell": "deck"} if shells else {})}
    body |= {"marker": {"root": {"face": "ROOT"}, "end": {"link": "901"}}, "link": {}}
    body |= {"mass": {"motor": {"at": "901", "mass": "0.1 kg", "inertia": INERTIA}}, "modes": {"count": 8}}
    table["simulation"]["duration"] = "4 ms"
    one = fmd.load(table)
    body["pieces"] = 2
    two = fmd.load(table)
    first, last = two.run.division.divided["bar"].pieces
    assert (last.mass - first.mass, first.mass + last.mass) == pytest.approx((0.6 - 0.02, one.run.part.mass), rel=1e-9)
    found, wanted = two.run.division.divided["bar"].frequencies_hz[:3], one.modes.frequencies_hz[:3]
    assert found == pytest.approx(wanted, rel=1e-3)
    if not shells:
        assert two.motion.tip_position == pytest.approx(np.asarray(one.motion.tip_position), abs=1e-8)  # falls by 78 µm


MOTOR_KEYS = """[body.bracket.link]
bore = { face = "BORE", type = "rigid", at = ["42 mm", "0 mm", "30 mm"] }

[body.bracket.mass]
motor = { at = "bore", mass = "0.4 kg" }

"""


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("link = 9001", "link = 9002"), "marker.seat.link = '9002': no such link; did you mean '9001'?"),
        (("bracket.inp", "bare.inp"), "marker.seat.link = '9001': is of a deck without links"),
        (('unit = "m"', 'unit = "mm"'), "has MASS 90001; say the file's unit, mesh.mass_unit"),
        (("modes = {", "pieces = 4\nmodes = {"), r"mesh.file: \*RIGID BODY 1 extends over 2 of the body's 4 pieces"),
    ],
)
def test_links_of_decks_that_cannot_be_had_are_refused_by_key(
    deck: Path, change: tuple[str, str], message: str
) -> None:
    assert change[0] in DECK_SCENE
    text = DECK_SCENE.replace(*change)
    deck.write_text(text.replace(', boundary = "joint"', "") if "pieces" in change[1] else text)
    with pytest.raises(InputError, match=message):
        fmd.load(deck).motion  # noqa: B018


def test_rigid_links_that_share_nodes_are_refused() -> None:
    links = {"end": {"face": "x+", "type": "rigid"}, "side": {"face": "y+", "type": "rigid"}}
    with pytest.raises(InputError, match=r"body.bar.link: a node is moved by two links"):
        fmd.load(scene(link=links, mass={})).modes  # noqa: B018
