"""Compiled programs on disk: one object file each, named after its program and the processor that it is for.

Files are written whole or not at all, so any number of processes may compile and load at once; a damaged one is made
anew.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from pipeline.core.files import whole_file
from pipeline.core.paths import kernel_folder
from pipeline.dynamics.compiler.llvm import emit
from pipeline.dynamics.compiler.machine import LoadedObject, compile_object, processor, register_width
from pipeline.dynamics.compiler.program import Program

_DIGEST_BYTES = 16


def load_program(program: Program) -> LoadedObject:
    """Return a program's machine code: kept from before, or compiled now and kept."""
    path = object_path(program)
    content = _read(path)
    if content is not None:
        return LoadedObject(content)
    content = compile_object(emit(program, register_width()))
    _write(path, content)
    return LoadedObject(content)


def object_path(program: Program) -> Path:
    """Return where a program's machine code for this processor is kept."""
    key = hashlib.blake2b(repr((program.digest, processor())).encode(), digest_size=_DIGEST_BYTES).hexdigest()
    return kernel_folder() / f"{program.name}.{key}.object"


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
