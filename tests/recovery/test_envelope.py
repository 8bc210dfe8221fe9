"""Envelope of the stress against the whole history and eigenvalues of LAPACK."""

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.recovery.envelope import StressEnvelope, stress_envelope
from fmd.recovery.stress import StressHistory, stress_measure


def envelope_of(tensors: Array) -> StressEnvelope:
    """Envelope of one node with any history of tensors (n_times, 6)."""
    times = np.linspace(0.0, 1.0, len(tensors))
    return stress_envelope(StressHistory(np.array([7]), np.eye(6)[None], times, tensors))


def test_the_envelope_is_that_of_the_whole_history() -> None:
    """131 nodes and 700 output times fill no block of either evenly."""
    rng = np.random.default_rng(0)
    modal, q = rng.normal(size=(131, 6, 5)), np.cumsum(rng.normal(size=(700, 5)), axis=0)
    history = StressHistory(np.arange(131), modal, 0.1 * np.arange(700), q)
    found = stress_envelope(history)
    tensors = np.einsum("nij,tj->nit", modal, q)
    for name, pick in (("von Mises", np.argmax), ("principal 1", np.argmax), ("principal 3", np.argmin)):
        values = stress_measure(name)(tensors)
        extremes, times = found.measure(name)
        frames = pick(values, axis=1)
        assert extremes == pytest.approx(values[np.arange(131), frames], rel=1e-13)
        assert times == pytest.approx(history.times[frames])


def test_threads_change_no_number() -> None:
    rng = np.random.default_rng(1)
    history = StressHistory(np.arange(200), rng.normal(size=(200, 6, 3)), np.arange(400.0), rng.normal(size=(400, 3)))
    one, more = stress_envelope(history, workers=1), stress_envelope(history, workers=3)
    assert all(
        np.array_equal(getattr(one, name), getattr(more, name)) for name in ("von_mises", "principal_3", "times")
    )


@pytest.mark.parametrize(
    ("principal", "turn"),
    [
        ((5.0, 5.0, -3.0), True),
        ((5.0, -3.0, -3.0), True),
        ((0.0, 0.0, -1.0), True),
        ((-1.0, -2.0, -4.0), True),
        ((1.0, 0.0, 0.0), False),
        ((2.0, 2.0, 2.0), True),
        ((0.0, 0.0, 0.0), False),
        ((1e8, 1.0, -1.0), True),
        ((3.0, 2.0 + 1e-9, 2.0), True),
        ((1.0, 0.0, -1.0), True),
    ],
)
def test_principal_stresses_are_right_to_round_off_where_two_are_equal(
    principal: tuple[float, float, float], turn: bool
) -> None:
    Q = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0] if turn else np.eye(3)
    s = Q @ np.diag(principal) @ Q.T
    found = envelope_of(np.array([[s[0, 0], s[1, 1], s[2, 2], s[1, 2], s[0, 2], s[0, 1]]]))
    scale = max(1e-300, *np.abs(principal))
    assert found.principal_1[0] == pytest.approx(max(principal), abs=4e-15 * scale)
    assert found.principal_3[0] == pytest.approx(min(principal), abs=4e-15 * scale)


def test_an_extreme_is_dated_by_its_first_occurrence() -> None:
    tensors = np.zeros((1001, 6))
    tensors[[300, 900], 0], tensors[[400, 800], 1] = 2.0, -1.0
    found = envelope_of(tensors)
    assert found.times[0] == pytest.approx([0.3, 0.3, 0.4])
    assert (found.von_mises[0], found.principal_1[0], found.principal_3[0]) == (2.0, 2.0, -1.0)
