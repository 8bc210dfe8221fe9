"""Progress of tasks: nothing where nobody looks, a bar that is gone in the end where somebody does."""

import io
import re
import sys
import time

import pytest

from fmd.core import progress
from fmd.core.progress import Bars, silent


class Terminal(io.StringIO):
    """Standard error as a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_silent_monitor_writes_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with silent("mesh") as advance:
        advance(0.5)
    assert capsys.readouterr() == ("", "")


def test_no_bar_is_drawn_where_standard_error_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with Bars()("mesh") as advance:
        advance(0.5)
    assert capsys.readouterr() == ("", "")


def test_a_short_task_has_no_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with Bars()("mesh") as advance:
        advance(0.5)
    assert "mesh" not in terminal.getvalue()


def test_a_long_task_has_a_bar_with_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(progress, "SHOW_AFTER_SECONDS", 0.0)
    with Bars()("mesh") as advance:
        for _ in range(200):
            advance(0.5)
            if "mesh" in terminal.getvalue():
                break
            time.sleep(0.02)  # the bar has a thread of its own
    assert "mesh" in terminal.getvalue()


def test_without_a_terminal_a_long_task_says_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is done never grows less: a method that begins anew takes nothing back."""
    monkeypatch.setattr(progress, "SAY_AFTER_SECONDS", 0.02)
    said = ""
    with Bars()("machine code") as advance:
        advance(0.004)
        advance(0.001)
        for _ in range(200):
            said += capsys.readouterr().err
            if said:
                break
            time.sleep(0.02)
    assert re.match(r"0 s: compiling, 0 %, about \d+ s left\n", said)


def test_what_is_left_is_by_the_pace_of_what_can_be_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A factor that can't be counted takes 30 s, then four equal parts of 10 s each, the third of which takes 60 s."""
    clock = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    task = progress._Task("modes", 0.0)
    clock[0] = 30.0
    task.advance(0.0)
    clock[0] = 40.0
    task.advance(0.25)
    assert task.left(40.0) == pytest.approx(30.0)
    assert task.left(46.0) == pytest.approx(24.0)  # in the middle of the second part
    clock[0] = 50.0
    task.advance(0.5)
    task.advance(0.0)  # a search that begins anew takes nothing back
    assert (task.done, task.left(60.0)) == (0.5, pytest.approx(10.0))
    assert task.left(90.0) == pytest.approx(60.0)  # later than was thought: by the pace up to now


def test_a_failure_inside_a_task_comes_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    with pytest.raises(ValueError, match="inside"), Bars()("mesh"):
        raise ValueError("inside")


def test_without_a_terminal_many_short_tasks_have_lines_together(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line at a time, by the task that knows how far it is, as soon as ten seconds have passed since the last."""
    monkeypatch.setattr(progress, "SAY_AFTER_SECONDS", 0.2)
    monitor = Bars()
    for _ in range(10):
        with monitor("mesh"):
            time.sleep(0.03)  # each ends long before it would have a line of its own
    assert re.fullmatch(r"(\d+ s: mesh\n)+", capsys.readouterr().err)
    with monitor("12 points") as advance, monitor("motion"):
        advance(0.5)
        time.sleep(0.25)
    assert re.fullmatch(r"(\d+ s: 12 points(, 50 %, about \d+ s left)?\n)+", capsys.readouterr().err)
    time.sleep(0.25)  # a user who thinks
    with monitor("mesh"):
        pass
    assert capsys.readouterr().err == ""
