"""Orbits of rotors by an unbalance and by forces that go round, against closed forms and critical speeds."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from fmd.cli.app import main
from fmd.core.errors import InputError
from fmd.output.campbell import compute_campbell, whirl_word
from fmd.output.unbalance import compute_circular_response
from fmd.responses.circular_forces import circular_response
from fmd.scene.scene import load_scene
from fmd.stages.pipeline import Pipeline

MASS, POLAR, ACROSS, ARM, RADIAL, DAMPER = 12.0, 0.09, 0.06, 0.2, 4e5, 150.0
RATES = np.linspace(20.0, 2000.0, 60)
RIGID = f"""
title = "Rigid rotor"

[body.rotor]
shape = "rigid"
mass = "{MASS} kg"
inertia = ["{POLAR} kg m^2", "{ACROSS} kg m^2", "{ACROSS} kg m^2"]

[body.rotor.marker]
centre = {{ at = ["0 m", "0 m", "0 m"] }}
near = {{ at = ["{-ARM} m", "0 m", "0 m"] }}
far = {{ at = ["{ARM} m", "0 m", "0 m"] }}
rim = {{ at = ["0 m", "0.1 m", "0 m"] }}

[ground.near]
at = ["{-ARM} m", "0 m", "0 m"]

[ground.far]
at = ["{ARM} m", "0 m", "0 m"]

[joint.float]
type = "free"
parent = "ground"
child = "rotor.centre"

[bearing.near]
between = ["ground.near", "rotor.near"]
axis = [1, 0, 0]
radial = "{RADIAL} N/m"
axial = "1e5 N/m"
radial_damper = "{DAMPER} N s/m"

[bearing.far]
between = ["ground.far", "rotor.far"]
axis = [1, 0, 0]
radial = "{RADIAL} N/m"
radial_damper = "{DAMPER} N s/m"

[simulation]
duration = "10 ms"
output_step = "1 ms"
tip = "rotor.far"

[[simulation.run]]
integrator = "auto"
"""


@pytest.fixture
def run(tmp_path: Path) -> Pipeline:
    file = tmp_path / "rigid.toml"
    file.write_text(RIGID)
    return Pipeline(load_scene(file))


@pytest.mark.parametrize(("order", "place"), [(1.0, "centre"), (-1.0, "far"), (2.0, "far"), (-0.5, "centre")])
def test_a_rigid_rotor_goes_round_as_its_equations_say(run: Pipeline, order: float, place: str) -> None:
    # As complex numbers, at ν = order Ω: z = F/(2k − m ν² + 2icν) of the centre, and the tilt θ by the force's arm
    # = F a/(2k a² − I_t ν² + I_p Ω ν + 2ic a² ν) (Genta, Dynamics of Rotating Systems, 2005, section 4.2).
    def force(rate: float) -> float:
        return 2e-4 * rate**2 if order == 1.0 else 5.0

    found = compute_circular_response(run, f"rotor.{place}", force, RATES, order)
    rates = found.rates
    assert {*RATES} <= {*rates}
    nu, arm, size = order * rates, {"centre": 0.0, "far": ARM}[place], np.array([force(rate) for rate in rates])
    shift = size / (2 * RADIAL - MASS * nu**2 + 2j * DAMPER * nu)
    tilt = size * arm / (2 * RADIAL * ARM**2 - ACROSS * nu**2 + POLAR * rates * nu + 2j * DAMPER * ARM**2 * nu)
    assert found.markers == ("rotor.near", "rotor.centre", "rotor.far")  # those on the axis
    exact = np.stack([shift - ARM * tilt, shift, shift + ARM * tilt], axis=1)
    assert found.displacement == pytest.approx(exact, rel=1e-9)
    assert found.against.max() < 1e-12 * np.abs(exact).max()


def test_the_critical_speed_of_a_jeffcott_rotor_and_its_amplification(run: Pipeline) -> None:
    # |z| = U Ω²/|2k − mΩ² + 2icΩ| is largest at ω₀/√(1 − 2ζ²), where it is U/m / (2ζ √(1 − ζ²)).
    found = compute_circular_response(run, "rotor.centre", lambda rate: 2e-4 * rate**2, RATES)
    assert {at.marker for at in found.criticals} == {"rotor.near", "rotor.centre", "rotor.far"}
    omega, zeta = np.sqrt(2 * RADIAL / MASS), DAMPER / np.sqrt(2 * RADIAL * MASS)
    for at in found.criticals:
        assert at.rate == pytest.approx(omega / np.sqrt(1 - 2 * zeta**2), rel=1e-6)
        assert at.amplitude == pytest.approx(2e-4 / MASS / (2 * zeta * np.sqrt(1 - zeta**2)), rel=1e-9)
        # r⁴/((1 − r²)² + 4ζ²r²) is half of its largest value where r⁻² = 1 − 2ζ² ± 2ζ √(1 − ζ²).
        sides = 1 / np.sqrt(1 - 2 * zeta**2 + np.array([1, -1]) * 2 * zeta * np.sqrt(1 - zeta**2))
        assert at.amplification == pytest.approx(1 / np.sqrt(1 - 2 * zeta**2) / np.ptp(sides), rel=1e-5)
    few = omega * np.array([0.5, 0.99, 1.0, 1.001])  # up to where less than half of the peak's power is gone
    cut = compute_circular_response(run, "rotor.centre", lambda rate: 1.0, few)
    assert cut.criticals
    assert all(np.isnan(at.amplification) for at in cut.criticals)
    assert all(row["amplification"] is None for row in cut.critical_rows())


SHAFT = """
title = "Shaft with a disc"

[body.rotor]
shape = "shaft"
segment = [{ length = "1 m", diameter = "50 mm" }]
station = { disc = "600 mm" }
E = "200 GPa"
nu = 0.3
rho = "7800 kg/m^3"
mesh = { size = "25 mm" }
modes = { count = 8 }
link.disc = { face = "disc", type = "rigid" }
mass.disc = { at = "disc", mass = "8 kg", inertia = ["0.05 kg m^2", "0.03 kg m^2", "0.03 kg m^2"] }
marker = { left = { face = "x-" }, right = { face = "x+" }, disc = { link = "disc" } }

[ground.left]
at = ["0 m", "0 m", "0 m"]

[ground.right]
at = ["1 m", "0 m", "0 m"]

[joint.float]
type = "free"
parent = "ground"
child = "rotor.left"

[bearing.left]
between = ["ground.left", "rotor.left"]
axis = [1, 0, 0]
radial = "2e7 N/m"
axial = "1e7 N/m"
radial_damper = "2000 N s/m"

[bearing.right]
between = ["ground.right", "rotor.right"]
axis = [1, 0, 0]
radial = "2e7 N/m"
radial_damper = "2000 N s/m"

[simulation]
duration = "10 ms"
output_step = "1 ms"
tip = "rotor.disc"
run = [{ integrator = "auto" }]
"""


def test_a_shaft_with_a_disc_goes_round_as_ross_has_it(tmp_path: Path) -> None:
    """Orbits by ROSS 2.3.0: twenty Timoshenko elements of 50 mm, the disc at node 12, an unbalance of 1e-4 kg m."""
    file = tmp_path / "shaft.toml"
    file.write_text(SHAFT)
    rates = np.array([100.0, 200.0, 250.0, 300.0, 600.0])
    found = compute_circular_response(Pipeline(load_scene(file)), "rotor.disc", lambda rate: 1e-4 * rate**2, rates)
    at = np.searchsorted(found.rates, rates)
    disc = found.displacement[at, found.markers.index("rotor.disc")]
    by_ross = np.array([3.6056181723e-7, 1.74860555371e-6, 3.25158834002e-6, 6.10420631093e-6, 1.20199326868e-5])
    assert np.abs(disc) == pytest.approx(by_ross, rel=1e-5)
    assert np.angle(disc) == pytest.approx(
        [-8.172256e-4, -2.0537516e-3, -3.1388864e-3, -5.0766247e-3, -3.1345677], abs=1e-6
    )


@pytest.mark.long
def test_the_published_rotor_is_critical_where_its_forward_whirl_meets_the_speed() -> None:
    # Lightly damped, the largest orbit is beside the damped frequency by the square of the damping ratio, 1e-4 here.
    light = [f"bearing.{name}.radial_damper=2 N s/m" for name in ("near", "far")]
    rotor = Pipeline(load_scene("rotor", light))
    rates = np.linspace(20.0, 420.0, 201)
    found = compute_circular_response(rotor, "wheel.centre", lambda rate: 5e-4 * rate**2, rates)
    crossings = compute_campbell(rotor, rates, [1.0]).crossings
    forward = [at for at in crossings if whirl_word(at.whirl) == "forward"]
    assert len(found.markers) == 4  # of those in one place, the one with the unbalance, or the first
    peaks = [at.rate for at in found.criticals if at.marker == "wheel.centre"]
    assert len(peaks) >= 2
    for peak in peaks[:2]:
        nearest = min(forward, key=lambda at: abs(at.rate - peak))
        assert peak == pytest.approx(nearest.rate, rel=1e-3)


def test_the_command_writes_orbits_and_critical_speeds(tmp_path: Path, fmd, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "rigid.toml"
    file.write_text(RIGID)
    words = ["unbalance", str(file), "--at", "rotor.centre", "--to", "6000 rpm", "--points", "120"]
    assert fmd(*words, "--of", "200 g mm", "--out", tmp_path / "out", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["files"] == ["unbalance.png", "unbalance.csv", "criticals.csv"]
    assert all((tmp_path / "out" / name).stat().st_size > 100 for name in found["files"])
    with (tmp_path / "out" / "unbalance.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert len(rows) >= 120
    assert float(rows[-1]["rotor.centre.phase_deg"]) == pytest.approx(
        -180.0, abs=5.0
    )  # far above, it lags by half a turn
    assert found["criticals"][0]["speed_rpm"] == pytest.approx(found["criticals"][0]["rate_rad_s"] * 30 / np.pi)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--at", "rotor.rum", "--of", "1 g mm"], "is no marker; the markers: rotor.centre"),
        (["--at", "rotor.rim", "--of", "1 g"], "must be an unbalance such as '500 g mm'"),
        (["--at", "rotor.rim"], "give an unbalance"),
        (["--at", "rotor.rim", "--of", "1 g mm", "--order", "2"], "an unbalance goes round with the rotor"),
    ],
)
def test_what_the_command_cannot_take_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    file = tmp_path / "rigid.toml"
    file.write_text(RIGID)
    with pytest.raises(SystemExit) as ended:
        main(["unbalance", str(file), "--to", "6000 rpm", *words])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


def test_what_turns_on_a_hub_is_refused() -> None:
    with pytest.raises(InputError, match="isn't a rotor in bearings"):
        compute_circular_response(Pipeline(load_scene("hinged-rotor")), "a.b", lambda rate: 1.0, RATES)


@pytest.mark.parametrize("held", [0.0, 1e-5, 1e-4, 1e-3])
def test_a_free_turn_that_a_mesh_out_of_round_holds_a_little_takes_no_part(held: float) -> None:
    """An unbalance doesn't turn a rotor: as on a shaft that can't turn, whatever little stiffness the turn gets."""
    K = np.diag([4e10, 3e4, 3e4, held])
    K[3, 1:3] = K[1:3, 3] = 0.3 * np.sqrt(held)
    A = np.block([[np.zeros((4, 4)), np.eye(4)], [-K, -np.diag([1.0, 2.0, 2.0, 0.0])]])
    B = np.concatenate([np.zeros((4, 2)), [[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1e-3, 0.0]]])
    C = np.eye(8)[1:2], np.eye(8)[2:3]
    moved, against = circular_response(A, B, C, 0.0)
    assert abs(moved[0]) == pytest.approx(1.0 / 3e4, rel=1e-6)
    assert against[0] == 0.0


@pytest.mark.parametrize(("omega", "zeta"), [(10.0, 1e-2), (100.0, 1e-4), (1e3, 1e-6)])
def test_a_lightly_damped_critical_rate_keeps_its_peak_beside_fast_vibrations(omega: float, zeta: float) -> None:
    """A Jeffcott rotor at its critical rate is moved by 1/(2 ζ ω²), whatever vibrates at 10⁷ rad/s beside it."""
    turn, damper = np.array([[0.0, -1.0], [1.0, 0.0]]), 2.0 * zeta * omega
    K, D, nothing = np.diag([0.0, 0.0, 1e14, 1e14]), np.zeros((4, 4)), np.zeros((4, 4))
    K[:2, :2] += damper * omega * turn
    D[:2, :2] = damper * np.eye(2) + 2.0 * omega * turn
    D[2:, 2:] = 1e4 * np.eye(2) + 2.0 * omega * turn
    A = np.block([[nothing, np.eye(4)], [-K, -D]])
    B = np.concatenate([np.zeros((4, 2)), np.eye(2), np.eye(2)])
    moved, _ = circular_response(A, B, (np.eye(8)[:1], np.eye(8)[1:2]), 0.0)
    assert abs(moved[0]) == pytest.approx(1.0 / (2.0 * zeta * omega**2), rel=1e-6)
