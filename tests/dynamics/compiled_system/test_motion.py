"""Motion of random chains by a compiled system: energy, momentum, work, dampers, other axes of description."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.spatial.transform import Rotation

from fmd.core.arrays import Array
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.signals.signal import constant
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.integrators.subcycling import Subcycling
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE

Make = Callable[..., Any]

WEIGHT = (1.0, -2.0, -9.81)  # aslant, so that no axis of the ground is special
TURN = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
SHIFT = np.array([3.0, -2.0, 1.0])
CLOSELY = ScipyIvp("DOP853", 1e-11)
METHODS = pytest.mark.parametrize("method", [CentralDifference(1e-3), Subcycling(1e-3, 5)], ids=["plain", "5:1"])


def total_energy(chain: Any, march: Any) -> Array:
    """Energy from the points."""
    return np.array([chain.kinetic(q, v) + chain.potential(q) for q, v in zip(march.q, march.v, strict=True)])


def test_energy_is_conserved(chain: Make, name: str) -> None:
    some = chain(name, gravity=WEIGHT).with_links(load=constant(0.0), damper=0.0, damping=np.zeros(0))
    march = CLOSELY.march(some.system, *some.state(0), np.linspace(0.0, 2.0, 21))
    energy = total_energy(some, march)
    scale = max(some.kinetic(q, v) for q, v in zip(march.q, march.v, strict=True))
    assert energy == pytest.approx(np.full(21, energy[0]), abs=1e-10 * scale)


def test_momentum_is_conserved_whatever_acts_within(chain: Make, free_name: str) -> None:
    # Springs, loads and dampers act between two bodies of the chain.
    some = chain(free_name)
    march = CLOSELY.march(some.system, *some.state(1), np.linspace(0.0, 2.0, 11))
    p, L = zip(*(some.momenta(q, v) for q, v in zip(march.q, march.v, strict=True)), strict=True)
    assert np.array(p) == pytest.approx(np.tile(p[0], (11, 1)), abs=1e-10 * np.linalg.norm(p[0]))
    assert np.array(L) == pytest.approx(np.tile(L[0], (11, 1)), abs=1e-10 * np.linalg.norm(L[0]))


def test_a_chain_that_nothing_holds_falls_as_its_centre_of_mass(chain: Make, free_name: str) -> None:
    # Newton: the momentum grows by m g t, whatever the bodies do to each other.
    some = chain(free_name, gravity=WEIGHT)
    times = np.linspace(0.0, 1.0, 6)
    march = CLOSELY.march(some.system, *some.state(2), times)
    p = np.array([some.momenta(q, v)[0] for q, v in zip(march.q, march.v, strict=True)])
    want = p[0] + some.masses.sum() * np.outer(times, WEIGHT)
    assert p == pytest.approx(want, abs=1e-9 * np.abs(want).max())


def test_loads_along_joints_do_the_work_that_the_chain_gains(chain: Make, name: str) -> None:
    some = chain(name, gravity=WEIGHT).with_links(damper=0.0, damping=np.zeros(0))
    march = CLOSELY.march(some.system, *some.state(3), np.linspace(0.0, 2.0, 21))
    work = []
    for q in march.q:
        joints, modes = some.positions_of(q)
        along = [
            link.load.value(0.0)[0] * (s[0] + (link.joint_rotation @ inner if link.joint_rotation.size else 0.0))
            for link, s, inner in zip(some.tree.links, joints, modes, strict=True)
            if link.joint in (REVOLUTE, PRISMATIC)
        ]
        work.append(sum(along))
    energy, gained = total_energy(some, march), np.array(work) - work[0]
    assert np.ptp(gained) > 0.1
    assert energy - energy[0] == pytest.approx(gained, abs=1e-9 * np.abs(energy).max())


def test_dampers_take_out_what_their_rates_cost_and_never_add(chain: Make, name: str) -> None:
    # A viscous joint takes c ṡ² and a mode 2 ζ ω q̇², where ṡ is the rate at which the section at the joint turns.
    some = chain(name, gravity=WEIGHT).with_links(load=constant(0.0))
    times = np.linspace(0.0, 2.0, 2001)
    march = CLOSELY.march(some.system, *some.state(4), times)
    energy = np.sum(Kinematics(some.tree, march.times, march.q, march.v).energies, axis=0)
    power = np.zeros(times.size)
    for i, v in enumerate(march.v):
        for link, ds, d_inner in zip(some.tree.links, *some.rates_of(v), strict=True):
            power[i] += 2 * (link.damping * link.omega) @ d_inner**2
            if link.damper:
                section = link.joint_rotation @ d_inner if link.joint_rotation.size else 0.0
                power[i] += link.damper * (ds[0] + section) ** 2
    scale = np.abs(energy).max()
    assert np.diff(energy).max() < 1e-12 * scale
    lost = np.array([simpson(power[: k + 1], x=times[: k + 1]) for k in range(0, times.size, 200)])
    assert lost[-1] > 0.1
    assert energy[0] - energy[::200] == pytest.approx(lost, abs=1e-8 * scale)


def test_describing_everything_in_turned_axes_changes_nothing(chain: Make, name: str) -> None:
    some = chain(name, gravity=WEIGHT)
    turned, times = some.turned(TURN, SHIFT), np.linspace(0.0, 1.0, 6)
    start = some.state(8)
    here = CLOSELY.march(some.system, *start, times)
    there = CLOSELY.march(turned.system, *some.turned_state(TURN, *start), times)
    for k in range(times.size):
        q, v = some.turned_state(TURN, here.q[k], here.v[k])
        assert there.q[k] == pytest.approx(q, abs=1e-9)
        assert there.v[k] == pytest.approx(v, abs=1e-9 * np.abs(v).max())
        assert turned.points(there.q[k]) == pytest.approx(some.points(here.q[k]) @ TURN.T + SHIFT, abs=1e-9)


@METHODS
def test_a_free_chain_moves_alike_from_a_turned_and_moved_start(
    chain: Make, free_name: str, method: CentralDifference | Subcycling
) -> None:
    # Only the pose and the velocity of the free body are given in the ground's axes.
    some = chain(free_name, gravity=WEIGHT)
    turned = replace(some, tree=replace(some.tree, gravity=TURN @ some.tree.gravity))
    q, v = some.state(9)
    other_q, other_v = q.copy(), v.copy()
    place = some.tree.links[0].place.position
    other_q[:3] = TURN @ (place + q[:3]) + SHIFT - place
    other_q[3:7] = (Rotation.from_matrix(TURN) * Rotation.from_quat(q[3:7])).as_quat()
    other_v[:3] = TURN @ v[:3]
    times = np.linspace(0.0, 1.0, 6)
    here, there = method.march(some.system, q, v, times), method.march(turned.system, other_q, other_v, times)
    assert there.q[:, 7:] == pytest.approx(here.q[:, 7:], abs=1e-11)
    for k in range(times.size):
        assert turned.points(there.q[k]) == pytest.approx(some.points(here.q[k]) @ TURN.T + SHIFT, abs=1e-10)
