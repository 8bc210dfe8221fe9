"""Numba's compiler without what takes time and is of no use to kernels; the code that they run is the same.

What a kernel calls by name is linked into it and optimised there. Numba optimises it and makes machine code of it by
itself as well, which nobody runs: for the arm that was a tenth of the time. Another tenth went into comparing flags.
"""

# mypy: allow-untyped-calls, allow-subclassing-any

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags

_DEFAULTS = {name: option.default for name, option in Flags.options.items()}


class _Flags(Flags):
    """Flags that are equal if the same code comes of them.

    Numba asks that for every overload of every operator that it meets, and looks at each of two dozen options of both.
    Who may call a function is no matter there: overloads that kernels share are compiled once.
    """

    __slots__ = ()

    def _key(self) -> dict[str, Any]:
        default, at = _DEFAULTS, self._values
        return {name: value for name, value in at.items() if name != "no_cpython_wrapper" and value != default[name]}

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, _Flags) and self._key() == other._key())

    def __hash__(self) -> int:
        return len(_DEFAULTS)  # as good as Numba's own, which is that of the options' names


class KernelCompiler(Compiler):
    """Compiles what has an address."""

    def __init__(
        self, typingctx: Any, targetctx: Any, library: Any, args: Any, return_type: Any, flags: Flags, locals: Any
    ) -> None:
        super().__init__(typingctx, targetctx, library, args, return_type, _Flags(flags), locals)


class _NowhereYet:
    """Stands for the engine that would run a function, and be told where its environment is."""

    def set_env(self, env_name: str, env: Any) -> None:
        """Do nothing: only what raises or prints needs an environment, and kernels do neither."""


class _Linked(JITCodeLibrary):
    """Code that waits to be linked into a kernel."""

    def _optimize_final_module(self) -> None:
        """Leave that to the kernel."""

    def _finalize_final_module(self) -> None:
        """Make no machine code."""
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Say that there is no such code; Numba asks for the way in for Python, which isn't there either."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        return _NowhereYet()


class LinkedCompiler(KernelCompiler):
    """Compiles what is linked into kernels."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a Python function."""
        self.state.library = _Linked(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)
