"""Numba, set up once: kernels cached on disk in a folder that changes with their source."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from fmd.core.arrays import Array
from fmd.core.paths import kernel_folder

# Numba keys its cache by the file of the outermost function alone, so a change in a function that it calls would
# go unnoticed. A folder named after all kernel sources can't be stale.
os.environ.setdefault("NUMBA_CACHE_DIR", str(kernel_folder()))

import numba
import numpy as np
from numba.extending import overload
from numba.np import linalg

from fmd.dynamics.jit.kernel_files import KernelFiles

# Numba loads scipy.linalg, which takes longer than Numba itself, only to see that there is a BLAS; kernels call none.
_ensure_blas, linalg.ensure_blas = linalg.ensure_blas, lambda: None
try:
    import numba.np.arraymath
finally:
    linalg.ensure_blas = _ensure_blas

_LINE = 8  # doubles
F = TypeVar("F", bound=Callable[..., Any])

# Kernels allocate nothing, so they need none of Numba's reference counting: left on, its atomic increments cost more
# than the arithmetic of a small body (50 ns of 57 ns for the fast equation of five modes).
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True, "forceinline": False}
_INNER = _OPTIONS | {"no_cpython_wrapper": True}
# LLVM inlines these; Numba's own inlining types and lowers them once more in every caller.
_INLINED: Any = _INNER | {"forceinline": True}


def aligned(*sizes: int) -> list[Array]:
    """Zeroed vectors that each begin a cache line: straddling one costs a small kernel a third of its speed."""
    lines = [-(-size // _LINE) * _LINE for size in sizes]
    block = np.zeros(sum(lines) + _LINE)
    start = -(block.__array_interface__["data"][0] // 8) % _LINE
    vectors = []
    for size, line in zip(sizes, lines, strict=True):
        vectors.append(block[start : start + size])
        start += line
    return vectors


def kernel(function: F) -> F:
    """Compile a function that Python calls; kept on disk."""
    compiled: F = _kept(numba.njit(cache=True, nogil=True, **_OPTIONS)(function))
    return compiled


def inner(function: F) -> F:
    """Compile a function that kernels alone call, by its name; kept on disk as a part of them."""
    compiled: F = numba.njit(nogil=True, **_INNER)(function)
    return compiled


def inlined(function: F) -> F:
    """Compile a function into each kernel that calls it, for small ones that are called all the time.

    Else a call hands each array on by seven words on the stack, and waits for them longer than a small sum takes.
    """
    compiled: F = numba.njit(nogil=True, **_INLINED)(function)
    return compiled


def _kept(compiled: Any) -> Any:
    """Have a function's kernels kept in files of our own."""
    cache = compiled._cache
    cache._cache_file = KernelFiles(Path(cache.cache_path), cache._impl.filename_base)
    return compiled


def contracted(function: F) -> F:
    """Compile a function for kernels to call, its products and sums contracted to one rounding where the processor can.

    What waits for a chain of them takes two thirds of the time.
    """
    compiled: F = numba.njit(**_INLINED, fastmath={"contract"})(function)
    return compiled


def meaning(name: Callable[..., Any], parameters: type) -> Callable[[F], F]:
    """Decorate what a function that is a name only does for a type of its first argument, or one derived from it."""

    def register(function: F) -> F:
        def choose(p: Any, *_: Any) -> F | None:
            return function if issubclass(getattr(p, "instance_class", object), parameters) else None

        overload(name, jit_options=_INLINED, strict=False)(choose)
        return function

    return register
