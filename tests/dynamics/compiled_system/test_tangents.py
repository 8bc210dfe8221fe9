"""Tangents that are marched beside a motion, against extrapolated differences of marches of changed mechanisms."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiled_system.tangents import Direction, TangentSystem
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import half_sine
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import move_positions
from fmd.integrators.runge_kutta import RungeKutta
from fmd.integrators.subcycling import Subcycling
from tests.dynamics.compiler.mechanisms import random_mechanism

TIMES = np.array([0.0, 0.0123, 0.1, 0.25])
STEP = 0.1  # the longest of the differences


class Family:
    """Mechanisms that differ by a number s: springs, rests and dampers, how long loads act, and the start."""

    def __init__(self, seed: int) -> None:
        self.made, self.rng = random_mechanism(seed), np.random.default_rng([seed, 5])
        n = self.made.mechanism.n
        self.turn, self.push = self.rng.normal(size=(2, n))
        self.shares = self.rng.uniform(0.2, 1.0, (len(self.made.mechanism.links), 3))

    def mechanism(self, s: float) -> Mechanism:
        mechanism = self.made.mechanism
        links = [
            replace(
                link, spring=link.spring * (1 + a * s), rest=link.rest * (1 + b * s), damper=link.damper * (1 + c * s)
            )
            for link, (a, b, c) in zip(mechanism.links, self.shares, strict=True)
        ]
        loads = [replace(load, size=half_sine(0.02, 0.3 * (1 + s), 1.5)) for load in mechanism.loads]
        return replace(mechanism, links=links, loads=loads)

    def start(self, s: float) -> tuple[Array, Array]:
        q, v = self.made.state(3)
        return move_positions(self.system(s).parameters, q, s * self.turn), v + s * self.push

    def system(self, s: float) -> CompiledSystem:
        return CompiledSystem(self.mechanism(s))

    def march(self, method: Any, s: float) -> Array:
        found = method.march(self.system(s), *self.start(s), TIMES)
        return np.concatenate([found.q, found.v], axis=1)


def extrapolated(values: Any, rows: int = 4) -> Array:
    """Return the derivative at 0 from central differences over steps that are halved."""
    steps = STEP / 2.0 ** np.arange(rows)
    found = [(np.asarray(values(h)) - np.asarray(values(-h))) / (2.0 * h) for h in steps]
    for k in range(1, rows):
        found = [(4.0**k * b - a) / (4.0**k - 1.0) for a, b in pairwise(found)]
    return np.asarray(found[0])


def direction(family: Family, share: float) -> Direction:
    """Return how the family changes, times a share."""
    steps = ((-1.0, 1e-3), (1.0, 1e-3), (-1.0, 5e-4), (1.0, 5e-4))
    weights = [share * side / (2.0 * h) * (-1.0 / 3.0 if h == 1e-3 else 4.0 / 3.0) for side, h in steps]
    signals = [(family.system(side * h).compiled.signals, w) for (side, h), w in zip(steps, weights, strict=True)]
    q, v = (share * extrapolated(lambda h, k=k: family.start(h)[k]) for k in (0, 1))
    return Direction(share * extrapolated(lambda h: family.system(h).compiled.numbers), signals, q, v)


METHODS = (CentralDifference(2e-3), RungeKutta(1e-12), Subcycling(1e-3, 4))
QUICK = ((1, 1), (16, 0), (16, 1), (2, 2), (16, 2))  # sub-cycled: fast coordinates that couple, and that don't
SLOW = [(0, 0), (8, 1), (37, 0), (44, 1)]  # 8 alone sees a wrong slope of the series for small angles
LONG = [(seed, k) for seed in (0, 1, 2, 8, 13, 37, 44) for k in range(3) if (seed, k) not in (*QUICK, *SLOW, (44, 2))]


@pytest.mark.parametrize(
    ("seed", "k"),
    [
        *QUICK,
        *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW),
        *(pytest.param(*case, marks=pytest.mark.long) for case in LONG),
    ],
)
def test_tangents_of_steps_are_their_extrapolated_differences(seed: int, k: int) -> None:
    """Also where quaternions turn, in each of eight lanes, and between steps; one lane of nothing stays 0.

    Steps that are chosen are those of the motion alone. At a tolerance of 1e-12 they leave little of a difference.
    """
    family, method = Family(seed), METHODS[k]
    system, (q0, v0) = family.system(0.0), family.start(0.0)
    shares = (1.0, -0.5, 0.0, 2.0)
    both: Any = TangentSystem(system, [direction(family, share) for share in shares])
    march = method.march(both, *both.join(q0, v0), TIMES)
    found = np.concatenate(both.part(march.q, march.v), axis=1)
    expected = extrapolated(lambda s: family.march(method, s))
    size = np.abs(expected).max()
    for lane, share in enumerate(shares):
        np.testing.assert_allclose(found[:, :, lane], share * expected, rtol=0, atol=1e-8 * size)
    assert not found[:, :, [2, 4, 5, 6, 7]].any()
    plain = method.march(system, q0, v0, TIMES)
    np.testing.assert_allclose(march.q[:, : system.n_positions], plain.q, rtol=0, atol=(1e-13, 1e-11, 1e-13)[k])
    assert size > 0.1
