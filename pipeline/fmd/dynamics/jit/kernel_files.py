"""Compiled kernels on disk: one file each, whole or not at all, whatever happens to the processes that write them.

Numba's own index names its data files by numbers and is written before them. Two processes that compile at once can so
give one number to two kernels, and each then runs the other's code; a full disk ends the run; a damaged index ends
every run after it.
"""

from __future__ import annotations

import hashlib
import pickle
from pathlib import Path
from typing import Any

from numba.core.serialize import dumps

from fmd.core.files import whole_file

_DIGEST_BYTES = 16


class KernelFiles:
    """Keeps a function's kernels, in the place of Numba's index and data files.

    Parameters
    ----------
    folder : Path
        Where they are kept.
    name : str
        The function's, as Numba makes it: with its module and line.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name

    def _path(self, key: Any) -> Path:
        return self._folder / f"{self._name}.{_digest(repr(key).encode()).hex()}.kernel"

    def save(self, key: Any, data: Any) -> None:
        """Keep a kernel under its types and target; what can't be written is compiled anew another time."""
        content: bytes = dumps((key, data))  # type: ignore[no-untyped-call]
        try:
            with whole_file(self._path(key)) as part:
                part.write_bytes(_digest(content) + content)
        except OSError:
            pass

    def load(self, key: Any) -> Any:
        """Return the kernel; ``None`` if there is none, or only something damaged."""
        try:
            content = self._path(key).read_bytes()
        except OSError:
            return None
        if _digest(content[_DIGEST_BYTES:]) != content[:_DIGEST_BYTES]:
            return None
        try:
            found, data = pickle.loads(content[_DIGEST_BYTES:])
        except Exception:  # whole, but of types that can't be imported any more
            return None
        return data if found == key else None

    def flush(self) -> None:
        """Forget nothing: the folder is named after the kernels' sources."""


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_DIGEST_BYTES).digest()
