"""Marches at the same time find what they find in turn, and end together."""

import time
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError
from fmd.integrators.automatic import Automatic
from fmd.integrators.protocol import Progress, State, Trajectory
from fmd.integrators.side_by_side import March, march_at_once, march_in_turn, time_by_turns
from fmd.output.stated_errors import run_time
from fmd.output.summary import summarise

NOTHING = np.zeros((1, 0))
FOUND = Trajectory("", 1.0, 1, np.zeros(1), NOTHING, NOTHING, 0, 0, 2.0, State(0, *NOTHING, *NOTHING, *NOTHING))


@pytest.fixture(autouse=True)
def two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "2")


def endless(progress: Progress | None) -> Trajectory:
    """March until it is told to end."""
    while progress is not None:
        progress(0.5)
        time.sleep(1e-3)
    return FOUND


def failing(error: Exception) -> March:
    def march(progress: Progress | None) -> Trajectory:
        raise error

    return march


@pytest.mark.parametrize("scene", ["arm", "rod-slider"])
def test_the_motion_is_the_same_with_one_thread_and_with_two(scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    run = Pipeline(load_scene(scene))
    monkeypatch.setattr("fmd.core.limits.stepping.WORTH_A_CORE", 0.0)
    motions = []
    for threads in (1, 2):
        monkeypatch.setenv("OMP_NUM_THREADS", str(threads))
        motions.append(Automatic(1e-3, 0.2).march(run.system, *run.start, np.linspace(0.0, 0.2, 41)))
    np.testing.assert_array_equal(motions[0].q, motions[1].q)
    np.testing.assert_array_equal(motions[0].v, motions[1].v)
    assert motions[0].evaluations == motions[1].evaluations


def test_a_march_that_fails_leaves_the_other_alone() -> None:
    reason = AccuracyError("no step")
    for march in (march_in_turn, march_at_once):
        assert march([failing(reason), lambda progress: FOUND])[0] == [reason, FOUND]
        assert march([lambda progress: FOUND, failing(reason)])[0] == [FOUND, reason]


def test_run_time_is_by_the_clock() -> None:
    slower = replace(FOUND, seconds=3.0)
    marches: list[March] = [lambda progress: FOUND, lambda progress: slower]
    assert march_in_turn(marches)[1] == 5.0
    assert march_at_once(marches)[1] == 3.0


@pytest.mark.parametrize("error", [KeyboardInterrupt(), TimeoutError("no time left")])
def test_what_ends_the_last_march_ends_the_other_too(error: Any) -> None:
    with pytest.raises(type(error)):
        march_at_once([endless, failing(error)])


def test_a_fault_of_the_march_aside_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        march_at_once([failing(ZeroDivisionError()), lambda progress: FOUND])


def test_short_marches_are_repeated_by_turns_until_they_fill_a_while() -> None:
    turns: list[str] = []

    def march(label: str, seconds: float) -> Trajectory:
        turns.append(label)
        return replace(FOUND, seconds=seconds)

    spent = {"long": 0.5, "middling": 0.08, "short": 0.009, "shorter": 0.0079}
    found = {label: replace(FOUND, seconds=seconds) for label, seconds in spent.items()}
    again = {label: partial(march, label, each.seconds * 0.75) for label, each in found.items()}
    timed = time_by_turns(found, again)
    assert turns == ["middling", "short", "shorter", "middling", "short", "shorter", "shorter"]
    assert [each.seconds for each in timed.values()] == pytest.approx([0.5, 0.06, 0.00675, 0.005925])
    assert [each.spread for each in timed.values()] == pytest.approx([0.0, 0.0, 0.0, 0.0], abs=0.01)


def test_no_ratio_within_the_spread_is_shown() -> None:
    row = {"seconds": 0.00123, "ratio_to_plain": 0.9, "spread": 0.05}
    assert run_time(row, row) == ("1.23 ms", "0.90")
    assert run_time(row | {"spread": 0.2}, row) == ("1.23 ms (median +20 %)", "–")
    assert run_time(row, row | {"spread": 0.2}) == ("1.23 ms", "–")
    assert run_time(row | {"ratio_to_plain": 1.0, "spread": 0.2}, row)[1] == "1.00"


def test_a_march_too_short_for_the_clock_has_no_ratio(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Pipeline(load_scene("rod-slider", ["simulation.duration=10 ms", "output=[]"]), Cache(None))
    monkeypatch.setattr(time, "perf_counter", lambda: 1.0)
    rows = summarise(run, [], budget=False)["integrations"]
    assert [row["seconds"] for row in rows] == [0.0, 0.0, 0.0]
    assert [run_time(row, rows[0])[1] for row in rows] == ["–", "–", "–"]
