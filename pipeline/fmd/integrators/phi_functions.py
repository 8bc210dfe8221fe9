"""Functions ``φ_k(z) = ∫₀¹ exp((1 − s) z) s^(k−1)/(k − 1)! ds`` of a matrix, by Taylor polynomials and doubling.

``φ₀`` is the exponential. A polynomial serves a small matrix; ``φ_k(2 z)`` follows from ``φ_j(z)`` (Al-Mohy & Higham,
SIAM J Sci Comput 33, 2011).
"""

from __future__ import annotations

import math

from fmd.core.arrays import Array
from fmd.integrators.products import multiply_square
from fmd.kernels.kernel import inner

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
