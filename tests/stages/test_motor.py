"""The page's motor with rotor, gear, torque–speed curve and friction, against SciPy's solver for one coordinate."""

import re
import tomllib
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array

PAGE = Path(__file__).parents[2] / "docs" / "control.md"
RATIO, ROTOR, ARM = 50.0, 1.5e-4, 2.0 / 3.0


def test_the_motor_of_the_page_moves_its_arm_as_the_equation_of_one_coordinate(tmp_path: Path) -> None:
    (text,) = (
        part
        for part in re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
        if "title" in part
    )
    assert tomllib.loads(text)["coupler"]["gear"]["ratio"] == RATIO
    (tmp_path / "motor.toml").write_text(text)
    motion = Pipeline(load_scene(tmp_path / "motor.toml", ["simulation.run.0.tolerance=1e-11"])).motion
    limited = []

    def rates(t: float, x: Array) -> list[float]:
        angle, rate = x
        ref = np.interp(t, [0.0, 0.02, 2.0], np.radians([0, 60, 60]))
        limit = np.interp(abs(RATIO * rate), np.array([0, 1200, 3000]) * 2 * np.pi / 60, [1.2, 1.2, 0.0])
        wanted = 10.0 * (ref - angle) - 1.5 * rate + 0.19 * np.cos(angle)
        limited.append(abs(wanted) > limit)
        friction = 0.02 * RATIO * rate / np.hypot(RATIO * rate, 5.0)
        torque = RATIO * (np.clip(wanted, -limit, limit) - friction) - 9.81 * np.cos(angle)
        return [rate, torque / (ARM + RATIO**2 * ROTOR)]

    # In pieces between the kinks of the reference, which a solver's steps would smear.
    x, found, times = np.zeros(2), [], motion.times
    for begin, end in ((0.0, 0.02), (0.02, 1.0)):
        inside = times[(times >= begin) & (times < end)]
        piece = solve_ivp(rates, (begin, end), x, "DOP853", dense_output=True, rtol=1e-12, atol=1e-13, max_step=2e-3)
        found += [piece.sol(t)[0] for t in inside]
        x = piece.y[:, -1]
    exact = np.array([*found, x[0]])
    assert any(limited)
    assert exact.max() > 1.0  # it has got there, with its limits
    np.testing.assert_allclose(motion.joint_position("hinge"), exact, atol=1e-7)
