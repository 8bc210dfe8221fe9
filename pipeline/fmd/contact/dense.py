"""Dense products and equations of contacts, some by LAPACK's routines, which kernels call by their addresses."""

from __future__ import annotations

import ctypes

import numpy as np

from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array, IntArray
from fmd.core.limits.code import DOUBLES_IN_LINE
from fmd.kernels.kernel import inner
from fmd.kernels.vectors import call_native, fill_vector, read_vector, write_vector

ROUTINES = ("dgetrf", "dgetrs", "dpotrf", "dpotri")
WORDS = np.array([0, 0, 1, 0, ord("T"), ord("L")], dtype=np.int64)
"""What these are called with: order, entries in a row, right sides, whether it failed, transposed, which triangle."""


def lapack_addresses() -> IntArray:
    """Return the addresses of LAPACK's routines."""
    from scipy.linalg import cython_lapack

    name_of, address_of = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    address_of.restype, address_of.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    capsules = [cython_lapack.__pyx_capi__[name] for name in ROUTINES]
    return np.array([address_of(own, name_of(own)) for own in capsules], dtype=np.int64)


@inner
def factor_equations(c: ContactTable, n: int, width: int) -> bool:
    """Factor the n equations in M, of which a row has ``width`` entries; false if they are singular."""
    w = c.words
    w[0], w[1], w[3] = n, width, 0
    call_native(c.lapack[0], (w[0:1], w[0:1], c.M, w[1:2], c.pivots, w[3:4]))
    return bool(w[3] == 0)


@inner
def solve_equations(c: ContactTable, n: int, width: int) -> None:
    """Solve factored equations: the right sides become what is to be found."""
    w = c.words
    w[0], w[1], w[3] = n, width, 0
    call_native(c.lapack[1], (w[4:5], w[0:1], w[2:3], c.M, w[1:2], c.pivots, c.right, w[0:1], w[3:4]))


@inner
def invert_flexibility(c: ContactTable, g: int) -> bool:
    """Fill P, the inverse of D, of a group's chosen points; false if D isn't positive definite."""
    n, stride, at, w = 3 * c.n_chosen[g], c.stride[g], c.first_entry[g, 0], c.words
    c.n_known[g] = 0
    for i in range(n):
        for k in range(stride):
            c.P[at + i * stride + k] = c.D[at + i * stride + k] if k < n else 0.0
    P: Array = c.P[at:]
    for routine in range(2, 4):
        w[0], w[1], w[3] = n, stride, 0
        call_native(c.lapack[routine], (w[5:6], w[0:1], P, w[1:2], w[3:4]))
        if w[3] != 0:
            return False
    for i in range(n):
        for k in range(i):
            P[i * stride + k] = P[k * stride + i]
    return True


@inner
def dot(A: Array, one: int, B: Array, other: int, count: int) -> float:
    """Return the product of numbers of two arrays, in four sums that don't wait for one another."""
    s0, s1, s2, s3, k = 0.0, 0.0, 0.0, 0.0, 0
    while k + 3 < count:
        s0 += A[one + k] * B[other + k]
        s1 += A[one + k + 1] * B[other + k + 1]
        s2 += A[one + k + 2] * B[other + k + 2]
        s3 += A[one + k + 3] * B[other + k + 3]
        k += 4
    while k < count:
        s0 += A[one + k] * B[other + k]
        k += 1
    return (s0 + s1) + (s2 + s3)


@inner
def add_times(A: Array, one: int, times: float, B: Array, other: int, count: int) -> None:
    """Add a number times numbers of another array to those of one."""
    k, many = 0, fill_vector(times, DOUBLES_IN_LINE)
    while k + DOUBLES_IN_LINE <= count:
        more = many * read_vector(B, other + k, DOUBLES_IN_LINE)
        write_vector(A, one + k, read_vector(A, one + k, DOUBLES_IN_LINE) + more)
        k += DOUBLES_IN_LINE
    while k < count:
        A[one + k] += times * B[other + k]
        k += 1


@inner
def add_rows(c: ContactTable, X: Array, g: int, own: int, f0: float, f1: float, f2: float, into: Array) -> None:
    """Add a point's three rows of P or D, times a number each."""
    k, at, stride = 0, c.first_entry[g, 0] + 3 * own * c.stride[g], c.stride[g]
    one = fill_vector(f0, DOUBLES_IN_LINE)
    two, three = fill_vector(f1, DOUBLES_IN_LINE), fill_vector(f2, DOUBLES_IN_LINE)
    while k < 3 * c.n_chosen[g]:
        total = read_vector(into, k, DOUBLES_IN_LINE) + one * read_vector(X, at + k, DOUBLES_IN_LINE)
        total = total + two * read_vector(X, at + stride + k, DOUBLES_IN_LINE)
        write_vector(into, k, total + three * read_vector(X, at + 2 * stride + k, DOUBLES_IN_LINE))
        k += DOUBLES_IN_LINE


@inner
def solve_active(c: ContactTable, g: int) -> None:
    """Solve ``L Lᵀ x = b`` of the active points into b."""
    count = c.n_factored[g]
    size, n = c.width[g], c.first_entry[g, 1]
    for i in range(count):
        row = n + i * size
        c.b[i] = (c.b[i] - dot(c.L, row, c.b, 0, i)) / c.L[row + i]
    for back in range(count):
        i = count - 1 - back
        row = n + i * size
        c.b[i] /= c.L[row + i]
        add_times(c.b, 0, -c.b[i], c.L, row, i)
