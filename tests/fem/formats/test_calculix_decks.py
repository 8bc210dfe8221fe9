"""Small decks of CalculiX's own test set through `fmd modes`: CalculiX's frequencies, or a refusal by name.

Frequencies are those of CalculiX 2.20 for the deck's nodes, elements, sets, equations and rigid bodies, free, of steel
in N, mm and t, with C3D20 for C3D20R: the model that `benchmarks/calculix_decks.py` writes. All 355 decks are in that
benchmark's table.
"""

import json
from pathlib import Path

import pytest

DECKS = Path(__file__).parent / "decks" / "calculix"
SCENE = """title = "{0}"
[body.deck]
mesh = {{ file = "{1}", unit = "mm", force_unit = "N", mass_unit = "t"{2} }}
E = "210 GPa"
nu = 0.3
rho = "7800 kg/m^3"
modes = {{ count = 6 }}
"""


def modes(fmd, tmp_path: Path, name: str, option: str = "", more: str = "") -> int:
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.format(name, (DECKS / f"{name}.inp").as_posix(), option) + more)
    return fmd("modes", str(scene), "--json")


@pytest.mark.parametrize(
    ("name", "frequencies", "apart"),
    [
        ("achtel2", [681973.4, 691509.4, 691509.4, 727602.2, 919845.1, 919845.1], 1e-6),  # equations
        ("achtelcas", [581359.3, 581359.3, 681973.4, 691509.4, 691509.4, 888386.2], 1e-6),  # equations
        ("anipla", [1774134, 1974580, 1974580, 2789970, 3967084, 3967084], 1e-6),
        ("oneel20cf", [1774134, 1774134, 2209143, 2209143, 2209143, 2509004], 1e-6),
        ("segment1", [978485.5, 1374996, 1714710, 2020693, 2031611, 2049805], 1e-6),
        ("capacitor", [1764.42, 4854.58, 9262.275, 22566.67, 37016.74, 57659.45], 1e-6),
        ("beamrb", [79196.4, 79196.4, 186070.7, 201812.7, 201812.7, 323934.5], 1e-6),  # a rigid body
        ("mpcforce", [79195.89, 110271.0, 186068.5, 201804.1, 201804.1, 350093.5], 2e-6),  # equations
        ("beamf", [79226.34, 112328.5, 172525.6, 202021.8, 267618.0, 323681.8], 1e-6),
        # C3D10 and C3D15 have other points of integration there.
        ("beam10p", [80901.34, 81136.44, 204244.4, 217373.7, 219177.0, 324055.7], 7e-3),
        ("c3d15", [1003183, 1270064, 1270064, 1651978, 1658041, 1677602], 2e-3),
    ],
)
def test_a_deck_has_the_frequencies_of_calculix(fmd, tmp_path, capsys, name, frequencies, apart) -> None:
    assert modes(fmd, tmp_path, name) == 0
    found = json.loads(capsys.readouterr().out)["frequencies_hz"]
    assert found[:6] == pytest.approx(frequencies, rel=apart)


def test_a_clamped_deck_has_the_frequencies_of_its_own_output(fmd, tmp_path, capsys) -> None:
    """Those of beamf.dat.ref, which CalculiX's authors give with the deck. Its C3D20R are softer than C3D20."""
    more = 'support = [{ face = "CN7" }]\n'
    assert modes(fmd, tmp_path, "beamf", more=more) == 0
    found = json.loads(capsys.readouterr().out)["frequencies_hz"]
    given = [13096.03, 19319.52, 76839.71, 86955.23, 105963.6, 162998.5]
    assert all(1.0 < one / other < 1.006 for one, other in zip(found[:6], given, strict=True))


def test_a_clamped_deck_of_eight_node_shells_has_the_frequencies_of_thin_plates(fmd, tmp_path, capsys) -> None:
    """A square of 2 x 2 S8 by Leissa's table of cantilever plates (1969); CalculiX has 9683.5 and 23623.5 Hz there."""
    assert modes(fmd, tmp_path, "shellf", ', shell = "deck"', 'support = [{ face = "Nfixx" }]\n') == 0
    found = json.loads(capsys.readouterr().out)["frequencies_hz"]
    bending = (210e3 * 0.01**3 / 12 / (1 - 0.3**2) / (7.8e-9 * 0.01)) ** 0.5 / (2 * 3.14159265)
    assert found[:2] == pytest.approx([3.4917 * bending, 8.5246 * bending], rel=0.02)


@pytest.mark.parametrize(
    ("name", "option", "message"),
    [
        ("uprofile", ', beam = "deck"', "*BEAM GENERAL SECTION of elall has walls that differ from side to side"),
        ("dashpot1", "", "elements that aren't solid (1 DASHPOTA): left out"),
        ("spring4", "", "there are no solid elements; the elements: 1 CPE8"),
    ],
)
def test_a_deck_that_is_not_read_is_refused_by_name(fmd, tmp_path, capsys, name, option, message) -> None:
    assert modes(fmd, tmp_path, name, option) == 2
    assert message in " ".join(capsys.readouterr().err.split())
