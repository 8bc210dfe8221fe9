"""Files that are written whole or not at all, and work that one process does while others wait for it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path

_ABANDONED = 3600.0  # seconds; no file takes as long to be written


def remove_abandoned(folder: Path, pattern: str) -> None:
    """Delete what killed processes have left half-written under temporary names."""
    with suppress(OSError):
        for part in folder.glob(pattern):
            with suppress(OSError):
                if time.time() - part.stat().st_mtime > _ABANDONED:
                    part.unlink()


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Lend a temporary name beside ``path``: renamed to it if the block ends well, deleted otherwise."""
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

    The system lets go of it when a process dies. Where it can't be had (no such locks, no such folder), all go through.
    """
    handle = _locked(path)
    try:
        yield
    finally:
        if handle is not None:
            with suppress(OSError):
                path.unlink(missing_ok=True)
            os.close(handle)


def _locked(path: Path) -> int | None:
    try:
        import fcntl

        path.parent.mkdir(parents=True, exist_ok=True)
        while True:
            handle = os.open(path, os.O_CREAT | os.O_RDWR)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX)
                if _is_at(handle, path):
                    return handle
            except BaseException:
                os.close(handle)
                raise
            os.close(handle)
    except (ImportError, OSError):
        return None


def _is_at(handle: int, path: Path) -> bool:
    """Whether an open file is still what others find under its name: whoever held it before may have deleted it."""
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False
