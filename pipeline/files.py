"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path

_ABANDONED = 3600.0  # seconds; no file takes as long to be written


def forget_abandoned(folder: Path, pattern: str) -> None:
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
    forget_abandoned(path.parent, f".{escape(path.stem)}.*{escape(path.suffix)}")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
