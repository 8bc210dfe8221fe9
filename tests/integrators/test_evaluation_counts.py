"""How often an integrator asks the mechanism, counted by a mechanism that counts."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.parameters import Responses
from fmd.dynamics.system import (
    PlainSystem,
    accelerations,
    advance,
    fast_steps,
    find_responses,
    freeze_slow,
    leapfrog_step,
)
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.subcycling import Subcycling
from fmd.kernels.table import Table

Method = Callable[[float], CentralDifference | Subcycling | ReversibleSubcycling]


@dataclass(frozen=True)
class Counted(Table):
    """Two oscillators, the first one slow, that count how often they are asked."""

    calls: Array  # (3,) of each of the functions below
    stiffness: Array  # (2,)


@accelerations.register(Counted)
def _accelerations(p: Counted, t: float, q: Array, v: Array, a: Array) -> None:
    p.calls[0] += 1
    for i in range(q.size):
        a[i] = -p.stiffness[i] * q[i]


@leapfrog_step.register(Counted)
def _leapfrog_step(p: Counted, leapfrog: Array, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    accelerations(p, t, q, v, a)
    for i in range(q.size):
        v[i] += h * a[i]
        q[i] += h * v[i]


@freeze_slow.register(Counted)
def _freeze_slow(p: Counted, t: float, q: Array, v: Array, a: Array, frozen: Array) -> None:
    p.calls[1] += 1


@fast_steps.register(Counted)
def _fast_steps(p: Counted, frozen: Array, first: int, h: float, count: int, q: Array, v: Array, a: Array) -> None:
    for _ in range(count):
        p.calls[2] += 1
        a[1] = -p.stiffness[1] * q[1]
        v[1] += h * a[1]
        q[1] += h * v[1]


@advance.register(Counted)
def _advance(p: Counted, q: Array, v: Array, h: float, first: int, last: int) -> None:
    for i in range(first, last):
        q[i] += h * v[i]


@find_responses.register(Counted)
def _find_responses(p: Counted, responses: Responses, t: float, q: Array, v: Array, a: Array, X: Array) -> None:
    accelerations(p, t, q, v, a)
    X[0, 0, 0], X[0, 1, 1] = 1.0, 1.0


@dataclass(frozen=True)
class Oscillators(PlainSystem):
    parameters: Counted

    n = 2
    n_positions = 2
    n_slow = 1
    stiffness = np.array([1.0, 100.0])
    coupled = False
    highest_frequency = 10.0
    highest_fast_frequency = 10.0
    largest_step = largest_fast_step = 0.2

    def frozen(self, cycle: float) -> Array:
        return np.zeros(1)

    linear_matrices = np.eye(2), np.diag(stiffness), np.zeros((2, 2))

    def responses(self) -> Responses:
        return Responses(0, 0, 0, 0, np.zeros((1, 2, 8)))

    def leapfrog(self) -> Array:
        return np.zeros(1)


@pytest.fixture
def oscillators() -> Oscillators:
    return Oscillators(Counted(np.zeros(3), Oscillators.stiffness))


@pytest.mark.parametrize("spacing", [1.0, 3.0, 0.31])
def test_evaluations_are_counted_as_they_happen(oscillators: Oscillators, method: Method, spacing: float) -> None:
    times = 0.01 * np.arange(0.0, 1000.5, spacing)
    march = method(0.01).march(oscillators, np.ones(2), np.zeros(2), times)
    assert march.evaluations == oscillators.parameters.calls[0]
    assert march.fast_evaluations == oscillators.parameters.calls[2]


@pytest.mark.parametrize("m", [1, 2, 5, 10])
def test_sub_cycling_solves_the_whole_once_a_cycle(oscillators: Oscillators, m: int) -> None:
    # 1000 steps and one more that the last output time begins, in whole cycles, and the start.
    march = Subcycling(0.01, m).march(oscillators, np.ones(2), np.zeros(2), np.array([10.0]))
    cycles = 1000 // m + 1
    assert march.end.step == cycles * m
    assert march.evaluations == cycles + 1
    assert march.fast_evaluations == cycles * (m - 1)
    plain = CentralDifference(0.01).march(oscillators, np.ones(2), np.zeros(2), np.array([10.0]))
    assert (plain.evaluations, plain.fast_evaluations) == (1002, 0)


def test_a_resumed_march_counts_what_it_adds(oscillators: Oscillators, method: Method) -> None:
    times = np.array([3.0, 10.0])
    first = method(0.01).march(oscillators, np.ones(2), np.zeros(2), times[:1])
    before = oscillators.parameters.calls.copy()
    second = method(0.01).resume(oscillators, first.end, times)
    added: Any = oscillators.parameters.calls - before
    assert second.evaluations == added[0]
    assert second.fast_evaluations == added[2]


def test_each_oscillator_takes_steps_of_its_own_length(oscillators: Oscillators, method: Method) -> None:
    # Uncoupled, so that leapfrog's discrete cosine holds for each with its own step: q_n = cos(2n arcsin(ωh/2)).
    march = method(0.01).march(oscillators, np.ones(2), np.zeros(2), 0.01 * np.arange(0, 1001, 10))
    major = 0.01 * (1 if march.integrator.startswith("reversible") else march.substeps)
    slow = np.cos(2 * (march.times / major) * np.arcsin(major / 2))
    fast = np.cos(2 * (march.times / 0.01) * np.arcsin(10 * 0.01 / 2))
    assert march.q == pytest.approx(np.column_stack([slow, fast]), abs=1e-11)
