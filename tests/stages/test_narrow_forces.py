"""Forces that change over a short way are never passed unseen: each method against the work of the force."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmd import Pipeline, load_scene
from fmd.core.errors import StabilityError
from fmd.dynamics.compiler.compiled import compile_mechanism
from tests.stages.sliding_block import sliding_block

COIL = """[spring.coil]
between = ["ground.wall", "block.centre"]
length = "1 m"
"""
ADAPTIVE = """{ integrator = "auto" }, { integrator = "runge-kutta", tolerance = 1e-6 },
    { integrator = "exponential-rosenbrock", tolerance = 1e-6 }, { integrator = "Radau", tolerance = 1e-6 },
    { integrator = "LSODA", tolerance = 1e-8 }"""
TOP = 0.25 / 2e-4 / np.sqrt(np.pi)
# Each takes a quarter of the block's energy of 1 J.
HUMPS = {
    "a smooth one": f'force = {{ formula = "{TOP}*exp(-((x-0.3337)/0.0002)**2)", unit = "N" }}',
    "a table": 'force = { elongations = ["0 m", "333.7 mm", "333.9 mm", "334.1 mm", "1 m"], '
    'values = [0, 0, 1250, 0, 0], unit = "N" }',
    "two jumps": 'force = { formula = "0 if x < 0.3337 else 1250 if x < 0.3339 else 0", unit = "N" }',
}


def block(folder: Path, law: str, run: str, *settings: str) -> Pipeline:
    """Return a block of 2 kg that slides at 1 m/s, pulled by a spring."""
    file = folder / "block.toml"
    file.write_text(sliding_block(run, 'rate = "1 m/s"', COIL + law))
    return Pipeline(load_scene(file, list(settings)))


@pytest.mark.parametrize("hump", HUMPS)
def test_a_narrow_hump_takes_its_work_by_every_adaptive_method(tmp_path: Path, hump: str) -> None:
    for label, motion in block(tmp_path, HUMPS[hump], ADAPTIVE).motions.items():
        assert motion.joint_rate("slide")[-1] == pytest.approx(np.sqrt(0.75), rel=2e-4), label


@pytest.mark.parametrize("hump", HUMPS)
def test_the_potential_energy_of_a_narrow_hump_is_its_work(tmp_path: Path, hump: str) -> None:
    run = block(tmp_path, HUMPS[hump], '{ integrator = "runge-kutta", tolerance = 1e-9 }')
    kinetic, potential = run.motion.energies
    assert potential[-1] - potential[0] == pytest.approx(0.25, rel=1e-3)
    assert kinetic + potential == pytest.approx(kinetic[0] + potential[0], rel=1e-5)
    compiled = compile_mechanism(run.mechanism)
    for k in (0, 20, 34, 50, -1):
        q, v = run.motion.trajectory.q[k], run.motion.trajectory.v[k]
        assert compiled.energies(0.0, q, v) == pytest.approx((kinetic[k], potential[k]), rel=1e-8)


@pytest.mark.parametrize(
    ("method", "hump"),
    [("central-difference", "a smooth one"), ("generalized-alpha", "two jumps"), ("exponential", "a smooth one")],
)
def test_a_fixed_step_that_would_pass_a_hump_is_refused_with_one_that_works(
    tmp_path: Path, method: str, hump: str
) -> None:
    run = f"{{ integrator = '{method}' }}"
    with pytest.raises(StabilityError, match=r"miss \d+% of the work of spring coil.* changes too fast at") as refused:
        _ = block(tmp_path, HUMPS[hump], run, "simulation.step=2 ms").motion
    step = re.search(r"a step of (\S+) s works", str(refused.value))
    assert step is not None
    motion = block(tmp_path, HUMPS[hump], run, f"simulation.step={step[1]} s").motion
    assert motion.joint_rate("slide")[-1] == pytest.approx(np.sqrt(0.75), rel=0.02)


def test_a_cycle_that_would_pass_a_hump_is_refused(tmp_path: Path) -> None:
    run = "{ integrator = 'sub-cycling', substeps = 4 }"
    with pytest.raises(StabilityError, match=r"steps of 0\.0005 s, which freeze forces over 4 steps, miss"):
        _ = block(tmp_path, HUMPS["a smooth one"], run, "simulation.step=0.5 ms").motion


def test_a_block_that_flies_past_a_small_hard_ball_is_thrown_aside(tmp_path: Path) -> None:
    """Steps of some decimetres saw nothing of a contact that begins 2 mm from the ball's centre."""
    start = 'position = ["-0.5137 m", "0.5 mm"]\nvelocity = ["1 m/s", "0 m/s"]'
    ball = '[spring.ball]\nbetween = ["ground", "block.centre"]\nlength = "0 m"\n'
    law = 'stop = { low = "2 mm", stiffness = "5 MN/m", width = "0.5 mm" }'
    flight = sliding_block(ADAPTIVE, start, ball + law).replace("prismatic", "planar")
    file = tmp_path / "flight.toml"
    file.write_text(flight.replace("axis = [1, 0, 0]", "axis = [0, 0, 1]").replace("block.side", "block.centre"))
    motions = Pipeline(load_scene(file)).motions

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        r = np.hypot(*y[:2])
        near, far = max(2e-3 - r, 0.0), max(1.5e-3 - r, 0.0)
        return np.r_[y[2:], 5e6 * (near**2 - far**2) / (2 * 5e-4) / 2.0 * y[:2] / r]

    # it flies freely until 0.5 s, and again from 0.53 s on
    met = solve_ivp(rates, (0.5, 0.53), [-0.0137, 5e-4, 1.0, 0.0], "DOP853", rtol=1e-11, atol=1e-13, max_step=1e-4)
    end, rate = np.split(met.y[:, -1], 2)
    assert np.hypot(*end) > 2e-3
    assert abs(rate[1]) > 0.3
    for label, motion in motions.items():
        assert motion.tip_position[-1, :2] == pytest.approx(end + 0.47 * rate, abs=5e-3), label
