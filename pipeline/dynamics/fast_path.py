"""One body on a hinge, driven by a pulse at most: the kernels of a planar rotor, which are far faster than a tree's.

The rotor's coordinates are the mechanism's own, angle and modal coordinates, so a trajectory of one is one of the
other. No other module knows which of the two is marched.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.links import REVOLUTE
from pipeline.dynamics.mechanism import Mechanism
from pipeline.dynamics.rotor.parameters import TorquePulse
from pipeline.dynamics.rotor.rotor import PlanarRotor
from pipeline.dynamics.signals.signal import constant

_NO_PULSE = TorquePulse(0.0, 1.0, 0.0)


def fast_system(mechanism: Mechanism) -> Mechanism | PlanarRotor:
    """Return the system with the fastest kernels whose coordinates and motion are those of a mechanism.

    Parameters
    ----------
    mechanism : Mechanism
        A planar rotor replaces it if it is one flexible, undamped body on a revolute joint to the ground, without
        spring, damper, gravity, prescribed motion or loads at points, driven by no more than one half-sine torque, and
        its joint alone is slow.
    """
    pulse = _pulse_of(mechanism)
    return mechanism if pulse is None else PlanarRotor(mechanism.links[0], pulse)


def rigid_hinge_motion(mechanism: Mechanism, q0: Array, v0: Array, times: Array) -> tuple[Array, Array] | None:
    """Integrate the joint of a mechanism that `fast_system` replaces in closed form, its body undeformed.

    Parameters
    ----------
    q0, v0 : ndarray, shapes (1,) or more
        Positions and rates at the start, the joint's first.
    times : ndarray, shape (n_times,)
        [s]

    Returns
    -------
    tuple of ndarray, shapes (n_times, 1), or None
        Angle [rad] and rate [rad/s]; None for any other mechanism.
    """
    pulse = _pulse_of(mechanism)
    if pulse is None:
        return None
    start, duration, _ = pulse
    gained = PlanarRotor(mechanism.links[0], pulse).driven_rate
    done = np.clip((times - start) / duration, 0.0, 1.0)
    after = np.maximum(times - start - duration, 0.0)
    rate = v0[0] + gained * 0.5 * (1 - np.cos(np.pi * done))
    turned = 0.5 * gained * duration * (done - np.sin(np.pi * done) / np.pi) + gained * after
    return (q0[0] + v0[0] * times + turned)[:, None], rate[:, None]


def _pulse_of(mechanism: Mechanism) -> TorquePulse | None:
    """Torque pulse of a mechanism that a planar rotor can replace; of no torque where nothing drives it."""
    link, *others = mechanism.links
    free = link.joint == REVOLUTE and link.parent < 0 and link.motion is None and not (link.spring or link.damper)
    undamped = len(link.omega) > 0 and not np.any(link.damping)
    slow = not mechanism.fast_joints and not any(mechanism.slow_modes.values())
    if others or mechanism.loads or np.any(mechanism.gravity) or not (free and undamped and slow):
        return None
    if link.load == constant(0.0):
        return _NO_PULSE
    return None if link.load.pulse is None else TorquePulse(*link.load.pulse)
