"""Files that are written whole or not at all, and work that one process at a time does."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path
from typing import Any

from fmd.core.errors import AccuracyError
from fmd.core.limits.patience import ABANDONED_SECONDS


def remove_abandoned(folder: Path, pattern: str) -> None:
    """Delete half-written files that killed processes have left under temporary names."""
    with suppress(OSError):
        for part in folder.glob(pattern):
            with suppress(OSError):
                if time.time() - part.stat().st_mtime > ABANDONED_SECONDS:
                    part.unlink()


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Lend a temporary name beside ``path``; the file is renamed to it if the block ends well, else deleted."""
    part = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    remove_abandoned(path.parent, f".{escape(path.stem)}.*{escape(path.suffix)}")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def one_at_a_time(path: Path) -> Iterator[None]:
    """Let one process at a time through, on any machine that shares the folder; ``path`` is there meanwhile.

    The system releases the lock when a process dies. Where there are no locks, or no folder, all processes go through.
    """
    from filelock import FileLock

    lock = FileLock(path, fallback_to_soft=False)
    with suppress(OSError, NotImplementedError):
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    try:
        yield
    finally:
        if lock.is_locked:
            # Deleted before it is released: a process that waits notices and makes the file anew.
            with suppress(OSError):
                path.unlink(missing_ok=True)
            with suppress(OSError):
                lock.release()


def require_finite(value: Any, path: str = "") -> None:
    """Raise ``AccuracyError`` with the path of the first number in dicts and lists that JSON can't hold, if any."""
    if isinstance(value, float) and not math.isfinite(value):
        raise AccuracyError(f"the result {path} isn't a finite number ({value}); check the scene's units and sizes")
    if isinstance(value, dict):
        for key, item in value.items():
            require_finite(item, f"{path}.{key}".lstrip("."))
    elif isinstance(value, list | tuple):
        for number, item in enumerate(value):
            require_finite(item, f"{path}.{number}".lstrip("."))
