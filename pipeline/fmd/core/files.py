"""Files that are written whole or not at all, and work that one process at a time does."""

import csv
import errno
import hashlib
import json
import math
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from glob import escape
from pathlib import Path
from typing import Any

from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.patience import ABANDONED_SECONDS
from fmd.core.limits.shown import DIGITS

_SPARED: ContextVar[tuple[Path, ...]] = ContextVar("spared", default=())


@contextmanager
def sparing(inputs: Sequence[Path]) -> Iterator[None]:
    """Refuse to write over the given files within the block, whatever names a writer gives its files.

    `require_not_spared` raises ``InputError``, and so does `whole_file`.
    """
    token = _SPARED.set(tuple(inputs))
    try:
        yield
    finally:
        _SPARED.reset(token)


def require_not_spared(path: Path) -> None:
    """Raise ``InputError`` if a file is one that `sparing` keeps."""
    if path.exists() and any(path.samefile(own) for own in _SPARED.get()):
        raise InputError(str(path), "", None, "is a file that the scene is read from; give another name")


@contextmanager
def refusing(option: str, path: Path) -> Iterator[None]:
    """Raise what the system says of a file or folder that an option names as ``InputError``."""
    try:
        yield
    except OSError as error:
        raise InputError(option, "", str(path), f"can't be written: {error.strerror or error}") from error


def read_text(path: Path) -> str:
    """Read a text file, with ``�`` for what isn't UTF-8; raises ``InputError``."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise InputError(str(path), "", None, f"can't be read: {error.strerror or error}") from error


def digest_file(path: Path) -> str:
    """Return a file's digest, or raise ``ValueError`` that says where it was looked for."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "blake2b").hexdigest()
    except (OSError, ValueError) as error:
        raise ValueError(unreadable(error, path)) from None


def unreadable(error: Exception, path: Path) -> str:
    """Write what the system says of a file that a scene names, and where it was looked for."""
    return f"can't be read: {getattr(error, 'strerror', None) or error}; it is looked for at {path}"


def remove_abandoned(folder: Path, pattern: str) -> None:
    """Delete half-written files that killed processes have left under temporary names."""
    with suppress(OSError):
        for part in folder.glob(pattern):
            with suppress(OSError):
                if time.time() - part.stat().st_mtime > ABANDONED_SECONDS:
                    part.unlink()


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Lend a temporary name beside ``path``; the file is renamed to it if the block ends well, else deleted.

    Its folder is made if it is missing; raises ``IsADirectoryError`` where the path is a folder itself.
    """
    require_not_spared(path)
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_abandoned(path.parent, f".{escape(path.stem)}.*{escape(path.suffix)}")
    with renamed_file(path) as part:
        yield part


@contextmanager
def renamed_file(path: Path) -> Iterator[Path]:
    """Lend a temporary name beside ``path`` as `whole_file` does, of a file among very many in a folder of our own."""
    part = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield part
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, whole."""
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any) -> None:
    """Write a value as JSON, whole; raises ``AccuracyError`` as `require_finite` does."""
    require_finite(value)
    write_text(path, json.dumps(value, indent=1, allow_nan=False) + "\n")


def write_table(path: Path, header: Sequence[str], rows: Iterable[Iterable[object]], note: str = "") -> None:
    """Write a table as CSV, whole: a note for a reader of the file, a header, and rows, where None is an empty cell."""
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        file.write(note)
        table = csv.writer(file, lineterminator="\n")
        table.writerow(header)
        table.writerows(rows)


def number_texts(rows: Iterable[Iterable[float]]) -> Iterator[list[str]]:
    """Yield rows of numbers as texts in the digits that tables have."""
    yield from ([f"{x:.{DIGITS}g}" for x in row] for row in rows)


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
