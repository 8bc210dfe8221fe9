"""Turns of quaternions against SciPy's rotations, their tangents against differences, the way back against these."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fmd.core.arrays import Array
from fmd.dynamics.compiler.turns import Turns, make_turns
from fmd.kernels.vectors import call_native


def found(turns: Turns, kind: str, q: Array, v: Array) -> Array:
    end = q.copy()
    call_native(getattr(turns, kind), (turns.step, end, v, end))
    return end


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 1.0, 5.0])
def test_quaternions_turn_as_rotations_do_with_their_derivatives(size: float) -> None:
    turns, rng = make_turns(np.zeros((1, 2), dtype=np.int64), "", "_tangents", "_back"), np.random.default_rng(1)
    turns.step[0] = 0.7
    q, v, w = Rotation.random(random_state=rng).as_quat(), size * rng.normal(size=3), rng.normal(size=4)
    dq, dv = rng.normal(size=(4, 8)), rng.normal(size=(3, 8))
    turned = (Rotation.from_quat(q) * Rotation.from_rotvec(0.7 * v)).as_quat()
    assert found(turns, "turn", q, v) == pytest.approx(turned * np.sign(turned @ found(turns, "turn", q, v)), abs=1e-15)
    turns.step[0] = 1e-6
    forwards, back = found(turns, "turn", q, v), found(turns, "turn", q, -v)
    assert found(turns, "rate", q, v) == pytest.approx((forwards - back) / 2e-6, abs=1e-9)
    turns.step[0] = 0.7
    for kind in ("turn", "rate"):
        end, dend = np.zeros(4), np.zeros((4, 8))
        call_native(getattr(turns, f"{kind}_tangents"), (turns.step, q, v, dq, dv, end, dend))
        beside = [
            [found(turns, kind, q + way * 1e-6 * dq[:, k], v + way * 1e-6 * dv[:, k]) for way in (1, -1)]
            for k in range(8)
        ]
        assert dend == pytest.approx(np.array([(one - other) / 2e-6 for one, other in beside]).T, abs=1e-8)
        of_q, of_v = (w.copy() if kind == "turn" else np.zeros(4)), np.zeros(3)
        call_native(getattr(turns, f"{kind}_back"), (turns.step, q, v, w, of_q, of_v))
        assert of_q @ dq + of_v @ dv == pytest.approx(w @ dend, abs=1e-14)
