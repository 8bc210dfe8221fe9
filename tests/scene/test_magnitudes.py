"""Values that can't be are refused as they are read; unusual ones are named by a warning."""

from typing import Any

import pytest

from fmd.core.errors import InputError
from fmd.scene.magnitudes import _walk, find_unusual
from fmd.scene.scene import SceneReader, load_scene
from fmd.scene.toml_files import list_ready_scenes


@pytest.mark.parametrize("key", ["body.beam.E", "body.beam.rho", "body.beam.length", "simulation.duration"])
@pytest.mark.parametrize("size", ["1e308", "1e-290", "-1e308"])
def test_what_no_part_can_have_is_refused_by_its_key(key: str, size: str) -> None:
    unit = {"E": "Pa", "rho": "kg/m^3", "length": "m", "duration": "s"}[key.rpartition(".")[2]]
    with pytest.raises(InputError) as caught:
        load_scene("beam", [f"{key}={size} {unit}"])
    given = size.replace("1e308", "1e+308")
    assert f"{key} = '{size} {unit}': {given} {unit} can't be a" in str(caught.value)


def test_a_density_in_grams_per_cubic_millimetre_by_mistake_is_refused() -> None:
    with pytest.raises(InputError, match=r"body\.beam\.rho = '2700 g/mm\^3': 2\.7e\+09 kg/m\^3 can't be a density"):
        load_scene("beam", ["body.beam.rho=2700 g/mm^3"])


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("drive.spin_up.speed=1e70 rad/s", "can't be an angular rate"),
        ("simulation.gravity=['0 m/s^2', '1e290 m/s^2', '0 m/s^2']", "can't be an acceleration"),
        ("joint.hub.damper=1e-200 N m s", "can't be a rotational damping"),
        (
            "coupler={ g = { type = 'gear', joint = 'hub', driver = 'hub', ratio = 1e300 } }",
            "can't be a number: the greatest is 1e.60",
        ),
        (
            "drive.spin_up={type='torque', joint='hub', torque={times=['0 s', '1 s'], values=[0, 1e59], unit='GN m'}}",
            "1e.68 N m can't be a torque",
        ),
    ],
)
def test_rates_loads_and_numbers_have_limits_too(override: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        load_scene("beam", [override])


@pytest.mark.parametrize("name", list_ready_scenes())
def test_nothing_in_the_ready_scenes_is_unusual_and_each_of_their_numbers_is_looked_at(name: str) -> None:
    def numbers(value: Any) -> list[float]:
        inner = [*value.values()] if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
        return [value] if isinstance(value, float) else [x for item in inner for x in numbers(item)]

    scene = load_scene(name)
    assert [*find_unusual(scene)] == []
    assert sorted(value for *_, value, _ in _walk(scene, (), "")) == sorted(numbers(scene.model_dump()))


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("body.beam.rho=2.7 kg/m^3", "body.beam.rho is 2.7 kg/m^3, which is unusual: foam has about 30"),
        ("body.beam.E=70 Pa", "body.beam.E is 70 Pa, which is unusual: rubber"),
        ("body.beam.E=210e12 Pa", "body.beam.E is 2.1e+14 Pa"),
        ("body.beam.nu=0.499", "body.beam.nu is 0.499, which is unusual: metals have about 0.3"),
        ("body.beam.nu=-0.4", "body.beam.nu is -0.4, which"),
        ("body.beam.length=340 km", "body.beam.length is 3.4e+05 m"),
        ("drive.spin_up.speed=1e6 rad/s", "drive.spin_up.speed is 1e+06 rad/s, which is unusual: a turbocharger"),
        ("joint.hub.rate=-5e5 rpm", "joint.hub.rate is -5.236e+04 rad/s"),
    ],
)
def test_an_unusual_value_is_named_with_what_is_usual(override: str, said: str) -> None:
    (found,) = find_unusual(load_scene("beam", [override]))
    assert found.startswith(said)


def test_a_scene_that_shares_its_other_tables_has_the_unusual_values_of_its_own() -> None:
    reader, unusual = SceneReader("beam"), []
    for overrides in ([], ["body.beam.E=70 Pa"], ["drive.spin_up.speed=1e6 rad/s"], ["body.beam.E=70 Pa"], []):
        found, alone = (list(find_unusual(scene)) for scene in (reader.load(overrides), load_scene("beam", overrides)))
        assert found == alone
        unusual.append([text.split(" is ")[0] for text in found])
    E, speed = ["body.beam.E"], ["drive.spin_up.speed"]
    assert unusual == [[], E, speed, E, []]


def test_masses_and_speeds_of_rigid_mechanisms_are_weighed_too() -> None:
    found = [*find_unusual(load_scene("rod-slider", ["body.slider.mass=5e9 kg", "joint.slide.rate=12 km/s"]))]
    assert [text.partition(",")[0] for text in found] == [
        "body.slider.mass is 5e+09 kg",
        "joint.slide.rate is 1.2e+04 m/s",
    ]


@pytest.mark.parametrize(
    ("stop", "said"),
    [
        ("low='10 cm', high='14 cm'", ["joint.slide starts 0.01 m beyond its stop.high"]),
        ("low='0.5 m'", ["joint.slide starts 0.35 m beyond its stop.low"]),
        ("low='10 cm', high='20 cm'", []),
        ("low='15.05 cm'", []),  # pressed at the start by less than ten widths
    ],
)
def test_a_start_far_beyond_a_stop_is_named_with_what_the_stop_holds(stop: str, said: list[str]) -> None:
    found = [*find_unusual(load_scene("rod-slider", [f"joint.slide.stop={{{stop}, stiffness='1 MN/m'}}"]))]
    assert [text.partition(",")[0] for text in found] == said
    assert all("the stop holds" in text for text in found)
