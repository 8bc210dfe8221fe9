"""Beams from the scene file to their motion and stress, beside solids, and scenes with beams that are wrong."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmd
from fmd.core.errors import InputError
from fmd.output.frequencies import rotating_table
from fmd.output.mechanism_view import body_surface
from tests.stages.test_shells import swung

SECTION = {"type": "rectangle", "width": "40 mm", "height": "20 mm"}
BEAM = {"shape": "profile", "length": "1 m", "section": SECTION, "mesh": {"size": "25 mm"}}
SOLID = {"shape": "bar", "length": "1 m", "depth": "40 mm", "width": "20 mm"}
HEXAHEDRA = {"element": "hexahedron", "order": 2, "divisions": [20, 1, 1]}


def test_a_swung_profile_moves_as_a_bar_of_solids() -> None:
    beam, solid = (fmd.load(swung(shape)) for shape in (BEAM, SOLID | {"mesh": HEXAHEDRA}))
    assert beam.modes.frequencies_hz[:4] == pytest.approx(solid.modes.frequencies_hz[:4], rel=3e-3)
    bent = [np.asarray(run.motion.tip_deflection) for run in (beam, solid)]
    assert np.abs(bent[0] - bent[1]).max() < 5e-3 * np.abs(bent[1]).max()
    places = np.array([[0.1, y, z] for y in (0.019, -0.019) for z in (0.0099, -0.0099)])
    each = [run.run.part.stress_at(places)[:, 0] @ np.asarray(run.motion.modal("plate")).T for run in (beam, solid)]
    assert np.abs(each[0] - each[1]).max() < 2e-2 * np.abs(each[1]).max()


def test_a_clamped_end_of_a_short_beam_stays_averaged() -> None:
    """Its section is broad beside its length, and moves as a whole already."""
    stub = {"length": "60 mm", "section": {"type": "rectangle", "width": "60 mm", "height": "60 mm"}}
    scene = swung(BEAM | stub)
    scene["joint"]["hub"] = {"type": "fixed", "parent": "ground", "child": "plate.root"}
    scene["drive"] = {}
    part = fmd.load(scene).run.part
    assert part.has_default_clamp
    assert not part.markers["root"].rigid


def test_a_fixed_joint_on_the_feet_of_a_portal_holds_each_of_them(tmp_path: Path) -> None:
    s = np.linspace(0, 1, 6)
    x = [*((0, 0, each) for each in s), *((each, 0, 1) for each in s[1:]), *((1, 0, 1 - each) for each in s[1:])]
    deck = ["*NODE", *(f"{k}, {', '.join(map(str, map(float, own)))}" for k, own in enumerate(x, start=1))]
    deck += ["*ELEMENT, TYPE=B31, ELSET=E", *(f"{k}, {k}, {k + 1}" for k in range(1, 16))]
    deck += ["*BEAM SECTION, ELSET=E, SECTION=RECT, MATERIAL=M", "0.02, 0.03", "0., 1., 0."]
    deck += ["*NSET, NSET=FEET", "1, 16", "*NSET, NSET=TIP", "8", ""]
    (tmp_path / "a.inp").write_text("\n".join(deck))
    scene = swung({"mesh": {"file": str(tmp_path / "a.inp"), "unit": "m", "beam": "deck"}})
    body = scene["body"]["plate"]
    body["marker"] = {"root": {"face": "FEET"}, "tip": {"face": "TIP"}}
    scene["joint"]["hub"] = {"type": "fixed", "parent": "ground", "child": "plate.root"}
    scene["drive"] = {}
    body["modes"] = {"count": 4, "boundary": "joint"}
    by_joint = fmd.load(scene).modes.frequencies_hz
    held = {key: own for key, own in body.items() if key != "marker"} | {"modes": {"count": 4}}
    by_support = fmd.load({"title": "P", "body": {"b": held | {"support": [{"face": "FEET"}]}}}).modes.frequencies_hz
    assert by_joint == pytest.approx(by_support, rel=1e-9)  # the mean of both feet alone: 0.7, 0.5, 0.4 of these


@pytest.mark.parametrize("axis", [[0, 0, 1], [0, 1, 0]], ids=["z", "y"])
def test_turning_stiffens_a_profile_as_a_bar_of_solids(axis: list[int]) -> None:
    found = []
    for shape in (BEAM, SOLID | {"mesh": HEXAHEDRA}):
        scene = swung(shape)
        scene["joint"]["hub"]["axis"] = axis
        scene["simulation"]["stiffening"] = "on"
        found.append(rotating_table(fmd.load(scene).run, 100.0)["rotating_frequencies_hz"])
    assert found[0][:3] == pytest.approx(found[1][:3], rel=4e-3)  # the lowest 16.6 Hz at rest, 24 or 18 at 100 rad/s


def test_a_beam_by_numbers_without_points_runs_and_says_how_to_have_stress(tmp_path: Path) -> None:
    deck = [
        *("*NODE", "1, 0., 0., 0.", "2, 250., 0., 0.", "3, 500., 0., 0."),
        *("*ELEMENT, TYPE=B31, ELSET=E", "1, 1, 2", "2, 2, 3"),
        *("*BEAM GENERAL SECTION, ELSET=E", "600., 20000., 0., 45000., 46000.", "0., 1., 0."),
        *("*NSET, NSET=ROOT", "1", "*NSET, NSET=TIP", "3"),
    ]
    (tmp_path / "a.inp").write_text("\n".join(deck))
    scene = swung({"mesh": {"file": str(tmp_path / "a.inp"), "unit": "mm", "beam": "deck"}})
    scene["body"]["plate"] |= {"marker": {"root": {"face": "ROOT"}, "tip": {"face": "TIP"}}}
    scene["simulation"] |= {"duration": "20 ms", "run": [{"integrator": "generalized-alpha", "step": "1 ms"}]}
    result = fmd.load(scene)
    assert len(result.budget.rows) > 0
    assert not [row for row in result.budget.rows if "stress" in str(row)]
    for ask in (lambda: result.run.stress_of("plate"), lambda: body_surface(result.run, "plate")):
        with pytest.raises(InputError, match="sections by numbers without points, C to F of PBAR, so no stress; give"):
            ask()


SHAFT = {
    "shape": "shaft",
    "segment": [
        {"length": "200 mm", "diameter": "30 mm"},
        {"length": "150 mm", "diameter": "40 mm", "bore": "20 mm"},
    ],
    "station": {"disc": "250 mm"},
    "mesh": {"size": "20 mm"},
}


def test_a_stepped_shaft_has_mass_stations_and_a_disc_between_its_ends() -> None:
    disc = {"at": "disc", "mass": "3 kg", "inertia": ["0.02 kg m^2", "0.01 kg m^2", "0.01 kg m^2"]}
    links = {"disc": {"face": "disc", "type": "rigid"}}
    markers = {"root": {"face": "x-"}, "tip": {"face": "x+"}, "middle": {"face": "disc"}}
    run = fmd.load(swung(SHAFT, link=links, mass={"disc": disc}, marker=markers))
    steel = 2700.0 * np.pi / 4 * (0.2 * 0.03**2 + 0.15 * (0.04**2 - 0.02**2))
    assert run.body.integrals.mass == pytest.approx(steel + 3.0, rel=1e-9)
    assert run.run.part.mass == pytest.approx(steel + 3.0, rel=1e-9)
    assert run.body.markers["middle"].position == pytest.approx([0.25, 0.0, 0.0])
    assert list(run.run.part.mesh.parts) == ["segment-1", "segment-2"]
    without = fmd.load(swung(SHAFT))
    assert run.modes.frequencies_hz[0] < 0.7 * without.modes.frequencies_hz[0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"station": {"disc": "400 mm"}}, r"station.disc = .*must be below the length, 0.35 m"),
        ({"station": {"x+": "100 mm"}}, r"station.*is the name of an end|x\+"),
        ({"segment": [{"length": "1 m", "diameter": "20 mm", "bore": "20 mm"}]}, "bore = .*must be below the diameter"),
        ({"pieces": 3, "modes": {"count": 4}}, "beams aren't cut yet"),
        ({"marker": {"root": {"face": "x-"}, "tip": {"face": "disk"}}}, "no such face; did you mean 'disc'"),
        ({"segment": []}, "segment"),
    ],
)
def test_shafts_that_are_wrong_are_refused_by_key(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        fmd.load(swung(SHAFT, **changes))


@pytest.mark.parametrize(
    ("section", "message"),
    [
        (
            {"type": "box", "width": "40 mm", "height": "20 mm", "wall": "10 mm"},
            r"section\.wall = .*: must be below half",
        ),
        (
            {"type": "I", "width": "40 mm", "height": "20 mm", "web": "4 mm", "flange": "10 mm"},
            r"section\.flange = .*: must be below half",
        ),
        (
            {"type": "I", "width": "4 mm", "height": "20 mm", "web": "4 mm", "flange": "1 mm"},
            r"section\.web = .*: must be below the width",
        ),
        ({"type": "oval"}, "section"),
    ],
)
def test_sections_that_are_wrong_are_refused_by_key(section: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        fmd.load(swung(BEAM, section=section))
