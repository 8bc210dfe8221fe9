"""The one store of what is kept between runs: results of stages, units, compiled code.

Each entry is named by a digest of everything that it depends on, and begins with a digest of its name and its content:
neither a damaged entry nor one under another's name is taken. Nothing is pickled. A folder that others may write to
isn't used.
"""

import hashlib
import json
import os
import tempfile
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from fmd.core.data_classes import dataclass
from fmd.core.encoding import conforms, decode, encode
from fmd.core.files import one_at_a_time, remove_abandoned
from fmd.core.paths import is_private, source_digest

_DIGEST_BYTES = 32


@cache
def package_version(package: str) -> str:
    """Return the version of an installed distribution by its own line: parsing all of them takes ten times as long."""
    found = metadata.distribution(package)
    lines = (found.read_text("METADATA") or "").splitlines()
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("Version:"))
    return next(named, None) or found.version


def stage_key(stage: str, inputs: Any, sources: tuple[str, ...], packages: tuple[str, ...] = ()) -> str:
    """Name a stage's result after its inputs, the source code and the packages that make it, with a digest.

    Inputs are as JSON takes them; other objects enter by their text. Sources are folders and files from the project's
    root, e.g. ``fmd/fem``; packages are distributions whose versions matter.
    """
    content = {
        "format": "JSON and npy",  # of the files, and so a part of their names
        "stage": stage,
        "inputs": inputs,
        "source": source_digest(*sources),
        "packages": {package: package_version(package) for package in packages},
    }
    text = json.dumps(content, sort_keys=True, default=str)
    return f"{stage}-{hashlib.blake2b(text.encode(), digest_size=16).hexdigest()}"


@dataclass(frozen=True)
class Cache:
    """Folder of entries, of which each carries the digest of its name and its content."""

    folder: Path | None  # place of the files; ``None`` keeps nothing, and so does a folder that others may write to

    def holds(self, key: str) -> bool:
        """Return true if an undamaged entry is saved under ``key``."""
        return self.load_bytes(key) is not None

    def load(self, key: str, kind: str = "") -> Any:
        """Return the value that was saved under ``key``; ``None`` if it is missing, damaged or of another kind.

        Parameters
        ----------
        kind : str
            Annotation of the value that is expected, such as ``Mapping[str, Array]``; empty for any.
        """
        content = self.load_bytes(key)
        if content is None:
            return None
        try:
            value = decode(content)
        except ValueError:  # undamaged, but of another version of its classes
            return None
        return value if conforms(value, kind) else None

    def save(self, key: str, value: Any) -> None:
        """Save a value under ``key``, whole or not at all; one that can't be kept or written is left out."""
        with suppress(TypeError):
            self.save_bytes(key, encode(value))

    def load_bytes(self, key: str) -> bytes | None:
        """Return the bytes that were saved under ``key``; ``None`` if they are missing or damaged."""
        if self.folder is None or not is_private(self.folder):
            return None
        try:
            content = (self.folder / key).read_bytes()
        except OSError:
            return None
        digest, body = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
        return body if _digest(key, body) == digest else None

    def save_bytes(self, key: str, body: bytes) -> None:
        """Save bytes under ``key`` for this user alone; a folder that can't be written is left alone."""
        if self.folder is None or not is_private(self.folder, make=True):
            return
        part = ""
        try:
            _sweep(self.folder)
            handle, part = tempfile.mkstemp(dir=self.folder, prefix=".part-")
            with os.fdopen(handle, "wb") as file:
                file.write(_digest(key, body))
                file.write(body)
            os.replace(part, self.folder / key)
        except OSError:
            if part:
                Path(part).unlink(missing_ok=True)

    def lock(self, key: str) -> AbstractContextManager[None]:
        """Let one process at a time make the entry of ``key``, while others wait."""
        if self.folder is None or not is_private(self.folder, make=True):
            return nullcontext()
        return one_at_a_time(self.folder / f".making-{key}")


@cache
def _sweep(folder: Path) -> None:
    """Delete what killed processes have left half written, once: a folder of many entries takes long to list."""
    remove_abandoned(folder, ".part-*")


def _digest(key: str, body: bytes) -> bytes:
    found = hashlib.blake2b(key.encode(), digest_size=_DIGEST_BYTES)
    found.update(b"\0")
    found.update(body)
    return found.digest()
