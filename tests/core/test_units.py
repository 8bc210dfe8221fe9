"""Quantities: text with a unit in, SI floats out, everything else refused."""

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from fmd.core import common_units, units
from fmd.core.units import NonNegativeTime, PositiveLength, convert_values, to_si, unit_ratio


@pytest.mark.parametrize(
    ("text", "kind", "si"),
    [
        ("300mm", "length", 0.3),
        (" 340 mm ", "length", 0.34),
        ("-2 in", "length", -0.0508),
        ("722 MPa", "stress", 722e6),
        ("10 N/mm²", "stress", 10e6),
        ("2e-9 t/mm^3", "density", 2000.0),
        ("2.78 g/cm**3", "density", 2780.0),
        ("10 us", "time", 1e-5),
        ("10 µs", "time", 1e-5),
        ("20 rad/s", "angular rate", 20.0),
        ("90 deg", "angle", math.pi / 2),
        ("90°", "angle", math.pi / 2),
        ("131.2 Hz", "frequency", 131.2),
        ("1.2 kHz", "frequency", 1200.0),
        ("1.5 N m", "torque", 1.5),
        ("1.5 kN*mm", "torque", 1.5),
        ("2500 g", "mass", 2.5),
        ("500 kg cm²", "moment of inertia", 0.05),
        ("3 mm/s", "speed", 0.003),
        ("1 kN/m", "translational stiffness", 1000.0),
        ("2 N s/mm", "translational damping", 2000.0),
        ("5 N m/rad", "rotational stiffness", 5.0),
        ("5 N m", "rotational stiffness", 5.0),
        ("5 N m s/rad", "rotational damping", 5.0),
        ("5 N m s", "rotational damping", 5.0),
    ],
)
def test_a_quantity_becomes_the_nearest_float_in_si_units(text: str, kind: str, si: float) -> None:
    assert to_si(text, kind) == si


def test_common_units_are_those_of_pint_in_any_product() -> None:
    registry, generator = units._registry(), np.random.default_rng(0)
    symbols = [*common_units._COMMON]
    powers, joints = ["", "^2", "**3", "²", "^-1", "³"], [" ", "*", " * ", "/", " / ", "·"]
    for case in range(400):
        chosen = generator.choice(symbols, 1 + case % 4) if case >= len(symbols) else [symbols[case]]
        parts = [symbol + (generator.choice(powers) if case >= len(symbols) else "") for symbol in chosen]
        text = parts[0] + "".join(generator.choice(joints) + part for part in parts[1:])
        factor, base = registry.get_base_units(registry.parse_units(text))
        found = common_units.common_unit(text)
        if str(base) == "dimensionless":
            assert found is None
        else:
            assert found is not None
            assert (float(found[0]), found[1]) == (float(factor), str(base)), text


@pytest.mark.parametrize("text", ["furlong", "N m/lbf", "mt", "1", "", "Gs", "N //m", "m 2", "/m", "m^2s"])
def test_other_units_are_left_to_pint(text: str) -> None:
    assert common_units.common_unit(text) is None


def test_rotations_per_minute_become_radians_per_second() -> None:
    assert to_si("8000 rpm", "angular rate") == pytest.approx(8000 * 2 * math.pi / 60, rel=1e-15)


@pytest.mark.parametrize(
    ("value", "kind", "message"),
    [
        (340, "length", "needs a unit, e.g. '340 mm'"),
        (0.34, "length", "needs a unit, e.g. '340 mm'"),
        ("340", "length", "needs a unit, e.g. '340 mm'"),
        ("340 kg", "length", "'340 kg' is a mass, a length is wanted, e.g. '340 mm'"),
        ("3 Hz", "angular rate", "'3 Hz' is a frequency, an angular rate is wanted, e.g. '20 rad/s'"),
        ("8000 rpm", "frequency", "'8000 rpm' is an angular rate, a frequency is wanted, e.g. '131.2 Hz'"),
        ("5 deg", "time", "'5 deg' is an angle, a time is wanted"),
        ("5 N m/rad", "torque", "'5 N m/rad' is a rotational stiffness, a torque is wanted"),
        ("5 N m rad", "rotational stiffness", "a rotational stiffness is wanted, e.g. '10 N m/rad'"),
        ("5 N/m", "rotational stiffness", "is a translational stiffness, a rotational stiffness is wanted"),
        ("5 N m", "rotational damping", "'5 N m' is a torque, a rotational damping is wanted"),
        ("5 N m", "translational stiffness", "'5 N m' is a torque, a translational stiffness is wanted"),
        ("5 N m/s", "torque", r"is in 'kilogram \* meter \*\* 2 / second \*\* 3', a torque is wanted"),
        ("5 m/m", "length", "is in 'dimensionless', a length is wanted"),
        ("340 mmm", "length", "'mmm' isn't a known unit: a length is wanted"),
        ("340 °°", "angle", "'°°' isn't a known unit: an angle is wanted"),
        ("nan mm", "length", "'nan mm' isn't finite"),
        ("-inf mm", "length", "'-inf mm' isn't finite"),
        ("1e400 mm", "length", "'1e400 mm' isn't finite"),
        ("1e300 Ym", "length", "'1e300 Ym' isn't finite"),
        ("1e99999999999999999999 mm", "length", "isn't finite"),
        ("", "length", "isn't a number with a unit: a length is wanted"),
        ("mm", "length", "isn't a number with a unit"),
        ("3,5 mm", "length", "isn't a number with a unit"),
        ("٣ mm", "length", "isn't a number with a unit"),
        ("9**9**9 mm", "length", "isn't a number with a unit"),
        ("1 mm^9^9^9^9", "length", "isn't a number with a unit"),
        ("1 mm**99999999", "length", "isn't a number with a unit"),
        ("1 __import__('os')", "length", "isn't a number with a unit"),
        ("1 " + "m " * 100_000, "length", "isn't a number with a unit"),
        (["340 mm"], "length", "isn't a number with a unit"),
        (None, "length", "isn't a number with a unit"),
    ],
)
def test_what_is_no_quantity_of_the_kind_is_refused(value: object, kind: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        to_si(value, kind)


def test_a_positive_length_is_not_zero() -> None:
    with pytest.raises(ValidationError, match="must be greater than zero"):
        TypeAdapter(PositiveLength).validate_python("0 mm")


def test_a_time_that_may_be_zero_is_not_negative() -> None:
    start = TypeAdapter(NonNegativeTime)
    assert start.validate_python("0 s") == 0.0
    with pytest.raises(ValidationError, match="must not be negative"):
        start.validate_python("-1 us")


@given(
    st.floats(min_value=-1e200, max_value=1e200),
    # The factors are SI's definitions of prefixes, the minute, the tonne and the inch.
    st.sampled_from(
        [
            ("mm", "length", 1e-3),
            ("in", "length", 0.0254),
            ("GPa", "stress", 1e9),
            ("t/mm^3", "density", 1e12),
            ("min", "time", 60.0),
            ("kHz", "frequency", 1e3),
            ("mrad", "angle", 1e-3),
            ("turn/s", "angular rate", 2 * math.pi),
            ("kN cm", "torque", 10.0),
            ("N m/deg", "rotational stiffness", 180 / math.pi),
            ("N m s/deg", "rotational damping", 180 / math.pi),
        ]
    ),
)
def test_a_value_times_a_unit_is_its_si_value(value: float, unit: tuple[str, str, float]) -> None:
    text, kind, factor = unit
    assert to_si(f"{value!r} {text}", kind) == pytest.approx(value * factor, rel=1e-14, abs=1e-300)


@given(st.text() | st.from_regex(r"[0-9.e+-]{1,6} ?[a-zµ°²³^*/· 0-9-]{1,20}", fullmatch=True))
def test_any_other_text_is_refused_or_finite(text: str) -> None:
    message = ""
    try:
        assert math.isfinite(to_si(text, "length"))
    except ValueError as error:
        message = str(error)
    assert not message or "a length is wanted" in message or "needs a unit" in message


def test_values_change_their_unit() -> None:
    # the definitions of the degree, the turn and the prefix
    assert convert_values(np.array([0.0, math.pi]), "rad", "deg") == pytest.approx([0.0, 180.0], rel=1e-15)
    assert unit_ratio("rad", "turn") == pytest.approx(1 / (2 * math.pi), rel=1e-15)
    assert (unit_ratio("m", "mm"), unit_ratio("m", "m"), unit_ratio("rad", "rad")) == (1000.0, 1.0, 1.0)


@pytest.mark.parametrize("wanted", ["deg", "mmm", "", "2 mm", "9**9**9", "m/s", "m " * 100_000])
def test_values_change_to_no_other_dimension(wanted: str) -> None:
    with pytest.raises(ValueError, match="isn't a unit that m converts to; 'm' works"):
        convert_values(np.ones(2), "m", wanted)


def test_pint_is_loaded_only_for_a_quantity() -> None:
    code = "import sys, fmd.core.units; assert 'pint' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_a_damaged_units_cache_is_rebuilt(tmp_path, monkeypatch):
    monkeypatch.setenv("FMD_CACHE", str(tmp_path))

    def speed():  # as a new process reads it
        units._known_units.cache_clear()
        units._base_units.cache_clear()
        return to_si("3 furlong/fortnight", "speed")

    found = speed()
    assert found == pytest.approx(3 * 201.168 / (14 * 86400), rel=1e-5)
    for file in (tmp_path / "units").iterdir():
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert speed() == found
    assert speed() == found
