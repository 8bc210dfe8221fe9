"""Compiled programs on disk: object files, structures of programs and the code of each, and each program's constants.

A program whose graph differs from another's in constants alone needs no compiling: the code is read for both, and has
an array of constants of its own in each copy that is loaded.
Files are written whole or not at all, so any number of processes may compile and load at once; a damaged one is made
anew.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.code import LONG_EFFORT, LONG_PROGRAM, MOST_EFFORT
from fmd.core.limits.memory import MOST_LOADED
from fmd.core.paths import kernel_folder
from fmd.core.recently_used import RecentlyUsed
from fmd.dynamics.compiler.program import Program
from fmd.dynamics.compiler.structure import number_constants, place_constants, split_constants
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
    path = kept_path(name, digest, "constants")
    return _loaded.get(path, lambda: _read_program(name, path) or _make_program(name, path, trace))


def _read_program(name: str, path: Path) -> LoadedObject | None:
    """Return a program whose constants are kept in a file, with the digest of its structure before them."""
    kept = read_code(path)
    found = None if kept is None else _read_structure(name, kept[:DIGEST_BYTES])
    return None if kept is None or found is None else LoadedObject(found[1], np.frombuffer(kept[DIGEST_BYTES:]))


def _read_structure(name: str, digest: bytes) -> tuple[Array, bytes] | None:
    """Return the numbers of the constants at their places, and the object file, of programs of a structure."""
    kept = read_code(kept_path(name, digest, "places"))
    code = None if kept is None else read_code(kept_path(name, kept[:DIGEST_BYTES], "object"))
    return None if kept is None or code is None else (np.frombuffer(kept[DIGEST_BYTES:]), code)


def _make_program(name: str, path: Path, trace: Callable[[], Program]) -> LoadedObject:
    """Trace a program, write its code unless a program of the same structure has been, and keep both."""
    program = trace()
    structure, own = split_constants(program)
    digest = digest_of(structure)
    places, code = _read_structure(name, digest) or _write_structure(name, digest, program)
    constants = place_constants(places, own)
    write_code(path, digest + constants.tobytes())
    return LoadedObject(code, constants)


def _write_structure(name: str, digest: bytes, program: Program) -> tuple[Array, bytes]:
    """Write the code of a structure, and compile it unless another structure's is the same, as `_read_structure` does.

    Two modes that change places move zeros of arrays, which few programs leave out.
    """
    from fmd.dynamics.compiler.llvm import emit

    source, places = emit(number_constants(program), register_width())
    written = digest_of(source.encode())
    of_code = kept_path(name, written, "object")
    code = read_code(of_code)
    if code is None:
        code = compile_object(source, effort=_effort(program))
        write_code(of_code, code)
    write_code(kept_path(name, digest, "places"), written + places.tobytes())
    return places, code


def _effort(program: Program) -> int:
    """Return the effort with which a program is compiled, see `compile_object`."""
    if program.seldom:
        return 0
    return LONG_EFFORT if program.operations(register_width()) >= LONG_PROGRAM else MOST_EFFORT


def kept_path(name: str, digest: str | bytes, kind: str) -> Path:
    """Return where what a digest stands for is kept, for this processor: a program's constants, places, or an object.

    Places say which constants the code of a structure reads, behind the digest of its source, which the object is of.
    """
    return kernel_folder() / f"{name}.{digest_of(repr((digest, processor())).encode()).hex()}.{kind}"
