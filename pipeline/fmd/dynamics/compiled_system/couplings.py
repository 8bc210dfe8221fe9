"""Couplings between a mechanism's coordinates in any state, found by sampling its tangents at random ones."""

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits import mechanism as limits
from fmd.core.limits.memory import MOST_SHARED
from fmd.core.limits.round_off import SOLVED
from fmd.core.recently_used import RecentlyUsed
from fmd.dynamics.compiler.compiled import CompiledMechanism


class Couplings(NamedTuple):
    """Structure of the fast coordinates' equations that holds in any state."""

    inertial: bool  # slow and fast coordinates couple through the mass matrix
    # (n,) or None: diagonal of the fast mass matrix, 0 for the slow ones; None if it isn't constant and diagonal
    mass: Array | None
    elastic: bool  # fast coordinates couple with each other by stiffness or by rates
    damped: bool  # fast accelerations depend on fast rates
    dragging: bool  # forces, slow ones or fast ones, depend on fast rates
    driven: IntArray  # those of the compiled functions' ``inputs`` that accelerate fast coordinates


class _Sample(NamedTuple):
    """A random state: signals' part of the inputs (3 n_signals,), positions, rates, accelerations, and M̂ there."""

    inputs: Array
    q: Array
    v: Array
    a: Array
    M: Array


@dataclass(frozen=True)
class _Structure:
    """Parts that mechanisms share which differ in numbers of joints alone, of which only forces' slopes depend."""

    samples: tuple[_Sample, ...]
    n_slow: int

    @cached_property
    def masses(self) -> list[Array]:
        return [at.M for at in self.samples]

    @cached_property
    def mass(self) -> Array | None:
        """Diagonal of the fast mass matrix, if it is constant and diagonal."""
        blocks = [M[self.n_slow :, self.n_slow :] for M in self.masses]
        diagonals = [M.diagonal() for M in blocks]
        constant = all(np.allclose(diagonal, diagonals[0], rtol=1e-12, atol=0.0) for diagonal in diagonals)
        single = not any(_exceed(M, SOLVED * _scale(M)) for M in blocks)
        return np.r_[np.zeros(self.n_slow), diagonals[0]] if constant and single else None

    @cached_property
    def inertial(self) -> bool:
        """True if slow and fast coordinates couple through the mass matrix."""
        n_slow = self.n_slow
        return any((np.abs(M) > SOLVED * _scale(M))[:n_slow, n_slow:].any() for M in self.masses)


_structures: RecentlyUsed[_Structure] = RecentlyUsed(MOST_SHARED)


def find_inertial_coupling(compiled: CompiledMechanism) -> bool:
    """Return whether any coordinates couple through the mass matrix in some state."""
    if compiled.mechanism.closures:
        return True
    return any(_exceed(M, SOLVED * _scale(M)) for M in _structure_of(compiled).masses)


def find_couplings(compiled: CompiledMechanism) -> Couplings:
    """Find the structure of the fast coordinates' equations."""
    if compiled.mechanism.closures:  # multipliers act on all coordinates, and by all inputs
        return Couplings(True, None, True, True, True, np.arange(3 * len(compiled.signals)))
    structure, n_slow = _structure_of(compiled), compiled.mechanism.n_slow
    shift, fast = compiled.mechanism.position_shift, slice(n_slow, None)
    elastic = damped = dragging = False
    driven = np.zeros(3 * len(compiled.signals), dtype=bool)
    for at in structure.samples:
        inputs = np.concatenate([at.inputs, compiled.numbers])
        by_q, by_v, M = compiled.tangents(inputs, at.q, at.v, at.a)
        driven |= np.any(compiled.input_tangents(inputs, at.q, at.v, at.a)[fast, : len(driven)], axis=0)
        K, C = by_q[fast, n_slow + shift :], by_v[fast, fast]
        elastic |= _exceed(K, limits.NEGLIGIBLE_STIFFNESS + SOLVED * _scale(K)) or _exceed(C, limits.NEGLIGIBLE_DAMPING)
        damped |= bool(np.any(np.abs(C) > limits.NEGLIGIBLE_DAMPING * np.sqrt(np.abs(M.diagonal()[fast]))))
        dragging |= bool((np.abs(by_v) > SOLVED * _scale(M))[:, fast].any())
    if compiled.mechanism.efforts:  # which may be saturated at these states, or 0
        elastic = damped = dragging = True
        driven[:] = True
    return Couplings(structure.inertial, structure.mass, elastic, damped, dragging, np.flatnonzero(driven))


def _exceed(A: Array, limit: Array | float) -> bool:
    """Return whether a matrix has entries off its diagonal beyond a limit."""
    return bool((np.abs(A - np.diag(A.diagonal())) > limit).any())


def _scale(A: Array) -> Array:
    own = np.sqrt(np.abs(A.diagonal()))
    return np.asarray(np.outer(own, own))


def _structure_of(compiled: CompiledMechanism) -> _Structure:
    """Return what some random states tell, found once for mechanisms that differ in numbers of joints alone.

    Each load and motion is as large as it gets, so that no short one is missed between the samples.
    """
    masses = (*compiled.numbers.tolist(),) if compiled.mechanism.lifted else ()
    key = (compiled.digest, compiled.signals, compiled.mechanism.horizon, masses)
    return _structures.get(key, lambda: _Structure(tuple(_make_samples(compiled)), compiled.mechanism.n_slow))


def _make_samples(compiled: CompiledMechanism) -> Iterator[_Sample]:
    mechanism, random, largest = compiled.mechanism, np.random.default_rng(0), _largest_inputs(compiled)
    for _ in range(limits.COUPLED_STATES):
        q = random.uniform(-1.0, 1.0, mechanism.n_positions)
        for number, link in enumerate(mechanism.links):
            q[mechanism.modal_positions_of(number)] *= limits.COUPLED_DEFLECTION
            if link.n_positions > link.n_rates:
                last = mechanism.layout.position[number] + link.n_positions
                q[last - 4 : last] /= np.linalg.norm(q[last - 4 : last])
        v, a = random.uniform(-1.0, 1.0, (2, mechanism.n))
        inputs = random.uniform(0.5, 1.0, len(largest)) * largest
        yield _Sample(inputs, q, v, a, compiled.mass_matrix(np.concatenate([inputs, compiled.numbers]), q))


def _largest_inputs(compiled: CompiledMechanism) -> Array:
    """Return the largest of each signal's values at even times and between breakpoints; 1 where these are all 0."""
    mechanism = compiled.mechanism
    even = np.linspace(0.0, mechanism.horizon, limits.COUPLED_TIMES)
    breaks = np.unique([0.0, mechanism.horizon, *(t for signal in compiled.signals for t in signal.breakpoints)])
    times = [*even, *(0.5 * (breaks[:-1] + breaks[1:]))]
    values = np.array([compiled.signal_values(t)[: 3 * len(compiled.signals)] for t in times])
    largest = values[np.abs(values).argmax(axis=0), np.arange(values.shape[1])]
    return np.where(largest == 0.0, 1.0, largest)
