"""Springs, dampers and bushings that are too stiff to be followed: marched or refused soon, with the part named."""

from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import InputError, StabilityError
from fmd.dynamics.compiled_system.reference_state import find_fastest_part
from fmd.integrators.endless import StepsLeft
from fmd.stages.mechanism import place_joints
from fmd.stages.stiffening_check import rigid_motion
from tests.stages.sliding_block import MASS, sliding_block

BETWEEN = 'between = ["ground.wall", "block.centre"]'
COIL = f"[spring.coil]\n{BETWEEN}\n"
BUSHING = f'[bushing.pad]\n{BETWEEN}\nstiffness = ["1e12 N/m", "0 N/m", "0 N/m", "0 N m/rad", "0 N m/rad", "0 N m/rad"]'


def block(folder: Path, part: str, run: str = 'integrator = "runge-kutta"', joint: str = "") -> Pipeline:
    (folder / "block.toml").write_text(sliding_block(f"{{ {run} }}", f'rate = "1 m/s"\n{joint}', part))
    return Pipeline(load_scene(folder / "block.toml"))


@pytest.mark.parametrize(
    ("part", "joint", "name", "rate"),
    [
        (COIL + 'stiffness = "8e9 N/m"', 'spring = "1 N/m"', "spring 'coil'", np.sqrt((8e9 + 1.0) / MASS)),
        (COIL + 'stiffness = "1 N/m"', 'spring = "8e9 N/m"', "joint 'slide'", np.sqrt((8e9 + 1.0) / MASS)),
        (COIL + 'stiffness = "1 N/m"\ndamper = "1e6 N s/m"', "", "spring 'coil'", 1e6 / MASS),
        (COIL + 'stop = { high = "2 m", stiffness = "2e8 N/m" }', "", "spring 'coil'", 1e4),
        (BUSHING, 'spring = "1 N/m"', "bushing or bearing 'pad'", np.sqrt(1e12 / MASS)),
    ],
)
def test_the_fastest_part_is_named_with_its_rate(tmp_path: Path, part: str, joint: str, name: str, rate: float) -> None:
    # √(k/m) of a vibration, c/m of a decay.
    found = find_fastest_part(block(tmp_path, part, joint=joint).system)
    assert found is not None
    assert (found.name, found.damps) == (name, "damper" in part)
    assert found.rate == pytest.approx(rate, rel=1e-9)


def test_a_mechanism_without_stiffness_has_no_fastest_part(tmp_path: Path) -> None:
    assert find_fastest_part(block(tmp_path, "").system) is None


def test_bodies_that_do_not_deform_are_marched_on_a_stiff_spring_and_vibrate_as_far_as_they_do(tmp_path: Path) -> None:
    # v/ω with ω = √(k/m): 1e6 periods, which no method follows in the time that a check may take.
    run = block(tmp_path, COIL + 'stiffness = "1e14 N/m"')
    motion = rigid_motion(run.mechanism, *place_joints(run.scene, run.mechanism), 1.0)
    assert np.abs(motion.q).max() == pytest.approx(np.sqrt(MASS / 1e14), rel=1e-2)
    assert np.abs(motion.v).max() == pytest.approx(1.0, rel=1e-2)


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ('stiffness = "1e30 N/m"', r"step fell to .*; the stiffness of spring 'coil' makes vibrations of 1\.1e\+14 Hz"),
        (
            'damper = "1e12 N s/m"',
            r"never come to an end; the damper of spring 'coil' stops what .* in 2e-12 s, .* 2e-06 times",
        ),
    ],
)
def test_a_march_without_end_is_refused_with_the_part_that_is_to_blame(tmp_path: Path, part: str, message: str) -> None:
    with pytest.raises(StabilityError, match=message):
        block(tmp_path, COIL + part).motion  # noqa: B018


def test_the_exponential_method_refuses_vibrations_whose_phase_is_round_off(tmp_path: Path) -> None:
    part, run = COIL + 'stiffness = "1e30 N/m"', 'integrator = "exponential", step = "1 ms"'
    with pytest.raises(InputError, match=r"unknown by 0\.2 rad at the end; the stiffness of spring 'coil'"):
        block(tmp_path, part, run).plans  # noqa: B018


def test_steps_that_are_short_for_a_while_are_no_march_without_end() -> None:
    left = StepsLeft("a method", end=1.0, most=1e6, over=100)
    left.require_end(99, 1e-9)
    left.require_end(200, 1e-3)
    with pytest.raises(StabilityError, match=r"steps of 1\.0e-08 s at t = 0\.001001 s, and so 1\.0e\+08 more"):
        left.require_end(300, 1.001e-3)
    with pytest.raises(StabilityError, match="any number more"):
        left.require_end(400, 1e-3)
