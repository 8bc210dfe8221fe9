"""Progress of long tasks, as one bar on standard error for each that takes more than a second."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from fmd.core.limits.patience import SHOW_AFTER_SECONDS

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
    """Draw a bar once a task has taken a second, if standard error is a terminal."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(name, total=None, visible=False)
        timer = threading.Timer(SHOW_AFTER_SECONDS, lambda: progress.update(task, visible=True))
        timer.daemon = True
        timer.start()
        try:
            yield lambda done: progress.update(task, total=1.0, completed=done)
        finally:
            timer.cancel()
