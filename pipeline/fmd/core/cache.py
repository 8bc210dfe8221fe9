"""Results of stages kept between runs, each named by a digest of everything that it depends on."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import tempfile
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from fmd.core.files import one_at_a_time, remove_abandoned
from fmd.core.paths import source_digest

_DIGEST_BYTES = 32
_FORMAT = "pickle 5"  # of the files, and so a part of their names

package_version = cache(metadata.version)


def stage_key(stage: str, inputs: Any, sources: tuple[str, ...], packages: tuple[str, ...] = ()) -> str:
    """Name a stage's result after its inputs, the source code and the packages that make it.

    Parameters
    ----------
    stage : str
        Name of the stage.
    inputs : object
        All that the result depends on, as JSON takes it; other objects enter by their text.
    sources : tuple of str
        Folders and files of the source code, from the project's root, e.g. ``fmd/fem``.
    packages : tuple of str
        Distributions whose versions matter.

    Returns
    -------
    str
        The stage's name and a digest.
    """
    content = {
        "format": _FORMAT,
        "stage": stage,
        "inputs": inputs,
        "source": source_digest(*sources),
        "packages": {package: package_version(package) for package in packages},
    }
    text = json.dumps(content, sort_keys=True, default=str)
    return f"{stage}-{hashlib.blake2b(text.encode(), digest_size=16).hexdigest()}"


@dataclass(frozen=True)
class Cache:
    """Folder of results, of which each file carries the digest of its content.

    Parameters
    ----------
    folder : Path or None
        Place of the files; ``None`` keeps nothing.
    """

    folder: Path | None

    def holds(self, key: str) -> bool:
        """Return true if an undamaged result is saved under ``key``."""
        return self._body(key) is not None

    def _body(self, key: str) -> bytes | None:
        """Read a file's content without its digest; ``None`` if it is missing or damaged."""
        if self.folder is None:
            return None
        try:
            content = (self.folder / key).read_bytes()
        except OSError:
            return None
        digest, body = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
        return body if _digest(body) == digest else None

    def load(self, key: str) -> Any:
        """Return the result that was saved under ``key``; ``None`` if it is missing or damaged."""
        body = self._body(key)
        if body is None:
            return None
        try:
            return pickle.loads(body)
        except Exception:  # undamaged, but of another version of its classes
            return None

    def save(self, key: str, value: Any) -> None:
        """Save a result under ``key``, whole or not at all; a folder that can't be written is left alone."""
        if self.folder is None:
            return
        body = pickle.dumps(value, protocol=5)
        part = ""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            remove_abandoned(self.folder, ".part-*")
            handle, part = tempfile.mkstemp(dir=self.folder, prefix=".part-")
            with os.fdopen(handle, "wb") as file:
                file.write(_digest(body))
                file.write(body)
            os.replace(part, self.folder / key)
        except OSError:
            if part:
                Path(part).unlink(missing_ok=True)

    def lock(self, key: str) -> AbstractContextManager[None]:
        """Let one process at a time make the result of ``key``, while others wait."""
        return nullcontext() if self.folder is None else one_at_a_time(self.folder / f".making-{key}")


def _digest(body: bytes) -> bytes:
    return hashlib.blake2b(body, digest_size=_DIGEST_BYTES).digest()
