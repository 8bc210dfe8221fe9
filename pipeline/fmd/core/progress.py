"""Progress of long tasks on standard error, a bar for each at a terminal, and how whoever waits for them ends them."""

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import Protocol

from fmd.core.data_classes import dataclass
from fmd.core.limits.patience import SAY_AFTER_SECONDS, SHOW_AFTER_SECONDS


def _nothing() -> None:
    pass


_check: ContextVar[Callable[[], None]] = ContextVar("check", default=_nothing)


def check_for_interruption() -> None:
    """Raise what the innermost `interrupted_by` raises, if it does; searches call this in each of their iterations."""
    _check.get()()


@contextmanager
def interrupted_by(check: Callable[[], None]) -> Iterator[None]:
    """Have searches within call ``check`` now and then, which raises an error to end them."""
    token = _check.set(check)
    try:
        yield
    finally:
        _check.reset(token)


Advance = Callable[[float], None]
"""Takes the part of a task that is done, 0…1."""


class Monitor(Protocol):
    """Listener to tasks and their progress."""

    def __call__(self, name: str) -> AbstractContextManager[Advance]:
        """Enter a task; the function that is yielded takes its progress."""


@contextmanager
def silent(name: str) -> Iterator[Advance]:
    """Report no progress."""
    yield lambda done: None


@dataclass(eq=False)
class _Task:
    """A task that is open; what is done of it never grows less, though methods that are tried begin anew.

    What is left is by the pace since it was first told that nothing is done, which comes after what can't be counted.
    """

    name: str
    begun: float
    done: float = 0.0
    told: float = 0.0  # when it last grew

    def advance(self, done: float) -> None:
        if not self.done:
            self.begun = time.monotonic() if done == 0.0 else self.begun
        if done > self.done:
            self.done, self.told = done, time.monotonic()

    def left(self, now: float) -> float:
        """Return the seconds that are left by the pace up to when it last grew, or up to now where that has passed."""
        elapsed, whole = now - self.begun, (self.told - self.begun) / self.done
        return whole - elapsed if whole > elapsed else elapsed * (1.0 / self.done - 1.0)


class Bars:
    """Monitor that draws a bar for a task that has taken a second at a terminal, else writes a line every ten seconds.

    Lines count from the first task, so that a run of many short ones has them, too; ten seconds without any begin anew.
    """

    def __init__(self) -> None:
        self._begun = self._ended = self._said = -math.inf  # the first task, the last one's end, the last line
        self._open: list[_Task] = []
        self._writing = threading.Lock()

    @contextmanager
    def __call__(self, name: str) -> Iterator[Advance]:
        """Enter a task; the function that is yielded takes its progress."""
        task = _Task({"machine code": "compiling"}.get(name, name), time.monotonic())  # as it is shown
        with _draw_bar(task) if sys.stderr.isatty() else self._write_lines(task) as advance:
            yield advance

    @contextmanager
    def _write_lines(self, task: _Task) -> Iterator[Advance]:
        if not self._open and task.begun - self._ended > SAY_AFTER_SECONDS:
            self._begun = self._said = task.begun
        left = threading.Event()

        def write() -> None:
            while not left.wait(max(self._said + SAY_AFTER_SECONDS - time.monotonic(), 0.0)):
                with self._writing:
                    if time.monotonic() >= self._said + SAY_AFTER_SECONDS:  # else a task around this one has written
                        self._said = time.monotonic()
                        sys.stderr.write(self._line())
                        sys.stderr.flush()

        self._open.append(task)
        writer = threading.Thread(target=write, daemon=True)
        writer.start()
        try:
            yield task.advance
        finally:
            left.set()
            writer.join()
            self._open.remove(task)
            self._ended = time.monotonic()

    def _line(self) -> str:
        """Return the line of the outermost task that knows how far it is, else of the innermost."""
        tasks = self._open.copy()
        task = next((each for each in tasks if each.done), tasks[-1])
        share = f", {100 * task.done:.0f} %" if task.done else ""
        if 0.0 < task.done < 1.0:
            share += f", about {task.left(self._said):.0f} s left"
        return f"{self._said - self._begun:.0f} s: {task.name}{share}\n"


@contextmanager
def _draw_bar(task: _Task) -> Iterator[Advance]:
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        bar = progress.add_task(task.name, total=None, visible=False)
        timer = threading.Timer(SHOW_AFTER_SECONDS, lambda: progress.update(bar, visible=True))
        timer.daemon = True
        timer.start()

        def advance(done: float) -> None:
            task.advance(done)
            progress.update(bar, total=1.0, completed=task.done)

        try:
            yield advance
        finally:
            timer.cancel()
