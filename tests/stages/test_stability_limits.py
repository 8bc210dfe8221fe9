"""Limits of scenes' own mechanisms: real marches live below them and diverge above them."""

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import StabilityError
from fmd.core.limits.stability import ALLOWED_GROWTH
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import Integrator
from fmd.integrators.subcycling import Subcycling
from fmd.stability.limits import explicit_method
from fmd.stability.operating_points import settle
from fmd.stability.tangent import OperatingPoint
from fmd.stages.stability_limits import find_scene_limits

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("m", [1, 2, 5, 20])
@pytest.mark.parametrize(
    ("name", "still"), [("rod-slider", "drive.motor.torque=0 N m"), ("beam", "drive.spin_up.speed=0 rad/s")]
)
def test_marches_live_below_the_limit_and_diverge_above_it(name: str, still: str, m: int) -> None:
    """Small motions about the reference state, which the limits are those of; nothing drives the mechanism."""
    run = Pipeline(load_scene(name, [still]))
    (row,) = find_scene_limits(run, [m], along=False).limits
    limit = row.critical_step
    assert row.sudden_step == pytest.approx(limit, rel=1e-3)
    system = run.system
    q0, v0 = np.full(system.n, 1e-6), np.zeros(system.n)
    method = CentralDifference if m == 1 else lambda step: Subcycling(step, m)
    steps = 20_000
    lives = method(0.98 * limit).march(system, q0, v0, np.array([steps * 0.98 * limit]))
    assert np.abs(lives.q).max() < 1e4
    with pytest.raises(StabilityError):
        method(1.02 * limit).march(system, q0, v0, np.array([steps * 1.02 * limit]))


def grown(method: Integrator, run: Pipeline) -> float:
    """Factor by which a march makes small vibrations about the scene's own motion grow, first tenth to last.

    Two marches that differ by a millionth: what they differ by is a small vibration, in the norm of its energy.
    """
    system, times = run.system, np.linspace(0.0, run.scene.simulation.duration, 4001)
    fast = np.arange(system.n_slow, system.n)
    (at,) = settle(system, [OperatingPoint(0.0, *run.start)], fast)
    moved = at.q.copy()
    moved[fast] += 1e-6
    one, other = (method.march(system, q, at.v, times) for q in (at.q, moved))
    squares = (other.v - one.v)[:, fast] ** 2 + system.stiffness[fast] * (other.q - one.q)[:, fast] ** 2
    energy = squares.sum(axis=1)
    return float(np.sqrt(energy[-400:].max() / energy[:400].max()))


def folds_of_slider(method: Integrator, run: Pipeline) -> float:
    """E-folds of a small vibration of the slider over the whole drive, by two marches that differ by 1e-7 m.

    Its energy is averaged over one and a half periods; a polynomial through its logarithm goes on to both ends.
    """
    system, duration = run.system, run.scene.simulation.duration
    (at,) = settle(system, [OperatingPoint(0.0, *run.start)], np.array([1]))
    cycle = getattr(method, "substeps", 1) * method.step
    times = np.arange(0.0, duration, cycle / max(1, round(cycle / 0.02)))
    one, other = (method.march(system, at.q + np.array([0.0, x]), at.v, times) for x in (0.0, 1e-7))
    energy = (200 - one.v[:, 0] ** 2) * (other.q - one.q)[:, 1] ** 2 + (other.v - one.v)[:, 1] ** 2
    window = round(3 * np.pi / np.sqrt(200) / times[1])
    logarithm = 0.5 * np.log(np.convolve(energy, np.ones(window) / window, "valid"))
    along = np.polynomial.Polynomial.fit(times[: len(logarithm)] + times[window - 1] / 2, logarithm, 4)
    return float(along(duration) - along(0.0))


@pytest.mark.parametrize("m", [1, 2, 3, 5, 10])
def test_the_limit_along_the_rod_sliders_own_drive_is_that_of_real_marches(m: int) -> None:
    """What a cycle holds of the centrifugal force feeds the slider; the reference state knows nothing of it.

    E-folds grow faster than the step, so that 3 % of them are less than 3 % of the step.
    """
    run = Pipeline(load_scene("rod-slider"))
    (along,) = find_scene_limits(run, [m], along=True).limits
    assert along.critical_step < 0.6 * 2 / np.sqrt(200)
    assert along.worst_time > 5.0  # the rod turns faster and faster
    assert folds_of_slider(explicit_method(along.critical_step, m), run) == pytest.approx(
        np.log(ALLOWED_GROWTH), rel=0.03
    )


def test_far_above_the_limit_along_its_drive_the_slider_diverges_below_the_limit_at_rest() -> None:
    run = Pipeline(load_scene("rod-slider"))
    assert find_scene_limits(run, [5], along=False).limits[0].sudden_step > 0.14
    with pytest.raises(StabilityError):
        Subcycling(0.138, 5).march(run.system, *run.start, np.linspace(0.0, 10.0, 11))


@pytest.mark.parametrize("m", [1, 5])
def test_the_limit_along_the_beams_own_drive_is_sharp(m: int) -> None:
    run = Pipeline(load_scene("beam-paper"))
    limit = find_scene_limits(run, [m], along=True).limits[0].critical_step
    assert limit == pytest.approx(2 / run.body.omega.max(), rel=1e-3)
    assert grown(explicit_method(0.98 * limit, m), run) < ALLOWED_GROWTH
    with pytest.raises(StabilityError):
        explicit_method(1.02 * limit, m).march(run.system, *run.start, np.linspace(0.0, 0.5, 11))


def test_dampers_shorten_the_arms_step() -> None:
    """They take the rate that is predicted from half a step before: 4.9 % less than 2/ω."""
    run = Pipeline(load_scene("arm", ["body.forearm.modes.enrich=none", "simulation.duration=0.2 s"]))
    rest, along = (find_scene_limits(run, [1], along=flag).limits[0].critical_step for flag in (False, True))
    assert along <= rest < 0.96 * 2 / run.system.highest_frequency
    with pytest.raises(StabilityError):
        CentralDifference(1.02 * rest).march(run.system, *run.start, np.array([0.2]))
    found = CentralDifference(0.98 * along).march(run.system, *run.start, np.linspace(0.0, 0.2, 11))
    assert np.abs(found.q).max() < 3
