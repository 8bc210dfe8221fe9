"""Compiled programs on disk: an object file for each structure of a graph, and the constants of each program.

A program whose graph differs from another's in constants alone needs no compiling: the code is read for both, and has
an array of constants of its own in each copy that is loaded.
Files are written whole or not at all, so any number of processes may compile and load at once; a damaged one is made
anew.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fmd.core.limits.code import LONG_EFFORT, LONG_PROGRAM, MOST_EFFORT
from fmd.core.limits.memory import MOST_LOADED
from fmd.core.paths import kernel_folder
from fmd.core.recently_used import RecentlyUsed
from fmd.dynamics.compiler.program import Program
from fmd.kernels.machine import (
    DIGEST_BYTES,
    LoadedObject,
    compile_object,
    digest_of,
    processor,
    read_code,
    register_width,
    write_code,
)

# Loaded in this process: loading takes longer than many a march. What a digest names never changes.
_loaded: RecentlyUsed[LoadedObject] = RecentlyUsed(MOST_LOADED)


def load_program(name: str, digest: str, trace: Callable[[], Program]) -> LoadedObject:
    """Return a program's machine code: kept from before, or traced and compiled now and kept.

    The digest is of all that it is made from, apart from the sources.
    """
    path = constants_path(name, digest)
    return _loaded.get(path, lambda: _read_program(name, path) or _make_program(name, path, trace))


def _read_program(name: str, path: Path) -> LoadedObject | None:
    """Return a program whose constants are kept in a file, with the digest of its code before them."""
    kept = read_code(path)
    content = None if kept is None else read_code(object_path(name, kept[:DIGEST_BYTES]))
    if kept is None or content is None:
        return None
    return LoadedObject(content, np.frombuffer(kept[DIGEST_BYTES:]))


def _make_program(name: str, path: Path, trace: Callable[[], Program]) -> LoadedObject:
    """Trace a program, compile its code unless a program of the same structure has been, and keep both."""
    from fmd.dynamics.compiler.llvm import emit

    program = trace()
    source, constants = emit(program, register_width())
    digest = digest_of(source.encode())
    of_code = object_path(name, digest)
    content = read_code(of_code)
    if content is None:
        content = compile_object(source, effort=_effort(program))
        write_code(of_code, content)
    write_code(path, digest + constants.tobytes())
    return LoadedObject(content, constants)


def _effort(program: Program) -> int:
    """Return the effort with which a program is compiled, see `compile_object`."""
    if program.seldom:
        return 0
    return LONG_EFFORT if program.operations(register_width()) >= LONG_PROGRAM else MOST_EFFORT


def constants_path(name: str, digest: str) -> Path:
    """Return where a program's constants are kept."""
    return kernel_folder() / f"{name}.{digest_of(repr((digest, processor())).encode()).hex()}.constants"


def object_path(name: str, digest: bytes) -> Path:
    """Return where the machine code of all programs of a structure is kept, for this processor."""
    return kernel_folder() / f"{name}.{digest_of(repr((digest, processor())).encode()).hex()}.object"
