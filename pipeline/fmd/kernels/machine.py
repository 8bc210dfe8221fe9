"""Machine code: compiled for this processor, linked into the process, and kept on disk as entries of the one store."""

import hashlib
import threading
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm

from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.kernels.table import aligned

DIGEST_BYTES = 16
"""Length of `digest_of` a content."""


def read_code(path: Path) -> bytes | None:
    """Return a file's content; ``None`` if there is none, or not what was written; any number may write at once."""
    return Cache(path.parent).load_bytes(path.name)


def write_code(path: Path, content: bytes) -> None:
    """Keep a content; what can't be written is compiled again another time."""
    Cache(path.parent).save_bytes(path.name, content)


def digest_of(content: bytes) -> bytes:
    """Return what tells contents apart."""
    return hashlib.blake2b(content, digest_size=DIGEST_BYTES).digest()


_linking = threading.Lock()

llvm.initialize_native_target()
llvm.initialize_native_asmprinter()


@cache
def processor() -> tuple[str, str, str]:
    """Return what machine code depends on: LLVM's version, and the processor's name and features."""
    version = ".".join(str(part) for part in llvm.llvm_version_info)
    return version, llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def register_width() -> int:
    """Return how many doubles a vector register of this processor holds, 4 at least."""
    return 8 if "+avx512f" in processor()[2].split(",") else 4


@cache
def _target(triple: str = "", effort: int = 3) -> Any:
    """Return the code generator for this processor, or for any of a triple such as ``aarch64-apple-darwin``."""
    if triple:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        return llvm.Target.from_triple(triple).create_target_machine(opt=effort, reloc="pic")
    _, name, features = processor()
    return llvm.Target.from_default_triple().create_target_machine(cpu=name, features=features, opt=effort, jit=True)


def compile_object(source: str, level: int = 0, triple: str = "", effort: int = 3) -> bytes:
    """Compile a module of LLVM's language to an object file, for this machine or one such as ``aarch64-apple-darwin``.

    ``level`` is the effort of LLVM's passes. They make no vectors and unroll only loops of functions that are marked
    so, since that takes two thirds of all time: others, over coordinates and output times, run as fast. By default the
    code generator alone runs: what the passes look for, common subexpressions and constants, a graph doesn't have, and
    they cost a third of the time for no speed (pairing like scalars into vectors costs four times as much). By its
    ``effort`` 0 a function of 180 kB is compiled in a fifth of the time that 3 takes, and runs two to three times as
    long.
    """
    target = _target(triple, effort)
    module = llvm.parse_assembly(source)
    module.triple, module.data_layout = target.triple, str(target.target_data)
    module.verify()
    if level:
        options = llvm.create_pipeline_tuning_options(speed_level=level)
        options.loop_vectorization = False
        options.loop_unrolling = False
        builder = llvm.create_pass_builder(target, options)
        builder.getModulePassManager().run(module, builder)
    return bytes(target.emit_object(module))


class LoadedObject:
    """Functions of an object file in memory, for as long as this lives; ``n_bytes`` with the constants that they read.

    Raises
    ------
    ValueError
        The object isn't one, or misses a function.
    """

    def __init__(self, content: bytes, constants: Array | None = None) -> None:
        (self._constants,) = aligned(0 if constants is None else constants.size)
        self._constants[:] = 0.0 if constants is None else constants
        self.n_bytes = len(content) + self._constants.nbytes
        self._addresses: dict[str, int] = {}
        # It links what is compiled already: one for this processor in particular takes twice as long to load.
        linker = llvm.Target.from_default_triple().create_target_machine(opt=0, jit=True)
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), linker)
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(content))
        with _linking:  # each object is linked to constants of its own, all under one name
            llvm.add_symbol("constants", self._constants.ctypes.data)
            self._engine.finalize_object()

    def address(self, function: str) -> int:
        """Return a function's address."""
        if function not in self._addresses:  # asked once: the engine takes longer than a short function runs
            if not (address := self._engine.get_function_address(function)):
                raise ValueError(f"the object has no function {function}")
            self._addresses[function] = int(address)
        return self._addresses[function]

    def variable(self, name: str) -> int:
        """Return a global variable's address."""
        return int(self._engine.get_global_value_address(name))
