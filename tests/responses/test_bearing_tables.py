"""Bearings with tables over speed and over whirl: vibrations, orbits and motion of a rigid rotor in closed form."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmd.accuracy.rotor_errors import estimate_frequency_errors
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.output.unbalance import compute_circular_response
from fmd.responses.whirl_search import WhirlSearch
from fmd.scene.scene import load_scene
from fmd.stages.linear_model import linearise_scene
from fmd.stages.pipeline import Pipeline
from fmd.stages.rotor import find_vibrations
from tests.responses.test_unbalance import ACROSS, ARM, MASS, POLAR, RIGID, SHAFT

PLACES, STIFFNESS, DAMPING = [100.0, 500.0, 2000.0], [2e5, 4e5, 9e5], [300.0, 150.0, 50.0]
TABLE = f'over = "OVER", arguments = {PLACES}, values = {{values}}, unit = "{{unit}}"'
TABLES = [f"bearing.{name}.{key}={{ {TABLE.format(values=values, unit=unit)} }}"
          for name in ("near", "far")
          for key, values, unit in (("radial", STIFFNESS, "N/m"), ("radial_damper", DAMPING, "N s/m"))]  # fmt: skip


@pytest.fixture
def rotor(tmp_path: Path) -> Path:
    file = tmp_path / "rigid.toml"
    file.write_text(RIGID)
    return file


def load(file: Path, over: str, *more: str) -> Pipeline:
    return Pipeline(load_scene(file, [*(text.replace("OVER", over) for text in TABLES), *more]))


def coefficients(at: float) -> tuple[float, float]:
    return float(np.interp(at, PLACES, STIFFNESS)), float(np.interp(at, PLACES, DAMPING))


def poles(k: float, c: float, rate: float) -> Array:
    """As in test_rotors: of the translation, then of the tilt, forward where they turn with the rotor."""
    tilt = [ACROSS, 2 * c * ARM**2 - 1j * POLAR * rate, 2 * k * ARM**2]
    return np.concatenate([np.roots([MASS, 2 * c, 2 * k]), np.roots(tilt)])


SLIDE = np.sqrt(1e5 / MASS)  # along the axis


@pytest.mark.parametrize("rate", [20.0, 350.0, 1500.0, 2600.0])
def test_vibrations_have_the_coefficients_of_the_speed(rotor: Path, rate: float) -> None:
    expected = poles(*coefficients(rate), rate)
    found = find_vibrations(load(rotor, "speed"))(rate)
    np.testing.assert_allclose(2 * np.pi * found.frequencies_hz, sorted([*abs(expected.imag), SLIDE]), rtol=1e-8)
    np.testing.assert_allclose(sorted(found.growth), sorted([*expected.real, 0.0]), rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("rate", [0.0, 2600.0])
def test_vibrations_have_the_coefficients_of_their_own_whirl(rotor: Path, rate: float) -> None:
    expected = []
    for branch in range(4):
        s = 300j
        for _ in range(200):
            s = sorted(poles(*coefficients(abs(s.imag)), rate), key=lambda s: s.imag)[branch]
        expected.append(s)
    found = find_vibrations(load(rotor, "whirl"))(rate)
    np.testing.assert_allclose(
        2 * np.pi * found.frequencies_hz, sorted([*(abs(s.imag) for s in expected), SLIDE]), rtol=1e-8
    )
    np.testing.assert_allclose(sorted(found.growth), sorted([*(s.real for s in expected), 0.0]), rtol=1e-7, atol=1e-7)


def own_frequencies(damping: list[float], rate: float) -> list[float]:
    """Return where ``|Im s|`` in closed form is the frequency of its coefficients, to 0.1 rad/s."""
    places = np.linspace(0.0, 3000.0, 30001)
    k, c = np.interp(places, PLACES, STIFFNESS), np.interp(places, PLACES, damping)
    found = [float(SLIDE)]
    for mass, b, stiffness in ((MASS, 2 * c + 0j, 2 * k), (ACROSS, 2 * c * ARM**2 - 1j * POLAR * rate, 2 * k * ARM**2)):
        root = np.sqrt(b**2 - 4 * mass * stiffness)
        for branch in np.sort(np.abs((np.array([root - b, -root - b]) / (2 * mass)).imag), axis=0):
            above = branch > places
            found += [*places[1:][above[1:] != above[:-1]], *branch[-1:][above[-1:]]]
            found += [0.0] * int(branch[0] == 0.0) * (2 if rate == 0.0 else 1)  # at rest: in both directions
    return sorted(found)


RANDOM = (10 ** np.random.default_rng(3).uniform(1.5, 4.7, 3)).tolist()


@pytest.mark.parametrize(
    ("damping", "rate"),
    [
        ([3e4, 150.0, 50.0], 0.0),
        ([3e4, 150.0, 50.0], 350.0),
        ([150.0, 3e4, 50.0], 20.0),
        (RANDOM, 0.0),
        (RANDOM, 350.0),
    ],
)
def test_no_vibration_is_lost_where_bearings_overdamp(rotor: Path, damping: list[float], rate: float) -> None:
    table = TABLE.format(values=damping, unit="N s/m").replace("OVER", "whirl")
    damped = [f"bearing.{name}.radial_damper={{ {table} }}" for name in ("near", "far")]
    found = find_vibrations(load(rotor, "whirl", *damped))(rate)
    frequencies = 2 * np.pi * found.frequencies_hz
    np.testing.assert_allclose(np.sort(frequencies), own_frequencies(damping, rate), atol=0.11)
    for omega, growth in zip(frequencies, found.growth, strict=True):
        if abs(omega - SLIDE) > 1e-6:
            both = poles(np.interp(omega, PLACES, STIFFNESS), np.interp(omega, PLACES, damping), rate)
            s = growth + 1j * omega
            assert min(*abs(both - s), *abs(both - s.conjugate())) < 1e-6 * abs(s)


def test_newtons_method_finds_what_halving_finds(rotor: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between random tables, of vibrations far from one another and nearly alike, with and without overdamping."""
    rng = np.random.default_rng(11)
    for _ in range(6):
        rows = {"radial": 10 ** rng.uniform(4.5, 6.5, 3), "radial_damper": 10 ** rng.uniform(1.0, 4.5, 3)}
        tables = [
            f"bearing.{name}.{key}={{ over='whirl', arguments={PLACES}, values={own.tolist()}, unit='{unit}' }}"
            for name in ("near", "far")
            for (key, own), unit in zip(rows.items(), ("N/m", "N s/m"), strict=True)
        ]
        vibrations, rate = find_vibrations(load(rotor, "whirl", *tables)), float(rng.uniform(5.0, 900.0))
        quick = vibrations(rate)
        with monkeypatch.context() as patched:
            patched.setattr(WhirlSearch, "_correct", lambda self, at: None)
            by_halves = vibrations(rate)
        one, other = (  # by halves, which of two with one frequency is meant isn't sure: their whirl may be told twice
            np.array(found)[:2, np.lexsort((found.growth, np.round(found.frequencies_hz, 6)))]
            for found in (quick, by_halves)
        )
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("over", "order"), [("speed", 1.0), ("whirl", -2.0)])
def test_orbits_have_the_coefficients_of_the_speed_or_of_the_force(rotor: Path, over: str, order: float) -> None:
    rates = np.array([30.0, 120.0, 450.0, 1700.0])
    found = compute_circular_response(load(rotor, over), "rotor.centre", lambda rate: 3.0, rates, order)
    for rate in rates:
        k, c = coefficients(rate if over == "speed" else abs(order) * rate)
        nu, row = order * rate, int(np.argmin(abs(found.rates - rate)))
        exact = 3.0 / (2 * k - MASS * nu**2 + 2j * c * nu)
        assert found.displacement[row, found.markers.index("rotor.centre")] == pytest.approx(exact, rel=1e-7)


def test_a_run_up_has_the_coefficients_of_each_moment(rotor: Path) -> None:
    """m z̈ + 2 c(Ω) ż + 2 k(Ω) z = -m g with Ω by a constant torque, by SciPy."""
    drive = (
        'drive={ up = { type = "point torque", marker = "rotor.centre", direction = [1, 0, 0], torque = "90 N m" } }'
    )
    start = "joint.float.spin=['50 rad/s', '0 rad/s', '0 rad/s']"
    fall = "simulation.gravity=['0 m/s^2', '0 m/s^2', '-9.81 m/s^2']"
    run = load(rotor, "speed", drive, start, fall, "simulation.duration='60 ms'", "simulation.tip='rotor.centre'")

    def slope(t: float, y: Array) -> list[float]:
        k, c = coefficients(50.0 + 90.0 / POLAR * t)
        return [y[1], -9.81 - 2 * (c * y[1] + k * y[0]) / MASS]

    times = run.motion.times
    exact = solve_ivp(slope, (0.0, 0.06), [0.0, 0.0], t_eval=times, rtol=1e-10, atol=1e-14, max_step=1e-4).y[0]
    found = run.motion.tip_position[:, 2]
    assert np.abs(found - exact).max() < 1e-4 * np.abs(exact).max()


def test_a_linear_model_has_the_coefficients_of_the_start(rotor: Path) -> None:
    """A force that stands still in axes that turn is one of order 1 in space."""
    run = load(rotor, "speed", "joint.float.spin=['350 rad/s', '0 rad/s', '0 rad/s']")
    (k, c), ways = coefficients(350.0), ["rotor.centre.y", "rotor.centre.z"]
    found = linearise_scene(run, ways[:1], ways).frequency_response(np.full(1, 1e-3))[0, :, 0].real
    exact = 1.0 / (2 * k - MASS * 350.0**2 + 2j * c * 350.0)
    np.testing.assert_allclose(found, [exact.real, exact.imag], rtol=1e-4)


SPEEDS = [0, 100, 200, 250, 300, 600]
BY_SPEED = {
    "radial": f'{{ arguments = {SPEEDS}, values = [40, 32, 25, 22, 20, 12], unit = "MN/m" }}',
    "radial_damper": f'{{ arguments = {SPEEDS}, values = [4, 3.5, 3, 2.7, 2.5, 1.5], unit = "kN s/m" }}',
}


def test_a_shaft_whirls_as_ross_has_it(tmp_path: Path) -> None:
    """By ROSS 2.3.0, 20 elements, with each speed's row: between rows its tables follow a smoothing spline."""
    file = tmp_path / "shaft.toml"
    file.write_text(SHAFT)
    tables = [f"bearing.{at}.{key}={table}" for at in ("left", "right") for key, table in BY_SPEED.items()]
    vibrations = find_vibrations(Pipeline(load_scene(file, tables)))
    by_ross = {300.0: [423.05263582, 424.06209521], 600.0: [409.99025774, 411.7451845]}
    damping = {300.0: [0.00245507, 0.00248203], 600.0: [0.00377381, 0.0038493]}
    for rate, wd in by_ross.items():
        assert 2 * np.pi * vibrations(rate).frequencies_hz[:2] == pytest.approx(wd, rel=1e-6)
        assert vibrations(rate).damping[:2] == pytest.approx(damping[rate], rel=1e-4)


@pytest.mark.parametrize(("over", "order", "n_ends"), [("speed", -2.0, 0), ("whirl", -2.0, 4), ("whirl", 1.0, 0)])
def test_a_table_that_ends_below_what_is_reached_is_named(rotor: Path, over: str, order: float, n_ends: int) -> None:
    rates = np.array([500.0, 1000.0, 1500.0])
    found = compute_circular_response(load(rotor, over), "rotor.far", lambda rate: 1.0, rates, order)
    assert len(found.warnings) == n_ends
    for warning in found.warnings[:1]:
        assert warning["text"] == "bearing.near.radial ends at 19099 rpm of whirl: beyond, its last value holds"


CLOSED = "{ arguments = [0, 1, 2], values = [1, 2, 1], unit = 'N/m', beyond = 'repeat' }"


def test_what_a_table_cannot_be_is_said(rotor: Path) -> None:
    for over, change, said in (
        ("speed", "bearing.near.radial.unit='N s/m'", "isn't a unit of this; 'N/m' works"),
        ("speed", "bearing.near.radial.argument_unit='Hz'", "'rpm' works"),
        ("speed", "bearing.near.radial.values=[1, 0, 2]", "must be above 0"),
        ("speed", "bearing.near.radial.arguments=[-1, 0, 2]", "must be 0 or above"),
        ("speed", f"bearing.near.radial={CLOSED}", "must be 'hold'"),
        ("whirl", "simulation.duration='1 ms'", "known to fmd campbell and fmd unbalance"),
    ):
        with pytest.raises(InputError) as fault:
            _ = load(rotor, over, change).system
        assert said in str(fault.value)
    with pytest.raises(InputError, match="beside one over whirl"):
        find_vibrations(load(rotor, "whirl", "bearing.near.radial.over='speed'"))


def test_errors_are_stated_beside_tables_over_whirl(tmp_path: Path) -> None:
    file = tmp_path / "shaft.toml"
    file.write_text(SHAFT)
    rows = "{ over = 'whirl', arguments = [0, 600], values = [40, 12], unit = 'MN/m' }"
    coarse = ["body.rotor.mesh.size=100 mm", "body.rotor.modes.count=3"]
    run = Pipeline(load_scene(file, [f"bearing.left.radial={rows}", *coarse]))
    rates = np.array([0.0, 300.0])
    frequencies = np.array([find_vibrations(run)(rate).frequencies_hz[:2] for rate in rates])
    errors = estimate_frequency_errors(run, rates, frequencies)
    assert not isinstance(errors, str)
    assert (errors < 1e-2 * frequencies).all()
