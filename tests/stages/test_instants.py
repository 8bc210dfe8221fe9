"""Instants of shocks between output times: stress there is that of a march whose output times are its steps."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.missed_peaks import stress_variable
from fmd.core.cache import Cache
from fmd.core.limits.contact import SHOCK_TIMES
from fmd.output.instants import choose_instants
from fmd.output.pictures import draw_film, draw_stress
from fmd.output.report.view3d import collect_view
from fmd.output.stress_fields import fatigue_law, find_fatigue
from fmd.output.stress_warnings import output_time_warnings, vibration_warnings
from fmd.output.summary import summarise
from fmd.recovery.fatigue import fatigue_by_signed_von_mises
from fmd.recovery.motion import Motion
from fmd.render.camera import Camera
from fmd.scene.pictures import Film, StressPicture
from fmd.scene.stress_outputs import Fatigue
from fmd.stages.instants import find_shock_times
from fmd.stages.other_motions import with_motions
from tests.contact.test_contact_points import BLOCK
from tests.output.test_histories import SCENE

SN = 'sn={amplitude="1 MPa", cycles=1e6, slope=5.0}'
FATIGUE = f'output=[{{type="fatigue", file="life.csv", body="plate", count=5, stress="signed von Mises", {SN}}}]'


def drop(output_step: str, *overrides: str) -> Pipeline:
    shorter = 'simulation.duration="32.5 ms"', f'simulation.output_step="{output_step}"'
    return Pipeline(load_scene("drop", [*shorter, *overrides]))


@pytest.fixture(scope="module")
def coarse() -> Pipeline:
    return drop("1 ms", FATIGUE)


@pytest.fixture(scope="module")
def at_steps(coarse: Pipeline) -> Pipeline:
    """The same march with its steps as output times."""
    return drop(f"{coarse.motion.trajectory.step!r} s", FATIGUE)


def test_the_largest_stress_of_a_shock_is_that_at_any_step(coarse: Pipeline, at_steps: Pipeline) -> None:
    assert at_steps.at_instants is at_steps  # nothing is between its output times
    time, node, value = at_steps.stress_of("plate").worst()
    assert coarse.stress_of("plate").worst() == (pytest.approx(time, rel=1e-12), node, pytest.approx(value, rel=1e-7))
    assert coarse.stress_of("plate", coarse.motion).worst()[2] < 0.5 * value  # at the output times alone
    own, fine = coarse.envelope_of("plate"), at_steps.envelope_of("plate")
    assert own.von_mises.max() == pytest.approx(fine.von_mises.max(), rel=1e-7)
    assert own.principal_3.min() == pytest.approx(fine.principal_3.min(), rel=1e-7)


def to_last_output(coarse: Pipeline, at_steps: Pipeline) -> Pipeline:
    """Return the run whose outputs are steps up to the last output time of the other one."""
    ((label, motion),) = at_steps.motions.items()
    stop = int(np.searchsorted(motion.times, coarse.motion.times[-1] * (1 + 1e-12)))
    return with_motions(at_steps, {label: motion.part(0, stop)})


def test_fatigue_counts_the_cycle_of_a_shock(coarse: Pipeline, at_steps: Pipeline) -> None:
    """What rings on afterwards counts, too, to what twenty-four instants to a period leave."""
    (output,) = coarse.scene.output
    assert isinstance(output, Fatigue)
    found, exact = (find_fatigue(run, output).damage.max() for run in (coarse, to_last_output(coarse, at_steps)))
    assert found == pytest.approx(exact, rel=0.02)
    outputs = fatigue_by_signed_von_mises(coarse.stress_of("plate", coarse.motion), fatigue_law(output), 5, 1.0)
    assert outputs.damage.max() < 0.02 * exact


def test_instants_have_the_state_of_the_same_march_and_its_largest_force(coarse: Pipeline, at_steps: Pipeline) -> None:
    motion, floor = coarse.at_instants.motion, coarse.motion.contacts["floor"]
    force = np.linalg.norm(motion.contacts["floor"].force, axis=1)
    assert force.max() == pytest.approx(floor.largest[0], rel=1e-9)
    assert motion.times[force.argmax()] == pytest.approx(floor.tops_at[floor.tops[:, 0].argmax(), 0], rel=1e-12)
    assert len(motion.times) <= len(coarse.motion.times) + SHOCK_TIMES + 2
    fine, at = at_steps.motion, np.searchsorted(at_steps.motion.times, motion.times * (1 - 1e-12))
    steps = np.flatnonzero(np.abs(fine.times[at] - motion.times) < 1e-12)
    assert len(steps) > 200
    apart = motion.trajectory.q[steps] - fine.trajectory.q[at[steps]]
    assert np.abs(apart).max() < 1e-9 * np.abs(fine.trajectory.q).max()


@pytest.mark.parametrize(
    ("method", "apart"), [('integrator="runge-kutta"', 1e-3), ('integrator="sub-cycling", substeps=8', 1e-6)]
)
def test_shocks_are_met_by_methods_that_choose_or_divide_their_steps(method: str, apart: float) -> None:
    """Where steps are chosen round-off grows: tolerances from 1e-6 to 1e-9 have largest forces 1e-4 apart."""
    tilted = 'joint.free.rotate=["2 deg", "0 deg", "3 deg"]'
    run = Pipeline(load_scene(BLOCK, [tilted, f"simulation.run=[{{{method}}}]"]))
    floor, found = run.motion.contacts["floor"], run.at_instants.motion.contacts["floor"]
    assert np.linalg.norm(floor.force, axis=1).max() < 0.9 * floor.largest[0]
    assert np.linalg.norm(found.force, axis=1).max() == pytest.approx(floor.largest[0], rel=apart)


def test_long_marches_are_made_again_for_their_shocks_alone(coarse: Pipeline, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmd.stages.plan.LONG_AGAIN", 0.0)
    monkeypatch.setattr(Motion, "tip_size", property(lambda motion: 0.0 * motion.times))  # as of a rigid body's tip
    run = drop("1 ms")
    assert len(run.fine_motion.times) == len(run.at_instants.motion.times) > len(run.motion.times)
    assert run.stress_of("plate").worst()[2] == pytest.approx(coarse.stress_of("plate").worst()[2], rel=1e-9)


def test_pictures_films_and_the_report_show_the_instant_of_the_shock(
    coarse: Pipeline, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fmd.stages.plan.LONG_AGAIN", np.inf)  # however busy the machine is
    drawn: list[tuple[Any, ...]] = []

    def keep(name: str, *shown: Any, **words: Any) -> None:
        drawn.append((shown, words))

    time, _, value = coarse.stress_of("plate").worst()
    draw_stress(coarse, StressPicture(type="stress", file="stress.png"), tmp_path, keep)
    draw_film(coarse, Film(type="film", file="film.mp4", frames=5), tmp_path, keep)
    ((_, deformation, stress, _), words), ((moving, _), of_film) = drawn
    assert stress.max() == pytest.approx(value, rel=1e-12)
    assert f"t = {1e3 * time:.6g} ms" in words["title"]
    assert np.abs(deformation).max() > 0.0
    assert len(moving.times) == 6
    assert time in moving.times
    clocks = [moving.clock(frame).rpartition("= ")[2] for frame in range(6)]
    assert clocks == ["0 ms", "8 ms", "16 ms", "24 ms", f"{1e3 * time:.1f} ms", "32.0 ms"]
    assert np.max(of_film["clim_pa"]) == pytest.approx(value, rel=1e-12)
    view = collect_view(coarse, 1.0, Camera())
    assert view["worst"] == {"body": "plate", "time": time, "largest": pytest.approx(1e-6 * value)}
    summary = summarise(coarse, [], budget=False)
    assert summary["worst_stress"]["plate"]["value_pa"] == value
    assert summary["worst_stress"]["plate"]["time_s"] == time
    assert not [own for own in summary["warnings"] if own["code"] == "coarse-output-times"]


def test_a_shock_whose_instants_are_known_is_no_missed_peak(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stress of the finer march has what the contact deforms beside the modes, as that of the instants has."""
    monkeypatch.setattr("fmd.stages.plan.LONG_AGAIN", np.inf)
    run = drop("20 us")
    time, node, value = run.stress_of("plate").worst()
    fine = run.fine_motion
    finer = stress_variable(run, "plate", node, fine).values
    assert finer[np.abs(fine.times - time).argmin()] == pytest.approx(value, rel=1e-6)
    assert output_time_warnings(run, {"plate": node}) == []


BARE = SCENE.partition("[[output]]")[0]
SPRUNG = (
    "joint.hinge.spring='4000 N m'",
    "joint.hinge.damper='0 N m s'",
    "simulation.duration='64 ms'",
    FATIGUE.replace("plate", "bar").replace('"1 MPa"', '"40 MPa"'),
)


def sprung(folder: Path, output_step: str) -> Pipeline:
    """Return the stages of a bar without contacts that swings on a stiff spring in some 7 ms."""
    (file := folder / "scene.toml").write_text(BARE)
    return Pipeline(load_scene(file, [*SPRUNG, f"simulation.output_step='{output_step}'"]), Cache(None))


def test_fatigue_counts_what_swings_between_output_times_without_contacts(tmp_path: Path) -> None:
    swinging, exact = sprung(tmp_path, "9 ms"), sprung(tmp_path, "0.02 ms")
    (output,) = exact.scene.output
    assert isinstance(output, Fatigue)
    damage = [find_fatigue(run, output).damage.max() for run in (swinging, exact)]
    assert damage[0] == pytest.approx(damage[1], rel=0.03)
    outputs = fatigue_by_signed_von_mises(swinging.stress_of("bar"), fatigue_law(output), 5, 1.0)
    assert outputs.damage.max() < 0.9 * damage[1]


def test_vibrations_that_fatigue_leaves_out_are_warned_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmd.stages.instants.VIBRATION_TIMES", 100)
    run = sprung(tmp_path, "9 ms")
    (warning,) = vibration_warnings(run)
    assert len(run.at_vibrations.motion.times) <= len(run.motion.times) + 100
    (step,) = re.findall(r"output_step = '([^']+)'", warning["text"])
    assert vibration_warnings(sprung(tmp_path, step)) == []


def test_shocks_in_more_intervals_than_have_instants_are_the_largest(
    coarse: Pipeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fmd.stages.instants.SHOCK_TIMES", 2)
    times = find_shock_times(coarse.motion)
    assert 0 < len(times) <= 4
    at = np.searchsorted(coarse.motion.times, times)
    assert np.unique(at).tolist() == [int(coarse.motion.contacts["floor"].tops[:, 0].argmax())]


def test_without_contacts_instants_are_the_output_times() -> None:
    run = Pipeline(load_scene("beam"))
    assert run.at_instants is run
    assert choose_instants(run, 5, ["beam"]).tolist() == [0, 250, 500, 750, 1000]
