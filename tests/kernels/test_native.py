"""Kernels call machine code that the kernels' translator hasn't compiled, by its address."""

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.kernels.kernel import kernel
from fmd.kernels.machine import LoadedObject, compile_object
from fmd.kernels.vectors import call_native

SOURCE = """
define void @scale(ptr %factor, ptr %x) {
  %f = load double, ptr %factor, align 8
  %a = load double, ptr %x, align 8
  %y = fmul double %f, %a
  store double %y, ptr %x, align 8
  ret void
}
"""


@kernel
def _scale_both(address: int, factor: Array, x: Array) -> None:
    call_native(address, (factor, x))
    call_native(address, (factor, x[1:]))


@kernel
def _scale_number(address: int, x: float) -> None:
    call_native(address, (x,))  # type: ignore[arg-type]


def test_a_kernel_calls_a_compiled_function_with_the_data_of_its_arrays() -> None:
    loaded = LoadedObject(compile_object(SOURCE))
    x = np.array([1.0, 2.0, 3.0])
    _scale_both(loaded.address("scale"), np.array([10.0]), x)
    assert x.tolist() == [10.0, 20.0, 3.0]


def test_arrays_that_it_could_not_read_are_refused() -> None:
    with pytest.raises(TypeError, match="_scale_both: x must be a C-contiguous array of 64-bit numbers"):
        _scale_both(0, np.ones(1), np.arange(6.0)[::2])
    with pytest.raises(TypeError, match=r"test_native.py:\d+: float is no array"):
        _scale_number(0, 1.0)
