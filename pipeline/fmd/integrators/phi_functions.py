"""Functions ``φ_k(z) = ∫₀¹ exp((1 − s) z) s^(k−1)/(k − 1)! ds`` of a matrix, by Taylor polynomials and doubling.

``φ₀`` is the exponential. A polynomial serves a small matrix; ``φ_k(2 z)`` follows from ``φ_j(z)`` (Al-Mohy & Higham,
SIAM J Sci Comput 33, 2011).
"""

from __future__ import annotations

import math

from fmd.core.arrays import Array
from fmd.core.limits.code import SQUARE_SIDE
from fmd.kernels.kernel import contracted, inner
from fmd.kernels.vectors import fill_vector, read_vector, write_vector


@contracted
def _multiply_block(A: Array, B: Array, C: Array, row: int, column: int) -> None:
    """Compute eight rows and columns of ``C = A B``, from a row and a column on, for square matrices."""
    n, a, zeros = A.shape[0], row, fill_vector(0.0, SQUARE_SIDE)
    s0, s1, s2, s3, s4, s5, s6, s7 = zeros, zeros, zeros, zeros, zeros, zeros, zeros, zeros
    for k in range(n):
        entries = read_vector(B, k * n + column, SQUARE_SIDE)
        s0 = s0 + A[a, k] * entries
        s1 = s1 + A[a + 1, k] * entries
        s2 = s2 + A[a + 2, k] * entries
        s3 = s3 + A[a + 3, k] * entries
        s4 = s4 + A[a + 4, k] * entries
        s5 = s5 + A[a + 5, k] * entries
        s6 = s6 + A[a + 6, k] * entries
        s7 = s7 + A[a + 7, k] * entries
    at = row * n + column
    write_vector(C, at, s0)
    write_vector(C, at + n, s1)
    write_vector(C, at + 2 * n, s2)
    write_vector(C, at + 3 * n, s3)
    write_vector(C, at + 4 * n, s4)
    write_vector(C, at + 5 * n, s5)
    write_vector(C, at + 6 * n, s6)
    write_vector(C, at + 7 * n, s7)


@inner
def multiply_square(A: Array, B: Array, C: Array) -> None:
    """Multiply square matrices of one size: ``C = A B``; C overlaps neither. Blocks at the ends overlap others.

    Blocks of eight by eight are summed in vector registers: of a plain triple loop LLVM makes one that loads and stores
    a sum for every product, which has a fourth of the speed, or less, for matrices of 12 to 60 rows.
    """
    n = A.shape[0]
    if n < SQUARE_SIDE:
        for i in range(n):
            for j in range(n):
                total = 0.0
                for k in range(n):
                    total += A[i, k] * B[k, j]
                C[i, j] = total
        return
    for i in range(0, n, SQUARE_SIDE):
        for j in range(0, n, SQUARE_SIDE):
            _multiply_block(A, B, C, min(i, n - SQUARE_SIDE), min(j, n - SQUARE_SIDE))


_NORMS = (0.25, 1.0, 1.8, 2.9)  # up to which φ₄'s Taylor polynomial of degree 8, 12, 16, 20 is exact to round-off
_INVERSES = tuple(1.0 / math.factorial(k) for k in range(26))


@inner
def _taylor_matrices(A: Array, tau: float, norm: float, phi: Array, m: Array) -> None:
    """Fill phi (5, n, n) with φ₀ … φ₄ of ``tau A``, of this norm; m (5, n, n) is room.

    φ₄ is a polynomial in blocks of four powers (Paterson & Stockmeyer, SIAM J Comput 2, 1973); the others follow from
    ``φ_k(z) = z φ_{k+1}(z) + 1/k!``.
    """
    n = A.shape[0]
    B, top, new = m[0], phi[4], m[4]
    for i in range(n):
        for j in range(n):
            B[i, j] = tau * A[i, j]
    for k in range(1, 4):
        multiply_square(B, m[k - 1], m[k])
    blocks = 2
    while blocks < 5 and norm > _NORMS[blocks - 2]:
        blocks += 1
    for i in range(n):
        for j in range(n):
            new[i, j] = _INVERSES[4 * blocks + 4] * m[3, i, j]
    for block in range(blocks - 1, -1, -1):
        c0, c1, c2, c3 = (
            _INVERSES[4 * block + 4],
            _INVERSES[4 * block + 5],
            _INVERSES[4 * block + 6],
            _INVERSES[4 * block + 7],
        )
        for i in range(n):
            for j in range(n):
                top[i, j] = new[i, j] + c1 * B[i, j] + c2 * m[1, i, j] + c3 * m[2, i, j]
            top[i, i] += c0
        if block:
            multiply_square(m[3], top, new)
    for k in range(3, -1, -1):
        multiply_square(B, phi[k + 1], phi[k])
        for i in range(n):
            phi[k, i, i] += _INVERSES[k]


@inner
def _double(phi: Array, out: Array) -> None:
    """Compute φ_k(2z) from φ_k(z): ``φ_k(2z) = 2^-k (φ₀ φ_k + Σ_j φ_j/(k − j)!)``."""
    n = phi.shape[1]
    for k in range(5):
        multiply_square(phi[0], phi[k], out[k])
    half, sixth = _INVERSES[2], _INVERSES[3]
    for i in range(n):  # a row of each at a time: sums of several terms are read and written once
        one, two, three, four = phi[1, i], phi[2, i], phi[3, i], phi[4, i]
        row = out[1, i]
        for j in range(n):
            row[j] = 0.5 * (row[j] + one[j])
        row = out[2, i]
        for j in range(n):
            row[j] = 0.25 * (row[j] + two[j] + one[j])
        row = out[3, i]
        for j in range(n):
            row[j] = 0.125 * (row[j] + three[j] + two[j] + half * one[j])
        row = out[4, i]
        for j in range(n):
            row[j] = 0.0625 * (row[j] + four[j] + three[j] + half * two[j] + sixth * one[j])


@inner
def fill_phi_functions(A: Array, half: float, levels: Array, m: Array) -> int:
    """Fill levels[0 … top] with φ₀ … φ₄ of ``half A 2^(level − top)`` and return the top; -1 if they are too few."""
    norm, top = half * _norm(A), 0
    while norm > _NORMS[3] and top < levels.shape[0]:
        norm *= 0.5
        top += 1
    if top == levels.shape[0] or not math.isfinite(norm):
        return -1
    _taylor_matrices(A, half * 0.5**top, norm, levels[0], m)
    for level in range(top):
        _double(levels[level], levels[level + 1])
    return top


@inner
def _norm(A: Array) -> float:
    """Return the largest sum of a row's sizes; NaN if an entry is one."""
    norm, all_rows = 0.0, 0.0
    for i in range(A.shape[0]):
        total = 0.0
        for j in range(A.shape[0]):
            total += abs(A[i, j])
        norm = max(norm, total)
        all_rows += total  # a sum: it keeps a NaN, which max would lose
    return norm if math.isfinite(all_rows) else math.nan
