"""Where the user's cache lives, and the digests that name what is in it."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import platformdirs

_ROOT = Path(__file__).parent.parent


def cache_folder() -> Path:
    """The user's cache folder; ``FMD_CACHE`` overrides it."""
    return Path(os.environ.get("FMD_CACHE") or platformdirs.user_cache_path("fmd"))


@cache
def source_digest(*names: str) -> str:
    """Digest of the Python sources in folders and files named from the project's root, e.g. ``pipeline/fem``."""
    digest = hashlib.blake2b(digest_size=8)
    for name in names:
        place = _ROOT / name
        for path in _sources([place] if place.is_file() else sorted(place.rglob("*.py"))):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _sources(paths: Iterable[Path]) -> Iterable[Path]:
    return (path for path in paths if "__pycache__" not in path.parts)


def kernel_folder() -> Path:
    """Folder of the compiled kernels of this very source; a temporary one if the cache can't be written."""
    folder = cache_folder() / "kernels" / source_digest("pipeline/dynamics", "pipeline/integrators")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="fmd-kernels-"))
