"""Folders of the user's cache and its kernels, and digests of the source code that name their content."""

import hashlib
import json
import os
import re
import sys
import tempfile
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from stat import S_ISDIR
from typing import Any

import platformdirs

from fmd.core.limits.patience import SETTLED_NS

_ROOT = Path(__file__).parents[2]
# Modules of numbers, as sources import them: by their own name, or for the numbers in them.
_NUMBERS, _WORDS = re.compile(rb"\nfrom fmd\.core\.limits(?:\.\w+)? import (?:\([^)]*\)|.*)"), re.compile(rb"\w+")

_SOURCES = "sources.json"  # in the cache folder: what is known of sources

_private: dict[Path, bool] = {}  # folders that were looked at in this run

KERNEL_SOURCES = (
    "fmd/kernels",
    "fmd/contact",
    "fmd/core/limits",
    "fmd/dynamics",
    "fmd/integrators",
    "fmd/recovery/kernels",
    "fmd/core/newton.py",
    "fmd/fem/column_products.py",
    "fmd/reduction/factor",
)
"""Folders and files whose sources kernels are compiled from."""


def cache_folder() -> Path:
    """Return the user's cache folder, which the environment variable ``FMD_CACHE`` overrides.

    One that others may write to isn't used: a temporary folder of the user's own takes its place, and a line on
    standard error says so.
    """
    try:
        wanted = Path(given) if (given := os.environ.get("FMD_CACHE")) else platformdirs.user_cache_path("fmd")
    except RuntimeError:  # a user without a home
        return own_temporary_folder()
    return wanted if is_private(wanted) else own_temporary_folder()


def is_private(folder: Path, make: bool = False) -> bool:
    """Return True if a folder belongs to this user and nobody else may write to it, or if it isn't there.

    It is looked at once a run; if it isn't private, a line on standard error says so. On request it is made for this
    user alone if it is missing; if that fails, it isn't private.
    """
    if folder not in _private:
        try:
            if make:
                for place in reversed([folder, *folder.parents]):
                    if not place.exists():
                        place.mkdir(mode=0o700, exist_ok=True)
            fault = _fault_of(folder.stat())
        except OSError:
            return not make
        _private[folder] = not fault
        if fault:
            mend = "make it yours alone (chmod go-w), or set FMD_CACHE to another"
            sys.stderr.write(f"cache folder {folder} {fault} and isn't used: {mend}\n")
    return _private[folder]


def _fault_of(status: os.stat_result) -> str:
    """Say why others may write to a folder, by its owner and its mode; empty if they may not."""
    if not hasattr(os, "getuid"):  # on Windows a user's folders are his own
        return ""
    if status.st_uid != os.getuid():
        return "belongs to another user"
    return "may be written by others" if status.st_mode & 0o022 else ""


@cache
def own_temporary_folder() -> Path:
    """Return a temporary folder that belongs to this user and that nobody else can write to."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"fmd-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        if S_ISDIR(status.st_mode) and not _fault_of(status):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="fmd-"))


@cache
def source_digest(*names: str) -> str:
    """Digest the Python sources in folders and files named from the project's root, e.g. ``fmd/fem``.

    The modules of `fmd.core.limits` that these import count among them: a number that decides changes their results.

    Raises
    ------
    FileNotFoundError
        A name is no folder and no file: a source that has moved must not silently leave a result's key.
    """
    digest, numbers = hashlib.blake2b(digest_size=8), set[bytes]()
    for name in names:
        place = _ROOT / name
        if not place.exists():
            raise FileNotFoundError(f"{name}: no such source in {_ROOT}; a stage's key names it")
        for path in _list_sources(str(place)):
            content, named = _digest_source(path)
            digest.update(content)
            numbers |= named
    for path in _list_sources(str(_ROOT / "fmd" / "core" / "limits")):
        if Path(path).stem.encode() in numbers:
            digest.update(_digest_source(path)[0])
    _keep_sources()
    return digest.hexdigest()


@cache
def _list_sources(place: str) -> tuple[str, ...]:
    """List a file, or the Python sources in a folder, by their paths as text: objects would take most of the time."""
    if os.path.isfile(place):
        return (place,)
    found = (os.path.join(folder, name) for folder, _, names in os.walk(place) for name in names)
    return tuple(sorted(path for path in found if path.endswith(".py") and "__pycache__" not in path))


@cache
def _digest_source(path: str) -> tuple[bytes, set[bytes]]:
    """Digest a source, which many stages' keys name, and return the words of its imports from `fmd.core.limits`.

    One that hasn't been touched since an earlier run digested it isn't read again, as Python itself trusts bytecode.
    """
    status = os.stat(path)
    mark = [status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino]
    known, added = _known_sources()
    if path in known and known[path][0] == mark:
        _, content, words = known[path]
    else:
        with open(path, "rb") as file:
            source = file.read()
        named = _NUMBERS.findall(b"\n" + source) if b"core.limits" in source else ()
        content = hashlib.blake2b(source, digest_size=16).hexdigest()
        words = sorted({name.decode() for match in named for name in _WORDS.findall(match)})
        if time.time_ns() - status.st_ctime_ns > SETTLED_NS:
            added[path] = [mark, content, words]
    return content.encode(), {name.encode() for name in words}


@cache
def _known_sources() -> tuple[dict[str, Any], dict[str, Any]]:
    """Read marks, digests and words of sources by their paths, and give room for those that this run adds."""
    try:
        known = json.loads((cache_folder() / _SOURCES).read_bytes())
    except (OSError, ValueError):  # missing or damaged
        known = {}
    return (known if isinstance(known, dict) else {}), {}


def _keep_sources() -> None:
    """Write the marks, digests and words of sources beside those that are known, if there are new ones."""
    known, added = _known_sources()
    if not added or not is_private(folder := cache_folder(), make=True):
        return
    known |= added
    added.clear()
    with suppress(OSError):
        handle, part = tempfile.mkstemp(dir=folder, prefix=".part-")
        with os.fdopen(handle, "w") as file:
            json.dump(known, file)
        os.replace(part, folder / _SOURCES)


def kernel_folder() -> Path:
    """Make the folder of kernels compiled from this very source; a temporary one if the cache can't be written."""
    for place in (cache_folder, own_temporary_folder):
        folder = place() / "kernels" / source_digest(*KERNEL_SOURCES)
        if is_private(folder, make=True) and os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="fmd-kernels-"))
