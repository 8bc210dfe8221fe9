"""Progress of tasks: nothing where nobody looks, a bar that is gone in the end where somebody does."""

from __future__ import annotations

import io
import sys
import time

import pytest

from fmd.core import progress
from fmd.core.progress import bars, silent


class Terminal(io.StringIO):
    """Standard error as a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_silent_monitor_writes_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with silent("mesh") as advance:
        advance(0.5)
    assert capsys.readouterr() == ("", "")


def test_no_bar_is_drawn_where_standard_error_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with bars("mesh") as advance:
        advance(0.5)
    assert capsys.readouterr() == ("", "")


def test_a_short_task_has_no_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with bars("mesh") as advance:
        advance(0.5)
    assert "mesh" not in terminal.getvalue()


def test_a_long_task_has_a_bar_with_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(progress, "SHOW_AFTER_SECONDS", 0.0)
    with bars("mesh") as advance:
        for _ in range(200):
            advance(0.5)
            if "mesh" in terminal.getvalue():
                break
            time.sleep(0.02)  # the bar has a thread of its own
    assert "mesh" in terminal.getvalue()


def test_without_a_terminal_a_long_task_says_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is done never grows less, and what is left is by the pace: a method that begins anew takes nothing back."""
    monkeypatch.setattr(progress, "SAY_AFTER_SECONDS", 0.02)
    said = ""
    with bars("machine code") as advance:
        advance(0.004)
        advance(0.001)
        for _ in range(200):
            said += capsys.readouterr().err
            if said:
                break
            time.sleep(0.02)
    assert said.startswith("compiling: 0 s, 0 %, about 5 s left\n")  # 0.02 s for 0.4 %


def test_a_failure_inside_a_task_comes_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    with pytest.raises(ValueError, match="inside"), bars("mesh"):
        raise ValueError("inside")
