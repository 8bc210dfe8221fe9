"""Machine code on disk: entries of the one store, a file each in the folder of this source's kernels.

Any number of processes may write and read at once; a damaged file is as good as none.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from fmd.core.cache import Cache

DIGEST_BYTES = 16
"""Length of `digest_of` a content."""


def read_code(path: Path) -> bytes | None:
    """Return a file's content; ``None`` if there is none, or not what was written."""
    return Cache(path.parent).load_bytes(path.name)


def write_code(path: Path, content: bytes) -> None:
    """Keep a content; what can't be written is compiled again another time."""
    Cache(path.parent).save_bytes(path.name, content)


def digest_of(content: bytes) -> bytes:
    """Return what tells contents apart."""
    return hashlib.blake2b(content, digest_size=DIGEST_BYTES).digest()
