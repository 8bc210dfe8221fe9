"""Numba, set up once: kernels cached on disk in a folder that changes with their source."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from pipeline.core.arrays import Array
from pipeline.core.paths import kernel_folder

# Numba keys its cache by the file of the outermost function alone, so a change in a function that it calls would
# go unnoticed. A folder named after all kernel sources can't be stale.
os.environ.setdefault("NUMBA_CACHE_DIR", str(kernel_folder()))

import numba
import numpy as np
from numba.core import event
from numba.extending import overload

from pipeline.dynamics.jit.kernel_compiler import KernelCompiler, LinkedCompiler
from pipeline.dynamics.jit.kernel_files import KernelFiles

_LINE = 8  # doubles
F = TypeVar("F", bound=Callable[..., Any])

# Kernels allocate nothing, so they need none of Numba's reference counting: left on, its atomic increments cost more
# than the arithmetic of a small body (50 ns of 57 ns for the fast equation of five modes).
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True, "forceinline": False}
_INNER = _OPTIONS | {"no_cpython_wrapper": True}
# LLVM inlines these; Numba's own inlining types and lowers them once more in every caller.
_INLINED: Any = _INNER | {"forceinline": True, "pipeline_class": LinkedCompiler}


class _WithoutCollection(event.Listener):
    """Leaves the garbage of compiling until it is done: looking for it takes a tenth of the time."""

    def __init__(self) -> None:
        self._depth, self._was_on = 0, False

    def on_start(self, event: Any) -> None:
        """Stop collecting, if this isn't a kernel that another one needs."""
        if self._depth == 0:
            self._was_on = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """Go on collecting when the outermost kernel is done."""
        self._depth -= 1
        if self._depth == 0 and self._was_on:
            gc.freeze()  # and unfreeze: what is new counts as old, or it would all be looked at now
            gc.unfreeze()
            gc.enable()


event.register("numba:compile", _WithoutCollection())  # type: ignore[no-untyped-call]


def aligned(*sizes: int) -> list[Array]:
    """Zeroed vectors that each begin a cache line: straddling one costs a small kernel a third of its speed."""
    lines = [-(-size // _LINE) * _LINE for size in sizes]
    block = np.zeros(sum(lines) + _LINE)
    start = -(block.ctypes.data // 8) % _LINE
    ends = start + np.cumsum(lines)
    return [block[end - line : end - line + size] for end, line, size in zip(ends, lines, sizes, strict=True)]


def kernel(function: F) -> F:
    """Compile a function that Python calls; kept on disk."""
    compiled: F = _kept(numba.njit(cache=True, nogil=True, pipeline_class=KernelCompiler, **_OPTIONS)(function))
    return compiled


def addressed(function: F) -> F:
    """Compile a function that kernels alone call, by its address; kept on disk."""
    compiled: F = _kept(numba.njit(cache=True, nogil=True, pipeline_class=KernelCompiler, **_INNER)(function))
    return compiled


def inner(function: F) -> F:
    """Compile a function that kernels alone call, by its name; kept on disk as a part of them."""
    compiled: F = numba.njit(nogil=True, pipeline_class=LinkedCompiler, **_INNER)(function)
    return compiled


def _kept(compiled: Any) -> Any:
    """Have a function's kernels kept in files of our own."""
    cache = compiled._cache
    cache._cache_file = KernelFiles(Path(cache.cache_path), cache._impl.filename_base)
    return compiled


def inlined(function: F) -> F:
    """Compile a function into the kernels that call it."""
    compiled: F = numba.njit(**_INLINED)(function)
    return compiled


def meaning(name: Callable[..., None], parameters: type) -> Callable[[F], F]:
    """Decorate what the function ``name`` of `pipeline.dynamics.system` does for one type of parameters."""

    def register(function: F) -> F:
        def choose(p: Any, *_: Any) -> F | None:
            return function if getattr(p, "instance_class", None) is parameters else None

        overload(name, jit_options=_INLINED, strict=False)(choose)
        return function

    return register
