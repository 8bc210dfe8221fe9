from dataclasses import replace

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.recently_used import RecentlyUsed
from fmd.dynamics.compiled_system import shared
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.compiler import compiled
from fmd.dynamics.compiler.compiled import compile_mechanism
from fmd.dynamics.links import Link, PointLoad, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import half_sine
from fmd.integrators.central_difference import CentralDifference
from fmd.scene.joints.revolute import REVOLUTE
from tests.dynamics.compiler.comparison import interpreted
from tests.dynamics.compiler.mechanisms import random_mechanism

TIMES = np.linspace(0.0, 0.1, 11)


def swing(**changes: object) -> Mechanism:
    integrals = rigid_integrals(2.0, np.array([0.3, 0.0, 0.0]), 0.1 * np.eye(3))
    link = Link("arm", integrals, REVOLUTE, spring=5.0, joint_name="hinge", load=half_sine(0.0, 0.2, 3.0))
    return Mechanism([link], horizon=1.0, **changes)


def test_equal_mechanisms_share_a_system_and_march_alike() -> None:
    first = share_system(swing())
    second = share_system(swing())
    assert second is first
    marches = [CentralDifference(1e-3).march(first, np.ones(1), np.zeros(1), TIMES) for _ in range(2)]
    alone = CentralDifference(1e-3).march(shared.CompiledSystem(swing()), np.ones(1), np.zeros(1), TIMES)
    for march in marches:
        assert np.array_equal(march.q, alone.q)


@pytest.mark.parametrize(
    "other",
    [
        replace(swing(), gravity=np.array([0.0, -9.81, 0.0])),
        replace(swing(), horizon=2.0),
        replace(swing(), fast_joints=["arm"]),
        replace(swing(), links=[replace(swing().links[0], spring=6.0)]),
        replace(swing(), links=[replace(swing().links[0], joint_name="other")]),
        replace(swing(), links=[replace(swing().links[0], load=half_sine(0.0, 0.2, 4.0))]),
        replace(swing(), loads=[PointLoad("arm", np.array([1.0, 0.0, 0.0]), half_sine(0.0, 0.2, 3.0))]),
    ],
)
def test_a_mechanism_that_differs_in_anything_has_a_system_of_its_own(other: Mechanism) -> None:
    assert share_system(other) is not share_system(swing())


def test_the_systems_that_were_used_last_are_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared, "_shared", RecentlyUsed(2))
    first = share_system(swing())
    for rate in (1.0, 2.0):
        share_system(swing(gravity=np.array([0.0, rate, 0.0])))
    assert share_system(swing()) is not first
    assert len(shared._shared) == 2


def test_a_second_pipeline_of_a_scene_marches_bit_for_bit_like_the_first() -> None:
    first, second = (Pipeline(load_scene("rod-slider")) for _ in range(2))
    for label, motion in first.motions.items():
        assert np.array_equal(motion.trajectory.q, second.motions[label].trajectory.q)
    assert second.system is first.system


def test_joint_loads_of_mechanisms_that_share_what_they_are_traced_from_are_their_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Sizes of loads are inputs of it; found without anything that is shared, the loads are the same ones."""
    made = random_mechanism(2)
    weak, strong = (
        replace(made.mechanism, loads=[replace(load, size=half_sine(0.1, 0.9, peak)) for load in made.mechanism.loads])
        for peak in (1.0, 3.0)
    )
    q, v = made.state(1)
    a = np.random.default_rng(0).normal(size=(1, v.size))
    given = (np.array([0.3]), q[None], v[None], a, np.zeros((1, 0)))
    first, second = (compile_mechanism(mechanism).joint_loads(*given)[1] for mechanism in (weak, strong))
    assert compile_mechanism(weak).digest == compile_mechanism(strong).digest
    monkeypatch.setattr(compiled, "_evaluations", RecentlyUsed(1))
    alone = compile_mechanism(strong).joint_loads(*given)[1]
    np.testing.assert_array_equal(second, alone)
    assert np.abs(first - second).max() > 1e-3


def test_functions_that_are_traced_after_code_was_taken_are_those_of_the_mechanism() -> None:
    """Of one that has been traced in part: what follows belongs to its graph."""
    made = random_mechanism(2)
    q, v = made.state(1)
    first, other, alone = (compile_mechanism(replace(made.mechanism, horizon=1.0)) for _ in range(3))
    first.program("accelerations")
    other.take_code_of(first)
    found, expected = (interpreted(each, "residual", v.shape, q=q, v=v, a=v) for each in (other, alone))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
