"""Decorators of functions in the subset of Python that `translate` takes, and how Python calls them.

They are compiled for the types that they are called with, and kept on disk: a file each, named after the function, the
types and the processor, in a folder that changes with the sources of this package. The environment variable
``FMD_KERNELS`` has two other ways: ``python`` runs the functions as they stand, under a debugger for example, and
``checked`` compiles them with checks of all indices.
"""

import ctypes
import functools
import os
import sys
import threading
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fmd.core.limits.code import KERNEL_LEVEL
from fmd.core.paths import kernel_folder
from fmd.kernels.machine import LoadedObject, compile_object, digest_of, processor, read_code, write_code
from fmd.kernels.table import address_of
from fmd.kernels.types import NOTHING, REAL, TRUTH, WHOLE, ArrayType, Compiling, TableType, Type, type_of

F = TypeVar("F", bound=Callable[..., Any])

_C_TYPES = {REAL: ctypes.c_double, WHOLE: ctypes.c_int64, TRUTH: ctypes.c_bool, NOTHING: None}
_ENTRY, _PACKAGE = "entry", __name__.partition(".")[0]
_marks: dict[Any, Compiling] = {}
_compiling = threading.RLock()


def _mark(how: Compiling) -> Callable[[F], F]:
    """Return a decorator that notes how a function is compiled."""

    def mark(function: F) -> F:
        _marks[function] = how
        return function

    return mark


inner = _mark(Compiling())
"""Mark a function that kernels call; LLVM makes it a part of these where that pays."""

inlined = _mark(Compiling(inlined=True))
"""Mark a function that becomes a part of each kernel that calls it, for small ones that are called all the time."""

contracted = _mark(Compiling(inlined=True, contracted=True))
"""Mark an inlined function whose products and sums contract to one rounding where the processor can.

What waits for a chain of them takes two thirds of the time.
"""

unrolled = _mark(Compiling(inlined=True, contracted=True, unrolled=True))
"""Mark a contracted function whose innermost loops are long, over coordinates: some rounds go at a time."""


def kernel(function: F) -> F:
    """Compile a function that Python calls, and kernels may."""
    return Kernel(inlined(function))  # type: ignore[return-value]


class Kernel:
    """A function that is compiled when Python first calls it with values of some types; it runs without Python's lock.

    `python` is the function as it stands.

    Raises
    ------
    TypeError
        An argument is no number, no C-contiguous array of 64-bit numbers and no `Table`; the message names it.
    NotInSubset
        The function does something that kernels can't; the message has file and line.
    IndexError
        A checked kernel has left the bounds of an array; the message has file and line.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        functools.update_wrapper(self, function)
        self.python = function
        self._entries: dict[tuple[Type, ...], Callable[..., Any]] = {}

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        try:
            types = tuple([type_of(x) for x in arguments])
        except TypeError:
            self._refuse(arguments)
            raise
        entry = self._entries.get(types)
        if entry is None:
            with _compiling:
                entry = self._entries[types] = self._enter(types)
        return entry(*arguments)

    def bind(self, first: Sequence[Any], *numbers: Any) -> Callable[..., Any]:
        """Return a call with its first arguments given, tables and arrays whose memory stays; numbers come after them.

        It does little more than call the machine code, for programs that call it very often. The function is called
        once with the numbers, which are of the types of the others.
        """
        self(*first, *numbers)
        entry = self._entries[tuple([type_of(x) for x in (*first, *numbers)])]
        return entry.bind(first) if isinstance(entry, _Entry) else functools.partial(entry, *first)

    def _refuse(self, arguments: Sequence[Any]) -> None:
        """Raise ``TypeError`` with the name of the first argument that isn't for kernels."""
        names = self.python.__code__.co_varnames
        for name, x in zip(names, arguments, strict=False):
            try:
                type_of(x)
            except TypeError as error:
                raise TypeError(f"{self.python.__name__}: {name} {error}") from None

    def _enter(self, types: tuple[Type, ...]) -> Callable[..., Any]:
        """Return a function that calls the compiled one with arguments of some types."""
        mode = os.environ.get("FMD_KERNELS", "compiled")
        if mode == "python":
            return self.python
        if mode == "checked":
            return self._checked(types)
        path = self._path(types)
        content = read_code(path)
        if content is None:
            text, result = self.translate(types)
            content = f"{result}\n".encode() + compile_object(text, KERNEL_LEVEL)
            write_code(path, content)
        kind, _, code = content.partition(b"\n")
        return _Entry(LoadedObject(code), types, kind.decode())

    def translate(self, types: tuple[Type, ...]) -> tuple[str, str]:
        """Return the function in LLVM's language, for some types of arguments, and the type of its result."""
        from fmd.kernels.translate import Module  # which kept code needs not

        text, result = Module(_marks.get).translate_entry(self.python, types)
        return text, str(result)

    def _path(self, types: tuple[Type, ...]) -> Path:
        sources = [_own_source(module) for module in sorted({self.__module__, *_modules(types)})]
        code = self.python.__code__
        content = repr((types, processor(), sources, code.co_firstlineno, code.co_code, code.co_names)).encode()
        return kernel_folder() / f"{self.__module__}.{self.python.__name__}.{digest_of(content).hex()}.kernel"

    def _checked(self, types: tuple[Type, ...]) -> Callable[..., Any]:
        from fmd.kernels.translate import Module

        module = Module(_marks.get, checked=True)
        text, result = module.translate_entry(self.python, types)
        loaded = LoadedObject(compile_object(text, KERNEL_LEVEL))
        call, fault = _Entry(loaded, types, str(result)), (ctypes.c_int64 * 3).from_address(loaded.variable("fault"))

        def call_and_check(*arguments: Any) -> Any:
            fault[0] = 0
            found = call(*arguments)
            if fault[0]:
                file, line = module.checks[fault[0] - 1]
                raise IndexError(f"{file}:{line}: index {fault[1]} is out of bounds for size {fault[2]}")
            return found

        return call_and_check


class _Entry:
    """A compiled function, called with its arguments' words: of an array its address and its shape."""

    def __init__(self, loaded: LoadedObject, types: tuple[Type, ...], result: str) -> None:
        kinds: list[Any] = []
        for kind in types:
            if isinstance(kind, str):
                kinds.append(_C_TYPES[kind])
            else:
                kinds += [ctypes.c_void_p, *[ctypes.c_int64] * (kind.n_axes if isinstance(kind, ArrayType) else 0)]
        self._loaded = loaded  # as long as this lives
        self._call = ctypes.CFUNCTYPE(_C_TYPES[result], *kinds)(loaded.address(_ENTRY))

    def __call__(self, *arguments: Any) -> Any:
        return self._call(*_words_of(arguments))

    def bind(self, first: Sequence[Any]) -> Callable[..., Any]:
        """Return a call with the first arguments given, which it keeps; numbers come after them."""
        call, words = self._call, _words_of(first)

        def bound(*numbers: Any, _kept: Any = (self, first)) -> Any:
            return call(*words, *numbers)

        return bound


def _words_of(arguments: Sequence[Any]) -> list[Any]:
    """Return what machine code takes for some arguments: of an array its address and its shape."""
    words: list[Any] = []
    for x in arguments:
        if isinstance(x, np.ndarray):
            words.append(address_of(x))
            words += x.shape
        else:
            words.append(getattr(x, "address", x))
    return words


def _modules(types: Sequence[Type | bool]) -> set[str]:
    """Return the modules in which tables among some types are, and those among their members."""
    found: set[str] = set()
    for kind in types:
        if isinstance(kind, TableType):
            found |= {kind.table.__module__, *_modules([member for _, member in kind.members])}
    return found


@cache
def _own_source(module: str) -> str:
    """Return a digest of a module outside of this package, whose sources don't name the folder of kernels."""
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None or module.partition(".")[0] == _PACKAGE:
        return ""
    return digest_of(Path(file).read_bytes()).hex()
