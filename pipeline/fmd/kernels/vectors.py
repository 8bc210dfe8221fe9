"""Vectors within arrays, and calls of machine code by address, as kernels have them and as plain Python runs them."""

import ctypes

import numpy as np

from fmd.core.arrays import Array, IntArray


def read_vector(x: Array, at: int, width: int) -> Array:
    """Return ``width`` entries of an array's memory, from one on, for arithmetic with all of them at once.

    The width is a number that a kernel knows when it is compiled.
    """
    return x.reshape(-1)[at : at + width].copy()


def read_entries(x: Array, at: int, width: int) -> Array:
    """Return what `read_vector` does, read entry by entry.

    A processor waits before it reads a vector where single numbers have just been written.
    """
    return read_vector(x, at, width)


def fill_vector(number: float, width: int) -> Array:
    """Return a vector whose entries are all the same."""
    return np.full(width, number)


def write_vector(x: Array, at: int, vector: Array) -> None:
    """Write a vector into an array's memory, from an entry on."""
    x.reshape(-1)[at : at + np.size(vector)] = vector


def call_native(address: int, arrays: tuple[Array | IntArray, ...]) -> None:
    """Call the C function ``void f(double *, …)`` at an address with the data of arrays, of doubles or whole numbers.

    Nothing can check that the function takes as many, and of these kinds: the address is only a number.
    """
    for x in arrays:
        if not (x.flags.c_contiguous and x.dtype in (np.float64, np.int64)):
            raise TypeError("compiled functions take C-contiguous arrays of 64-bit numbers")
    prototype = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * len(arrays))
    prototype(int(address))(*(x.__array_interface__["data"][0] for x in arrays))
