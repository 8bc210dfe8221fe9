"""Tolerances beside a scene's numbers, which are read apart from these."""

from typing import Any

import pytest

import fmd as package
from fmd.core.errors import InputError
from tests.fitting.test_sensitivities import OSCILLATOR


@pytest.mark.parametrize(
    ("text", "value", "share"),
    [
        ("2 kg ± 2 %", 2.0, 0.02),
        ("2000 g +/- 0.5%", 2.0, 0.005),
        ("2e3 g±50 g", 2.0, 0.025),
        ("2 kg ± 10 g", 2.0, 0.005),
        ("2.0 kg +- 1e-3 kg", 2.0, 5e-4),
    ],
)
def test_a_tolerance_is_a_share_of_its_number_or_a_quantity_like_it(text: str, value: float, share: float) -> None:
    scene = package.load_scene(OSCILLATOR, [f"body.block.mass={text}"])
    assert scene.body["block"].mass == value
    assert scene.tolerances == {"body.block.mass": pytest.approx(share, rel=1e-12)}


def test_plain_numbers_and_items_of_lists_have_tolerances_and_texts_have_none() -> None:
    bar = {"shape": "bar", "length": "1 m", "depth": "1 cm ± 1 %", "width": "1 cm", "E": "70 GPa", "rho": "2.7 g/cm^3"}
    bar |= {"nu": "0.33 ± 3 %", "mesh": {"divisions": [4, 1, 1]}, "modes": {"count": 1}, "marker": {}}
    title = "9 ± 1 % of all bars"
    scene = package.load_scene({"title": title, "body": {"bar": bar}})
    bare = package.load_scene({"title": title, "body": {"bar": bar | {"depth": "1 cm", "nu": 0.33}}})
    assert scene.model_dump(mode="json") == bare.model_dump(mode="json")
    assert scene.tolerances == {"body.bar.depth": 0.01, "body.bar.nu": 0.03}
    listed = package.load_scene(OSCILLATOR, ["simulation.gravity=['0 m/s^2','-9.81 m/s^2 ± 0.1 %','0 m/s^2']"])
    assert listed.tolerances == {"simulation.gravity.1": 0.001}
    assert listed.simulation.gravity == (0.0, -9.81, 0.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("2 kg ± 2 mm", "'2 mm' isn't in a unit of '2 kg'"),
        ("2 kg ± 80 %", "must be between 0.0001 % and 50 %"),
        ("2 kg ± heavy", "'heavy' isn't a number with a unit"),
        ("2 kg ± 0 g", "must be between 0.0001 % and 50 %"),
        ("2 kg ± ", "isn't a number with a unit"),
    ],
)
def test_a_tolerance_that_is_none_is_refused_with_its_key(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        package.load_scene(OSCILLATOR, [f"body.block.mass={text}"])
    assert caught.value.key == "body.block.mass"
    assert "e.g. '0.4 kg ± 2 %'" in str(caught.value)


def test_a_tolerance_changes_nothing_that_is_wrong_with_its_number() -> None:
    wrong: dict[str, Any] = {"body.block.mass": "2 m ± 2 %"}
    with pytest.raises(InputError, match="is a length, a mass is wanted"):
        package.load_scene(OSCILLATOR, [f"{key}={text}" for key, text in wrong.items()])
