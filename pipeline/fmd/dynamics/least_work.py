"""Share of the loads that rigid bodies leave open, by the principle of least work.

A load on a bar between two walls goes to both of them, as each side's stiffness has it; rigid bodies don't tell. The
open loads are self-stresses s, and the bodies take their elastic energy as small as it can be (Castigliano)::

    Σ_bodies Σ_modes (f + g s)² / ω²  +  Σ_elements sᵀ K⁻¹ s   →   min

with the modal forces f of the loads that are known, and g of unit self-stresses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fmd.core.arrays import EPSILON, Array, IntArray
from fmd.core.limits.mechanism import SHARED_MOMENTS
from fmd.core.limits.round_off import SOLVED
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.open_loads import SelfStress, self_stresses
from fmd.dynamics.transmitted_loads import BodyLoads, loaded_places


def share_open_loads(mechanism: Mechanism, motion: Kinematics, loads: Sequence[BodyLoads]) -> list[BodyLoads]:
    """Return the loads on each body with those that the motion of rigid bodies leaves open as stiffness shares them.

    The motion has all bodies rigid, under all constraints.
    """
    count, rigid = len(motion.times), motion.mechanism
    moments = np.unique(np.linspace(0, count - 1, SHARED_MOMENTS).astype(int))
    wrenches = [np.zeros((len(moments), len(own.wrenches), 6)) for own in loads]
    joints = [np.zeros((len(moments), 6)) for _ in loads]
    for number, k in enumerate(moments):
        states = self_stresses(Kinematics(rigid, motion.times[k : k + 1], motion.q[k : k + 1], np.zeros((1, rigid.n))))
        sizes = _least_work(mechanism, loads, states, int(k))
        for size, state in zip(sizes, states, strict=True):
            for body in range(len(loads)):
                wrenches[body][number] += size * state.wrenches[body]
                joints[body][number] += size * state.joints[body]
    return [
        replace(
            own,
            wrenches=own.wrenches + np.moveaxis(_between(moments, wrench, count), 0, 1),
            joint=own.joint + _between(moments, joint, count),
        )
        for own, wrench, joint in zip(loads, wrenches, joints, strict=True)
    ]


def _least_work(mechanism: Mechanism, loads: Sequence[BodyLoads], states: Sequence[SelfStress], k: int) -> Array:
    """Return the size of each state of self-stress at a moment."""
    known, by_states = [np.zeros(0)], [np.zeros((0, len(states)))]
    for body, link in enumerate(mechanism.links):
        if not len(link.omega):
            continue
        f = _of_inertia(mechanism, body, loads[body], k) + _modal(mechanism, body, loads[body].wrenches[:, k])
        known.append(f / link.omega)
        parts = [_modal(mechanism, body, state.wrenches[body]) / link.omega for state in states]
        by_states.append(np.array(parts).reshape(len(states), len(link.omega)).T)
    by_states.append(np.diag([np.sqrt(state.compliance) for state in states]))
    known.append(np.zeros(len(states)))
    G = np.concatenate(by_states)
    return np.asarray(-np.linalg.lstsq(G, np.concatenate(known), rcond=SOLVED)[0])


def _modal(mechanism: Mechanism, body: int, wrenches: Array) -> Array:
    """Return the modal forces (n,) of loads (n_loads, 6) on a body, in its axes."""
    f = np.zeros(len(mechanism.links[body].omega))
    for wrench, at in zip(wrenches, loaded_places(mechanism, body).markers, strict=True):
        for part, shape in ((wrench[:3], at.translation), (wrench[3:], at.rotation)):
            f += part @ shape if shape.size else 0.0
    return f


def _of_inertia(mechanism: Mechanism, body: int, loads: BodyLoads, k: int) -> Array:
    """Return the modal forces (n,) of a body's own inertia and weight."""
    integrals, spin = mechanism.links[body].integrals, loads.spin[k]
    products = (spin @ spin) * np.eye(3) - np.outer(spin, spin)
    moments = integrals.G[:, :, 0, 1:]
    f = np.einsum("ab,abi->i", products, moments) - np.einsum("a,abc,bci->i", loads.turning[k], EPSILON, moments)
    return np.asarray(f - loads.acceleration[k] @ integrals.S[:, 1:])


def _between(moments: IntArray, values: Array, count: int) -> Array:
    """Interpolate values (n_moments, …) to all times, (count, …)."""
    flat = values.reshape(len(moments), -1)
    columns = [np.interp(np.arange(count), moments, column) for column in flat.T]
    return np.array(columns).reshape(flat.shape[1], count).T.reshape(count, *values.shape[1:])
