"""Machine code on disk: files that are written whole or not at all, and known to be what was written.

Any number of processes may write and read at once; a damaged file is as good as none.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from fmd.core.files import whole_file

DIGEST_BYTES = 16
"""Length of `digest_of` a content."""


def read_code(path: Path) -> bytes | None:
    """Return a file's content; ``None`` if there is none, or not what was written."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    mark, content = content[:DIGEST_BYTES], content[DIGEST_BYTES:]
    return content if digest_of(content) == mark else None


def write_code(path: Path, content: bytes) -> None:
    """Keep a content; what can't be written is compiled again another time."""
    try:
        with whole_file(path) as part:
            part.write_bytes(digest_of(content) + content)
    except OSError:
        pass


def digest_of(content: bytes) -> bytes:
    """Return what tells contents apart."""
    return hashlib.blake2b(content, digest_size=DIGEST_BYTES).digest()
