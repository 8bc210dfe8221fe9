"""A major cycle as one compiled function is the same cycle in its parts: accelerations, tangents, and steps in turn."""

from dataclasses import replace

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.formula import CONSTANT, MULTIPLY, TIME
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.signals.signal import PROGRAM, Signal, Term, constant
from fmd.integrators.subcycling import Subcycling
from tests.dynamics.compiler.mechanisms import random_mechanism

UNCOUPLED = (14, 16, 23, 26, 33, 46)  # of the random mechanisms: without coupled fast coordinates, loops or quaternions
SAMPLES = "times=['0 s', '4 ms', '1 s'], values=[0, 0.02, 0], unit='N m'"
DRIVES = {
    "none": [],
    "damped modes": ["body.beam.modes.damping=0.02"],
    "slow modes": ["simulation.run.1.split=500 Hz"],
    "formula": ["drive.spin_up={type='torque', joint='hub', torque={formula='0.02*sin(300*t)', unit='N m'}}"],
    "table": [f"drive.spin_up={{type='torque', joint='hub', torque={{{SAMPLES}}}}}"],
    "motion": ["drive.spin_up={type='motion', joint='hub', angle={formula='3*t**2 + 0.01*sin(200*t)', unit='rad'}}"],
}


def march_both(
    monkeypatch: pytest.MonkeyPatch, system: CompiledSystem, q0: Array, v0: Array, h: float, m: int, times: Array
) -> tuple[Array, Array]:
    assert system.takes_whole_cycles
    whole = Subcycling(h, m).march(system, q0, v0, times)
    with monkeypatch.context() as patch:
        patch.setattr(CompiledSystem, "cycle", lambda *_: None)
        parts = Subcycling(h, m).march(system, q0, v0, times)
    return np.hstack([whole.q, whole.v]), np.hstack([parts.q, parts.v])


@pytest.mark.parametrize("m", [2, 5, 10])
@pytest.mark.parametrize("seed", UNCOUPLED)
def test_a_cycle_of_random_mechanisms_is_that_in_parts(seed: int, m: int, monkeypatch: pytest.MonkeyPatch) -> None:
    made = random_mechanism(seed)
    q0, v0 = made.state(seed)
    system = CompiledSystem(made.mechanism)
    whole, parts = march_both(monkeypatch, system, q0, 0.5 * v0, 0.002, m, np.linspace(0.0, 0.2, 23))
    assert np.abs(whole - parts).max() < 1e-12 * np.abs(parts).max()


@pytest.mark.parametrize("m", [3, 10, 20])
@pytest.mark.parametrize("drive", DRIVES)
def test_a_cycle_of_the_driven_beam_is_that_in_parts(drive: str, m: int, monkeypatch: pytest.MonkeyPatch) -> None:
    plans = list(Pipeline(load_scene("beam-paper", DRIVES[drive])).plans.values())
    system, (q0, v0) = plans[1].system, plans[1].start
    times = np.linspace(0.0, 0.011, 41)
    whole, parts = march_both(monkeypatch, system, q0, v0, 1e-5, m, times)
    assert np.abs(whole - parts).max() < 1e-11 * np.abs(parts).max()


@pytest.mark.parametrize("drive", ["none", "formula", "damped modes"])
def test_output_times_change_no_bit_of_a_cycle_and_its_state_goes_on(drive: str) -> None:
    plan = list(Pipeline(load_scene("beam-paper", DRIVES[drive])).plans.values())[1]
    method, system, start = Subcycling(1e-5, 10), plan.system, plan.start
    end, dense = np.array([0.0, 0.0042]), np.unique(np.r_[np.linspace(0.0, 0.0042, 733), 0.0042])
    few, many = (method.march(system, *start, times) for times in (end, dense))
    part = method.march(system, *start, np.array([0.0, 0.0017]))
    rest = method.resume(system, part.end, end)
    for one, two, three in zip(*((x.end.q, x.end.v, x.end.a) for x in (few, many, rest)), strict=True):
        assert (one == two).all()
        assert (one == three).all()
    assert (few.q[-1] == many.q[-1]).all()


def test_a_load_that_ends_with_a_jump_where_a_cycle_begins_acts_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = list(Pipeline(load_scene("beam-paper")).plans.values())[1]
    link = plan.mechanism.links[0]
    jump = Term(PROGRAM, (TIME, CONSTANT, MULTIPLY), (40.0,), support=(0.0, 0.001))  # up to 0.04 N m
    links = [replace(link, load=Signal((jump,), (0.0, 0.001)))]
    system = CompiledSystem(replace(plan.mechanism, links=links))
    whole, parts = march_both(monkeypatch, system, *plan.start, 1e-5, 10, np.linspace(0.0, 0.003, 31))
    assert np.abs(whole - parts).max() < 1e-11 * np.abs(parts).max()


@pytest.mark.parametrize("after", [0.0, 0.02])
def test_accelerations_after_a_load_are_by_what_acts_then(after: float, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = list(Pipeline(load_scene("beam-paper")).plans.values())[1]
    link = plan.mechanism.links[0]
    until = 0.00104  # within a cycle, so that the load of the last cycle in which it varies isn't 0
    pulse = Term(PROGRAM, (TIME, CONSTANT, MULTIPLY), (40.0,), support=(0.0, until))
    load = Signal((pulse, *constant(after).terms), (0.0, until))
    system = CompiledSystem(replace(plan.mechanism, links=[replace(link, load=load)]))
    times = np.linspace(0.0, 0.003, 31)
    whole = Subcycling(1e-5, 10).march(system, *plan.start, times).end
    monkeypatch.setattr(CompiledSystem, "cycle", lambda *_: None)
    parts = Subcycling(1e-5, 10).march(system, *plan.start, times).end
    fast = slice(system.n_slow, None)  # each set's own are those of its last step
    np.testing.assert_allclose(whole.a[fast], parts.a[fast], rtol=0.0, atol=1e-11 * np.abs(parts.a[fast]).max())
