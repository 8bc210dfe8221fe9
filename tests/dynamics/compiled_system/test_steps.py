"""Steps of compiled systems on random chains: orders, identities, restarts, output times, limits."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system import system as system_module
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import constant
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import State
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.integrators.subcycling import Subcycling
from fmd.scene.joints.fixed import FIXED
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE

Make = Callable[..., Any]

WEIGHT = (1.0, -2.0, -9.81)  # aslant, so that no axis of the ground is special
CLOSELY = ScipyIvp("DOP853", 1e-11)
TIMES = np.linspace(0.0, 1.0, 11)
METHODS = pytest.mark.parametrize(
    "method",
    [CentralDifference(1e-3), Subcycling(1e-3, 5), ReversibleSubcycling(1e-3, 5)],
    ids=["plain", "5:1", "reversible 5:1"],
)


@pytest.fixture(scope="module")
def closely(chain: Make) -> Callable[[str], Any]:
    """Call for a closely integrated motion of a chain, which tests have in common."""

    @cache
    def march(name: str) -> Any:
        some = chain(name, gravity=WEIGHT)
        return CLOSELY.march(some.system, *some.state(10), TIMES)

    return march


def order_of(march: Callable[[float], Any], want: Any, steps: Array) -> tuple[float, float]:
    """Measured orders of positions and rates."""
    errors = [(np.abs(found.q - want.q).max(), np.abs(found.v - want.v).max()) for found in map(march, steps)]
    fit = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    return float(fit[0]), float(fit[1])


def test_central_difference_is_of_second_order_on_any_chain(
    chain: Make, closely: Callable[[str], Any], name: str
) -> None:
    some = chain(name, gravity=WEIGHT)
    start, times, steps = some.state(10), TIMES, 0.004 / 2.0 ** np.arange(3)
    want = closely(name)
    found = order_of(lambda step: CentralDifference(step).march(some.system, *start, times), want, steps)
    assert found == pytest.approx((2, 2), abs=0.1)


def test_central_difference_is_of_second_order_between_its_steps(chain: Make) -> None:
    some = chain("free-flexible", gravity=WEIGHT)
    start, steps = some.state(10), 0.004 / 2.0 ** np.arange(3)
    times = np.sort(np.random.default_rng(0).uniform(0.0, 1.0, 300))
    want = CLOSELY.march(some.system, *start, times)
    found = order_of(lambda step: CentralDifference(step).march(some.system, *start, times), want, steps)
    assert found == pytest.approx((2, 2), abs=0.1)


def test_sub_cycling_is_at_least_of_first_order_on_any_chain(
    chain: Make, closely: Callable[[str], Any], name: str
) -> None:
    # All these chains couple through their mass matrix: a slow acceleration frozen over a cycle is late by half of it.
    some = chain(name, gravity=WEIGHT)
    start, times, steps = some.state(10), TIMES, 0.002 / 2.0 ** np.arange(3)
    want = closely(name)
    found = order_of(lambda step: Subcycling(step, 5).march(some.system, *start, times), want, steps)
    assert Subcycling(1.0, 5).order(some.system) == 1
    assert min(found) > 0.9


def test_reversible_sub_cycling_is_of_second_order_on_any_chain(
    chain: Make, closely: Callable[[str], Any], name: str
) -> None:
    some = chain(name, gravity=WEIGHT)
    start, times, steps = some.state(10), TIMES, 0.002 / 2.0 ** np.arange(3)
    want = closely(name)
    found = order_of(lambda step: ReversibleSubcycling(step, 5).march(some.system, *start, times), want, steps)
    assert found == pytest.approx((2, 2), abs=0.15)


@pytest.mark.parametrize("m", [2, 5, 10])
@pytest.mark.parametrize("joint", [FIXED, PRISMATIC, REVOLUTE])
def test_a_body_with_no_slow_joint_is_sub_cycled_as_by_central_difference(chain: Make, joint: int, m: int) -> None:
    # Where nothing is slow all steps are fast steps. The body's equations are linear, with dampers: on a fixed or
    # prismatic joint without weight by themselves, and on a revolute one near rest (turned by 1e-8 rad).
    link = replace(chain("revolute-flexible").tree.links[0], joint=joint, load=constant(0.0), rest=0.0)
    if joint != REVOLUTE:
        link = replace(link, joint_rotation=np.zeros(0))
    if joint == FIXED:
        link = replace(link, spring=0.0, damper=0.0)
    system = CompiledSystem(Mechanism([link], [link.name] if joint != FIXED else []))
    assert system.n_slow == 0
    q0, times = 1e-8 * np.random.default_rng(0).normal(size=system.n), np.linspace(0.0, 10.0, 101)
    plain = CentralDifference(0.04).march(system, q0, np.zeros(system.n), times)
    sub_cycled = Subcycling(0.04, m).march(system, q0, np.zeros(system.n), times)
    assert sub_cycled.q == pytest.approx(plain.q, abs=1e-14)
    assert np.abs(plain.q[-1]).max() < 0.7 * np.abs(q0).max()  # the dampers show


def assert_same_state(one: State, other: State) -> None:
    assert one.step == other.step
    for field in "qva":
        assert np.array_equal(getattr(one, field), getattr(other, field))


def test_one_to_one_sub_cycling_is_central_difference_bit_for_bit(chain: Make, name: str) -> None:
    some = chain(name, gravity=WEIGHT)
    start, times = some.state(12), np.linspace(0.0, 2.0, 77)
    methods = (CentralDifference(0.002), Subcycling(0.002, 1))
    plain, one = (method.march(some.system, *start, times) for method in methods)
    assert np.array_equal(plain.q, one.q)
    assert np.array_equal(plain.v, one.v)
    assert_same_state(plain.end, one.end)
    assert Subcycling(1.0, 1).order(some.system) == CentralDifference(1.0).order(some.system) == 2


@METHODS
def test_a_march_goes_on_from_its_end_bit_for_bit(chain: Make, name: str, method: Any) -> None:
    some = chain(name, gravity=WEIGHT)
    start, times = some.state(13), np.linspace(0.0, 1.0, 41)
    whole = method.march(some.system, *start, times)
    part = method.march(some.system, *start, times[:17])
    rest = method.resume(some.system, part.end, times)
    later = times > part.end.step * method.step
    assert later.sum() >= 20
    assert np.array_equal(rest.q[later], whole.q[later])
    assert np.array_equal(rest.v[later], whole.v[later])
    assert_same_state(rest.end, whole.end)


@METHODS
def test_output_times_never_change_the_steps(chain: Make, name: str, method: Any) -> None:
    some = chain(name, gravity=WEIGHT)
    start = some.state(14)
    few = np.array([0.0, 0.5, 1.0])
    many = np.union1d(few, np.random.default_rng(0).uniform(0.0, 1.0, 400))
    seldom, often = method.march(some.system, *start, few), method.march(some.system, *start, many)
    assert np.array_equal(seldom.q, often.q[np.isin(many, few)])
    assert np.array_equal(seldom.v, often.v[np.isin(many, few)])
    assert_same_state(seldom.end, often.end)


@METHODS
def test_two_marches_at_once_would_not_share_room(chain: Make, method: Any) -> None:
    # The same march before and after another one on the same mechanism.
    some = chain("free-flexible", gravity=WEIGHT)
    times = np.linspace(0.0, 0.5, 6)
    before = method.march(some.system, *some.state(15), times)
    method.march(some.system, *some.state(16), times)
    after = method.march(some.system, *some.state(15), times)
    assert np.array_equal(before.q, after.q)


def test_a_slow_oscillator_limits_the_sub_cycled_step_by_its_own_long_one() -> None:
    # A mass of 2 kg on a spring of 8 N/m: ω = 2 rad/s, so m h < 2/ω = 1 s (central difference's limit).
    integrals = rigid_integrals(2.0, np.zeros(3), np.eye(3))
    system = CompiledSystem(Mechanism([Link("a", integrals, PRISMATIC, spring=8.0)]))
    assert Subcycling(1.0, 10).largest_step(system) == pytest.approx(0.1, rel=1e-12)


def test_a_long_mechanism_steps_by_its_accelerations_as_by_a_function_of_its_own(
    chain: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = chain("many-roots", gravity=WEIGHT)  # none of its bodies turns in space
    assert some.system.leapfrog().leap
    method, start = CentralDifference(2e-3), some.state(10)
    own = method.march(some.system, *start, TIMES)
    monkeypatch.setattr(system_module, "MOST_IN_LEAP", 0)
    by_accelerations = CompiledSystem(some.system.mechanism)
    assert not by_accelerations.leapfrog().leap
    found = method.march(by_accelerations, *start, TIMES)
    for a, b in ((found.q, own.q), (found.v, own.v)):
        assert np.abs(a - b).max() < 1e-9 * np.abs(b).max()
