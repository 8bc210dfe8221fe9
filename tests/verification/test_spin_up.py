"""Spin-up of a slender beam on a hub whose angle is prescribed, from the ready scene; flapping on a turning hub.

Kane, Ryan & Banerjee, J Guidance 10 (1987) 139-151; Simo & Vu-Quoc, J Appl Mech 53 (1986) 849-863. Rows of frequencies
over speed: Wright, Smith, Thresher & Wang, J Appl Mech 49 (1982) 197-202.
"""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.runge_kutta import RungeKutta
from fmd.recovery.motion import Motion
from fmd.stages.mechanism import build_mechanism, find_start
from tests.tasks import Tasks

pytestmark = pytest.mark.slow

EA, EI, MU, LENGTH = 2.8e7, 1.4e4, 1.2, 10.0  # N, N m², kg/m, m
STEPS = ('simulation.run.0.integrator="generalized-alpha"', 'simulation.step="5 ms"')


def hub_rate(t: Array) -> Array:
    """Rate of the hub, the formula of Kane et al. [rad/s]."""
    return np.where(t < 15, 6 / 15 * (t - 15 / (2 * np.pi) * np.sin(2 * np.pi * t / 15)), 6.0)


@pytest.fixture(scope="module")
def motion() -> Motion:
    return Pipeline(load_scene("spin-up", STEPS)).motion


def test_the_hub_turns_as_prescribed(motion: Motion) -> None:
    assert motion.joint_rate("hub") == pytest.approx(hub_rate(motion.times), abs=1e-12)
    assert motion.joint_position("hub")[-1] == pytest.approx(6 * 20 - 45, abs=1e-12)


def test_the_tip_lags_as_far_as_in_the_literature(motion: Motion) -> None:
    across = motion.tip_deflection[:, 1]
    late = np.abs(across).argmax()
    assert across[late] == pytest.approx(-0.574, rel=0.02)  # behind the hub
    assert motion.times[late] == pytest.approx(6.77, abs=0.1)


def test_the_tip_does_not_leave_the_plane(motion: Motion) -> None:
    assert motion.tip_deflection[:, 2] == pytest.approx(np.zeros(motion.times.size), abs=1e-8)


def test_the_turning_beam_is_stretched_by_its_own_pull(motion: Motion) -> None:
    # ∫∫ μ Ω² x/EA dx dx = μ Ω² L³/(3 EA) = 5.14e-4 m; the vibration that the spin-up leaves has no mean.
    steady = motion.times >= 15
    want = MU * 6**2 * LENGTH**3 / (3 * EA)
    assert want == pytest.approx(5.14e-4, rel=1e-3)
    assert motion.tip_deflection[steady, 0].mean() == pytest.approx(want, rel=0.05)
    assert np.abs(motion.tip_deflection[steady, 1]).max() < 0.02  # the lag has gone


def test_without_stiffening_the_scene_is_refused_before_anything_is_integrated() -> None:
    # From Ω² = k/m on, the first mode, 3.516 √(EI/μL⁴) = 3.798 rad/s, has no stiffness left in the plane of rotation.
    scene, tasks = load_scene("spin-up", [*STEPS, "simulation.stiffening=off"]), Tasks()
    run = Pipeline(scene, monitor=tasks)
    with pytest.raises(InputError, match=r"simulation\.stiffening.*'beam' would diverge.* 6 rad/s.*3\.798 rad/s"):
        _ = run.motions
    assert not tasks.began_a_run(scene)
    run = Pipeline(load_scene("spin-up", STEPS))
    assert run.stiffening_loads["beam"].critical_rate == pytest.approx(3.51602 * np.sqrt(EI / MU) / LENGTH**2, rel=1e-3)
    assert run.stiffening_loads["beam"].stiffened


def test_without_stiffening_the_tip_would_leave() -> None:
    # In the plane ÿ = (Ω² − ω₁²) y + …: past the critical rate it grows as exp ∫ √(Ω² − ω₁²) dt, here by e^3.4 in 1 s.
    run = Pipeline(load_scene("spin-up", STEPS))
    body = run.parts["beam"].body
    system = CompiledSystem(build_mechanism(run.scene, {"beam": body}))
    times = np.array([0.0, 6.76, 10.0, 11.0])
    march = RungeKutta(1e-9).march(system, *find_start(run.scene, system), times)
    lag = np.abs(march.q @ body.markers["tip"].translation[1])
    assert lag[1] > 1.5 * 0.574
    assert lag[2:].min() > LENGTH
    fine = np.linspace(10.0, 11.0, 101)
    growth = np.trapezoid(np.sqrt(hub_rate(fine) ** 2 - body.omega[0] ** 2), fine)
    assert np.log(lag[3] / lag[2]) == pytest.approx(growth, rel=0.1)


# Frequencies on the turning hub ----------------------------------------------------------------------------------

FLAP = {0: 3.5160, 2: 4.1373, 4: 5.5850, 6: 7.3604, 8: 9.2568, 10: 11.2023, 12: 13.1702}
ACROSS = ("--set", 'body.beam.modes.family="out-of-plane bending"')


@pytest.mark.parametrize(("eta", "mu"), FLAP.items())
def test_flapping_and_lagging_stiffen_with_speed_as_in_the_literature(
    fmd: Callable[..., int], eta: float, mu: float, capsys: pytest.CaptureFixture[str]
) -> None:
    # η = Ω √(μL⁴/EI) = 0.925820 s Ω, and so for the frequency.
    scale = np.sqrt(MU * LENGTH**4 / EI)
    assert scale == pytest.approx(0.925820, rel=1e-6)

    def lowest(*options: str) -> Array:
        assert fmd("modes", "spin-up", "--speed", f"{eta / scale:.9g} rad/s", *options, "--json") == 0
        result = json.loads(capsys.readouterr().out)
        assert result["speed_rad_s"] == pytest.approx(eta / scale, rel=1e-8)
        return 2 * np.pi * scale * np.array(result["rotating_frequencies_hz"])

    # In the plane of rotation the centrifugal load softens: √(flap² − Ω²) for a slender beam of square section.
    lag = np.sqrt(mu**2 - eta**2)
    assert lowest()[0] == pytest.approx(lag, rel=5e-3)
    # With modes across the plane, the enrichment's answer to the hub's acceleration is the one shape in it: by
    # Rayleigh's principle its frequency comes out too high.
    across = lowest(*ACROSS)
    assert across[1] == pytest.approx(mu, rel=5e-3)
    assert 0.995 * lag < across[0] < 1.03 * lag


def test_a_campbell_diagram_is_a_table_and_a_chart_and_begins_with_the_modes(
    fmd: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fmd("campbell", "spin-up", "--to", "10 rad/s", "--points", "3", "--out", str(tmp_path), "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["files"] == ["campbell.csv", "campbell.png"]
    assert (tmp_path / "campbell.png").stat().st_size > 10_000
    with (tmp_path / "campbell.csv").open(newline="") as file:
        header, *rows = list(csv.reader(file))
    assert header[:2] == ["rate_rad_s", "mode_1_hz"]
    table = np.array(rows, dtype=float)
    assert table[:, 0] == pytest.approx(np.linspace(0.0, 10.0, 3), rel=1e-5)
    assert fmd("modes", "spin-up", "--json") == 0
    modes = json.loads(capsys.readouterr().out)["frequencies_hz"]
    assert len(modes) == 4
    assert table[0, 1:5] == pytest.approx(modes, rel=1e-6)  # beyond them are what the enrichment adds
    printed_rows = np.array([row["frequency_hz"][0] for row in printed["rows"]])
    assert table[:, 1] == pytest.approx(printed_rows, rel=1e-7)
    assert (np.diff(table[:, 1]) > 0).all()
