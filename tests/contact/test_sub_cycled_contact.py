"""Sub-cycling of bodies that touch, against central differences with the fast step."""

from typing import Any

import numpy as np
import pytest

from fmd import Pipeline
from fmd.core.arrays import Array
from fmd.recovery.motion import Motion
from tests.contact.test_contact_in_mechanisms import FALLING, arm, closed
from tests.contact.test_contact_points import block

STEP = "1.25e-6 s"
FALLING_BLOCK = (
    'joint.free.rotate=["2 deg", "0 deg", "3 deg"]',
    'joint.free.position=["0 m", "58 mm", "0 m"]',
    'joint.free.velocity=["0 m/s", "-1 m/s", "0 m/s"]',
    "contact.floor.damping=2 us",
    "simulation.step=0.6 us",
    "simulation.duration=4 ms",
    "simulation.output_step=50 us",
)
SUB_CYCLED = ('simulation.run.0.integrator="sub-cycling"', "simulation.run.0.substeps=8")


def at_step(make: Any, *overrides: str) -> Motion:
    run: Pipeline = make(f"simulation.step={STEP}", *overrides)
    return run.motion


def energy_change(motion: Motion) -> float:
    """Return how much energy, with contact's, differs at the end from that of the start, over the largest kinetic."""
    kinetic, potential = motion.energies
    (own,) = motion.contacts.values()
    whole = kinetic + potential + own.energy + own.friction_work + own.damping_work
    return float(abs(whole[-1] - whole[0]) / kinetic.max())


@pytest.mark.parametrize(
    ("make", "overrides"),
    [
        (arm, (*FALLING, "contact.stop.friction=0.3", "simulation.run.0.forces=tangents")),
        (arm, (*FALLING, "contact.stop.friction=0.3", "simulation.run.0.forces=carried")),
        pytest.param(closed, (), marks=pytest.mark.long),
        (block, FALLING_BLOCK),
    ],
    ids=["tangents", "carried", "loop", "flight"],
)
def test_a_sub_cycled_shock_is_that_of_the_fast_step(make: Any, overrides: tuple[str, ...]) -> None:
    """Impulse and times are those of small steps for all; forces held over a cycle would multiply the energy."""
    motion = at_step(make, *SUB_CYCLED, *overrides)
    plain = at_step(make, *SUB_CYCLED, *overrides, "simulation.run.0.substeps=1")
    (exact,), (found,) = plain.contacts.values(), motion.contacts.values()
    size = np.abs(exact.impulse).max()
    assert size > 0.0
    np.testing.assert_allclose(found.impulse, exact.impulse, atol=2e-3 * size)
    assert found.span == pytest.approx(exact.span, rel=1e-2)
    assert energy_change(motion) < energy_change(plain) + 1e-3
    assert np.abs(found.energy_error).max() < np.abs(exact.energy_error).max() + 1e-4 * plain.energies[0].max()


def test_apart_from_contacts_cycles_are_those_of_the_scene_without_them() -> None:
    overrides = (*FALLING, *SUB_CYCLED, "simulation.duration=1.5 ms")
    touching, free = at_step(arm, *overrides), at_step(arm, *overrides, "contact={}")
    assert touching.contacts["stop"].span == (None, None)
    assert touching.trajectory.evaluations < 2 * free.trajectory.evaluations
    np.testing.assert_allclose(touching.trajectory.q, free.trajectory.q, rtol=0.0, atol=1e-13)


def test_output_times_do_not_change_the_steps_through_a_shock() -> None:
    one, many = (at_step(arm, *FALLING, *SUB_CYCLED, f"simulation.output_step={step}") for step in ("2 us", "0.4 ms"))
    q, impulse = many.trajectory.q, many.contacts["stop"].impulse  # factors are kept while bodies turn by little
    np.testing.assert_allclose(one.trajectory.q[::200], q, rtol=0.0, atol=1e-6 * np.abs(q).max())
    np.testing.assert_allclose(one.contacts["stop"].impulse[::200], impulse, rtol=0.0, atol=1e-6 * impulse.max())


def march_in_two_parts(run: Pipeline) -> tuple[Array, Array]:
    """Return the coordinates of the second half of a run, marched on from the first, and those of the whole march."""
    (plan,) = run.plans.values()
    method, times = plan.integrator, run.output_times
    first = method.march(plan.system, *plan.start, times[: len(times) // 2])
    second = method.resume(plan.system, first.end, times)  # type: ignore[attr-defined]
    later = np.isfinite(second.q[:, 0])
    assert 0.3 < later.mean() < 0.6
    return second.q[later], run.motion.trajectory.q[later]


def test_a_march_goes_on_from_the_middle_of_a_shock() -> None:
    run = arm(f"simulation.step={STEP}", *FALLING, *SUB_CYCLED)
    second, whole = march_in_two_parts(run)
    np.testing.assert_allclose(second, whole, rtol=0.0, atol=1e-5 * np.abs(run.motion.trajectory.q).max())


def test_vibrations_in_place_of_a_cycle_of_slow_modes_keep_the_step_of_a_shock() -> None:
    """Modes below 3 kHz are slow, and the shock drives them, too."""
    split = (*FALLING, *SUB_CYCLED, "simulation.run.0.split=3 kHz", "simulation.run.0.substeps=4")
    plain, motion = at_step(arm, *FALLING), at_step(arm, *split)
    exact, found = plain.contacts["stop"].impulse, motion.contacts["stop"].impulse
    np.testing.assert_allclose(found[-1], exact[-1], atol=5e-3 * np.abs(exact).max())
