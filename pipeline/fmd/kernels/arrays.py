"""Copying and clearing of whole arrays in kernels."""

from fmd.core.arrays import Array
from fmd.kernels.kernel import inlined


@inlined
def copy(x: Array, out: Array) -> None:
    """Fill an array with the first values of another."""
    for i in range(out.size):
        out[i] = x[i]


@inlined
def clear(x: Array) -> None:
    """Fill an array with zeros."""
    for i in range(x.size):
        x[i] = 0.0
