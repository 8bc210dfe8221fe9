"""Flat arrays of a linear system that the integrators' compiled kernels read and write."""

from __future__ import annotations

from typing import NamedTuple

from fmd.core.arrays import Array


class LinearParameters(NamedTuple):
    """Constants of ``a = −A q − B v`` and of the fast coordinates' ``a_S = −W (K_SS q_S + C_SS v_S + held)``.

    Matrices lie in memory by columns, so that products run over one column after another in vector instructions.
    B, C and C_SS have no columns if no term depends on the rates.
    """

    n_slow: int
    A: Array  # (n, n) M⁻¹ K
    B: Array  # (n, n or 0) M⁻¹ C
    M: Array  # (n, n)
    C: Array  # (n, n or 0)
    K: Array  # (n, n)
    K_SS: Array  # (n_fast, n_fast)
    C_SS: Array  # (n_fast, n_fast or 0)
    W: Array  # (n_fast, n_fast) M_SS⁻¹
    v_now: Array  # (n_fast,), room to work in


class FrozenLinear(NamedTuple):
    """Forces of the slow coordinates on the fast ones over a cycle: ``held = K_SL q_L + C_SL v_L + M_SL a_L``."""

    held: Array  # (n_fast,)
    right: Array  # (n_fast,), room to work in


class MiddleLinear(NamedTuple):
    """Equations of the fast coordinates with ``y = q_L + D q_S`` held, and the state at the middle of a cycle."""

    D: Array  # (n, n_slow), a row for each fast rate
    W: Array  # (n_fast, n_fast) S̄⁻¹
    V: Array  # (n_slow, n_slow) M_LL⁻¹
    T: Array  # (n, n_fast)
    K: Array  # (n, n_fast) K T
    C: Array  # (n, n_fast) C T
    Q: Array  # (n,) forces at the middle
    q: Array  # (n,) positions q* at the middle
    v: Array  # (n,) rates v* at the middle
    now: Array  # (n,), room to work in
    right: Array  # (n,)
