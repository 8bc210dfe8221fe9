"""Progress of long tasks on standard error: a bar for each at a terminal, elsewhere a line now and then."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from fmd.core.limits.patience import SAY_AFTER_SECONDS, SHOW_AFTER_SECONDS

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


@contextmanager
def bars(name: str) -> Iterator[Advance]:
    """Draw a bar once a task has taken a second, if standard error is a terminal; else write a line every ten seconds.

    What is done never grows less, though methods that are tried begin anew.
    """
    name = {"machine code": "compiling"}.get(name, name)  # as it is shown
    most = 0.0
    if not sys.stderr.isatty():
        with _lines(name) as say:
            yield say
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(name, total=None, visible=False)
        timer = threading.Timer(SHOW_AFTER_SECONDS, lambda: progress.update(task, visible=True))
        timer.daemon = True
        timer.start()

        def advance(done: float) -> None:
            nonlocal most
            most = max(most, done)
            progress.update(task, total=1.0, completed=most)

        try:
            yield advance
        finally:
            timer.cancel()


@contextmanager
def _lines(name: str) -> Iterator[Advance]:
    """Write a line for each ten seconds that a task takes, with what is left at the pace until then."""
    most, ended = 0.0, threading.Event()

    def advance(done: float) -> None:
        nonlocal most
        most = max(most, done)

    def write() -> None:
        seconds = SAY_AFTER_SECONDS
        while not ended.wait(SAY_AFTER_SECONDS):
            left = f", about {seconds * (1.0 / most - 1.0):.0f} s left" if 0.0 < most < 1.0 else ""
            share = f", {100 * most:.0f} %{left}" if most else ""
            sys.stderr.write(f"{name}: {seconds:.0f} s{share}\n")
            sys.stderr.flush()
            seconds += SAY_AFTER_SECONDS

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    try:
        yield advance
    finally:
        ended.set()
        writer.join()
