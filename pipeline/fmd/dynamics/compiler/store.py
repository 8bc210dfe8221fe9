"""Compiled programs on disk: an object file for each structure of a program, and the constants of each program.

A program whose graph differs from another's in constants alone needs no compiling: the code is read for both, and has
an array of constants of its own in each copy that is loaded.
Files are written whole or not at all, so any number of processes may compile and load at once; a damaged one is made
anew.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.code import BYTES_OF_COUNT, LONG_EFFORT, LONG_PROGRAM, MOST_EFFORT
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
    path = constants_path(name, digest)
    return _loaded.get(path, lambda: _read_program(name, path) or _make_program(name, path, trace))


def _read_program(name: str, path: Path) -> LoadedObject | None:
    """Return a program whose constants are kept in a file, with the digest of its structure before them."""
    kept = read_code(path)
    content = None if kept is None else read_code(object_path(name, kept[:DIGEST_BYTES]))
    if kept is None or content is None:
        return None
    return LoadedObject(_split_code(content)[1], np.frombuffer(kept[DIGEST_BYTES:]))


def _make_program(name: str, path: Path, trace: Callable[[], Program]) -> LoadedObject:
    """Trace a program, write and compile its code unless a program of the same structure has been, and keep both."""
    program = trace()
    structure, own = split_constants(program)
    digest = digest_of(structure)
    of_code = object_path(name, digest)
    content = read_code(of_code)
    if content is None:
        from fmd.dynamics.compiler.llvm import emit

        source, places = emit(number_constants(program), register_width())
        code = compile_object(source, effort=_effort(program))
        content = len(places).to_bytes(BYTES_OF_COUNT, "little") + places.tobytes() + code
        write_code(of_code, content)
    places, code = _split_code(content)
    constants = place_constants(places, own)
    write_code(path, digest + constants.tobytes())
    return LoadedObject(code, constants)


def _split_code(content: bytes) -> tuple[Array, bytes]:
    """Split kept code into the numbers of the constants at their places, and the object file."""
    end = BYTES_OF_COUNT + np.dtype(float).itemsize * int.from_bytes(content[:BYTES_OF_COUNT], "little")
    return np.frombuffer(content[BYTES_OF_COUNT:end]), content[end:]


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
