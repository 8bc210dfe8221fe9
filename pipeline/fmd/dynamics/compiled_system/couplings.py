"""Couplings between a mechanism's coordinates in any state, found by sampling its tangents at random ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mechanism import (
    COUPLED_DEFLECTION,
    COUPLED_STATES,
    COUPLED_TIMES,
    NEGLIGIBLE_DAMPING,
    NEGLIGIBLE_STIFFNESS,
)
from fmd.core.limits.round_off import SOLVED
from fmd.dynamics.compiler.compiled import CompiledMechanism


class Couplings(NamedTuple):
    """Structure of the fast coordinates' equations that holds in any state.

    Attributes
    ----------
    inertial : bool
        Slow and fast coordinates couple through the mass matrix.
    mass : ndarray, shape (n,) or None
        Diagonal of the fast mass matrix, 0 for the slow ones; None if it isn't constant and diagonal.
    elastic : bool
        Fast coordinates couple with each other by stiffness or by rates.
    damped : bool
        Fast accelerations depend on fast rates.
    dragging : bool
        Forces, slow ones or fast ones, depend on fast rates.
    driven : ndarray
        Those of the compiled functions' ``inputs`` that accelerate fast coordinates.
    """

    inertial: bool
    mass: Array | None
    elastic: bool
    damped: bool
    dragging: bool
    driven: IntArray


def find_inertial_coupling(compiled: CompiledMechanism) -> bool:
    """Return whether any coordinates couple through the mass matrix in some state."""
    if compiled.mechanism.closures:
        return True
    masses = (compiled.mass_matrix(inputs, q) for inputs, q, _, _ in _states(compiled))
    return any(_exceed(M, SOLVED * _scale(M)) for M in masses)


def find_couplings(compiled: CompiledMechanism) -> Couplings:
    """Find the structure of the fast coordinates' equations."""
    if compiled.mechanism.closures:  # multipliers act on all coordinates, and by all inputs
        return Couplings(True, None, True, True, True, np.arange(3 * len(compiled.signals)))
    n_slow, states = compiled.mechanism.n_slow, _states(compiled)
    masses = [compiled.mass_matrix(inputs, q) for inputs, q, _, _ in states]
    shift, fast = compiled.mechanism.position_shift, slice(n_slow, None)
    diagonals = [M.diagonal()[fast] for M in masses]
    constant = all(np.allclose(diagonal, diagonals[0], rtol=1e-12, atol=0.0) for diagonal in diagonals)
    single = not any(_exceed(M[fast, fast], SOLVED * _scale(M[fast, fast])) for M in masses)
    mass = np.r_[np.zeros(n_slow), diagonals[0]] if constant and single else None
    elastic = damped = dragging = False
    driven = np.zeros(3 * len(compiled.signals), dtype=bool)
    for inputs, q, v, a in states:
        by_q, by_v, M = compiled.tangents(inputs, q, v, a)
        driven |= np.any(compiled.input_tangents(inputs, q, v, a)[fast, : len(driven)], axis=0)
        K, C = by_q[fast, n_slow + shift :], by_v[fast, fast]
        elastic |= _exceed(K, NEGLIGIBLE_STIFFNESS + SOLVED * _scale(K)) or _exceed(C, NEGLIGIBLE_DAMPING)
        damped |= bool(np.any(np.abs(C) > NEGLIGIBLE_DAMPING * np.sqrt(np.abs(M.diagonal()[fast]))))
        dragging |= bool((np.abs(by_v) > SOLVED * _scale(M))[:, fast].any())
    if compiled.mechanism.efforts:  # which may be saturated at these states, or 0
        elastic = damped = dragging = True
        driven[:] = True
    inertial = any((np.abs(M) > SOLVED * _scale(M))[:n_slow, n_slow:].any() for M in masses)
    return Couplings(inertial, mass, elastic, damped, dragging, np.flatnonzero(driven))


def _exceed(A: Array, limit: Array | float) -> bool:
    """Return whether a matrix has entries off its diagonal beyond a limit."""
    return bool((np.abs(A - np.diag(A.diagonal())) > limit).any())


def _scale(A: Array) -> Array:
    own = np.sqrt(np.abs(A.diagonal()))
    return np.asarray(np.outer(own, own))


def _states(compiled: CompiledMechanism) -> list[tuple[Array, Array, Array, Array]]:
    """Inputs, positions, rates and accelerations of some random states.

    Each load and motion is as large as it gets, so that no short one is missed between the samples.
    """
    mechanism, random, largest = compiled.mechanism, np.random.default_rng(0), _largest_inputs(compiled)
    states = []
    for _ in range(COUPLED_STATES):
        q = random.uniform(-1.0, 1.0, mechanism.n_positions)
        for number, link in enumerate(mechanism.links):
            q[mechanism.modal_positions_of(number)] *= COUPLED_DEFLECTION
            if link.n_positions > link.n_rates:
                last = mechanism.layout.position[number] + link.n_positions
                q[last - 4 : last] /= np.linalg.norm(q[last - 4 : last])
        v, a = random.uniform(-1.0, 1.0, (2, mechanism.n))
        inputs = np.concatenate([random.uniform(0.5, 1.0, len(largest)) * largest, compiled.numbers])
        states.append((inputs, q, v, a))
    return states


def _largest_inputs(compiled: CompiledMechanism) -> Array:
    """Return the largest of each signal's values at even times and between breakpoints; 1 where these are all 0."""
    mechanism = compiled.mechanism
    even = np.linspace(0.0, mechanism.horizon, COUPLED_TIMES)
    breaks = np.unique([0.0, mechanism.horizon, *(t for signal in compiled.signals for t in signal.breakpoints)])
    times = [*even, *(0.5 * (breaks[:-1] + breaks[1:]))]
    values = np.array([compiled.signal_values(t)[: 3 * len(compiled.signals)] for t in times])
    largest = values[np.abs(values).argmax(axis=0), np.arange(values.shape[1])]
    return np.where(largest == 0.0, 1.0, largest)
