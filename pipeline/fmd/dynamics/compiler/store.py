"""Compiled programs on disk: one object file each, named after what it is compiled from and the processor it is for.

Files are written whole or not at all, so any number of processes may compile and load at once; a damaged one is made
anew.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path

from fmd.core.files import whole_file
from fmd.core.limits.memory import MOST_LOADED
from fmd.core.paths import kernel_folder
from fmd.dynamics.compiler.llvm import emit
from fmd.dynamics.compiler.machine import LoadedObject, compile_object, processor, register_width
from fmd.dynamics.compiler.program import Program

_DIGEST_BYTES = 16

# Loaded in this process, the last used last: loading takes longer than many a march. What a digest names never changes.
_loaded: OrderedDict[Path, LoadedObject] = OrderedDict()


def load_program(name: str, digest: str, trace: Callable[[], Program]) -> LoadedObject:
    """Return a program's machine code: kept from before, or compiled now and kept.

    Parameters
    ----------
    name : str
        The function's.
    digest : str
        Of all that it is made from, apart from the sources.
    trace : callable
        Traces it, if it has to be compiled.
    """
    path = object_path(name, digest)
    loaded = _loaded.pop(path, None)
    if loaded is None:
        content = _read(path)
        if content is None:
            content = compile_object(emit(trace(), register_width()))
            _write(path, content)
        loaded = LoadedObject(content)
    _loaded[path] = loaded
    while len(_loaded) > MOST_LOADED:
        _loaded.popitem(last=False)
    return loaded


def object_path(name: str, digest: str) -> Path:
    """Return where a program's machine code for this processor is kept."""
    return kernel_folder() / f"{name}.{_digest(repr((digest, processor())).encode()).hex()}.object"


def _read(path: Path) -> bytes | None:
    """Return an object's bytes; ``None`` if there are none, or not those that were written."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, content = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
    return content if _digest(content) == digest else None


def _write(path: Path, content: bytes) -> None:
    """Keep an object's bytes; what can't be written is compiled again another time."""
    try:
        with whole_file(path) as part:
            part.write_bytes(_digest(content) + content)
    except OSError:
        pass


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_DIGEST_BYTES).digest()
