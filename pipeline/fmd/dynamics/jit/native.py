"""Calls from kernels to machine code that Numba hasn't compiled, by address and with arrays of doubles."""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import Any

import fmd.dynamics.jit.compiled  # noqa: F401 - sets Numba up, so it comes first

# isort: split
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.extending import intrinsic


@intrinsic
def _call_native(typing_context: Any, address: Any, arrays: Any) -> Any:
    """Call the C function ``void f(double *, …)`` at an address with the data of a tuple of arrays.

    Nothing can check that the function takes as many: the address is only a number.
    """
    kinds = tuple(arrays)
    for kind in kinds:
        if not (isinstance(kind, types.Array) and kind.layout == "C" and kind.dtype == types.float64):
            raise TypingError(f"{kind} is not a contiguous array of doubles")

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        members = cgutils.unpack_tuple(builder, values[1], len(kinds))
        pointers = [context.make_array(kind)(context, builder, x).data for kind, x in zip(kinds, members, strict=True)]
        function = ir.FunctionType(ir.VoidType(), [pointer.type for pointer in pointers]).as_pointer()
        builder.call(builder.inttoptr(values[0], function), pointers)
        return context.get_dummy_value()

    return types.none(address, arrays), generate


call_native: Any = _call_native  # as kernels see it: without the context
