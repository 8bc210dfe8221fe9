"""Check of how fast each flexible body turns, by the motion with all bodies rigid, and whether that stiffens it.

The linear floating frame softens with spin, by ``Ω²`` times a body's second moments, and has no stiffness left at a
critical rate. Geometric stiffening, by the stress of the inertia loads themselves, more than makes up for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

from pipeline.core.arrays import Array
from pipeline.core.errors import AccuracyError, InputError
from pipeline.dynamics.fast_path import rigid_hinge_motion
from pipeline.dynamics.kinematics import Kinematics
from pipeline.stages.mechanism import build_mechanism, place_joints

if TYPE_CHECKING:
    from pipeline.dynamics.mechanism import Mechanism
    from pipeline.reduction.body import FlexibleBody
    from pipeline.scene.scene import Scene

# Spin counts where it changes the lowest stiffness by more than this part.
_MATTERS = 0.01
_SAMPLES = 401


@dataclass(frozen=True)
class SpinCheck:
    """Largest spin of a body over a scene, against the rate at which its stiffness would be lost.

    Attributes
    ----------
    largest_rate : float
        Largest angular rate of the body over the scene [rad/s].
    first_frequency : float
        Its lowest angular frequency [rad/s].
    critical_rate : float
        Rate at which it would have no stiffness left without geometric stiffening [rad/s].
    stiffened : bool
        Whether the body is stiffened by its inertia loads.
    """

    largest_rate: float
    first_frequency: float
    critical_rate: float
    stiffened: bool


def check_spins(scene: Scene, bodies: Mapping[str, FlexibleBody]) -> dict[str, SpinCheck]:
    """Check how fast each flexible body of a scene will turn, before anything is integrated.

    Parameters
    ----------
    scene : Scene
        With a simulation.
    bodies : mapping of str to FlexibleBody
        Its flexible bodies, reduced and not stiffened.

    Raises
    ------
    InputError
        The scene wants no stiffening, and a body would lose its stiffness.
    """
    if not bodies:
        return {}
    wanted = scene.simulation.stiffening
    mechanism = build_mechanism(scene, bodies)
    spins = rigid_spins(mechanism, *place_joints(scene, mechanism.rigid), scene.simulation.duration)
    checks = {}
    for name, body in bodies.items():
        rates = np.linalg.norm(spins[name], axis=1)
        largest, first = float(rates.max()), float(body.omega[0])
        critical = critical_rate(body, spins[name][rates.argmax()])
        if wanted == "off" and largest >= critical:
            raise InputError(
                scene.file,
                "simulation.stiffening",
                "off",
                f"body '{name}' would diverge: it turns at up to {largest:.4g} rad/s, and from {critical:.4g} rad/s on "
                "the linear floating frame has no stiffness left; 'auto' adds geometric stiffening",
            )
        matters = (largest / first) ** 2 > _MATTERS
        checks[name] = SpinCheck(largest, first, critical, wanted == "on" or (wanted == "auto" and matters))
    return checks


def critical_rate(body: FlexibleBody, spin: Array) -> float:
    """Rate about the direction of ``spin`` at which ``ω² − Ω² D`` loses its stiffness [rad/s]; infinite at no spin."""
    size = np.linalg.norm(spin)
    if not size:
        return np.inf
    e = spin / size
    D = np.einsum("ab,abij->ij", np.eye(3) - np.outer(e, e), body.gram.G)[1:, 1:]
    softest = eigh(0.5 * (D + D.T), np.diag(body.omega**2), eigvals_only=True)[-1]
    return float(1 / np.sqrt(softest)) if softest > 0 else np.inf


def rigid_spins(mechanism: Mechanism, q0: Array, v0: Array, duration: float) -> dict[str, Array]:
    """Compute the angular velocity of each body in its own axes over a motion in which no body deforms.

    Parameters
    ----------
    q0, v0 : ndarray
        Positions and rates of `Mechanism.rigid` at the start.
    duration : float
        Of the motion [s].

    Returns
    -------
    dict of str to ndarray, shapes (n_samples, 3)
        [rad/s]
    """
    times = np.linspace(0.0, duration, _SAMPLES)
    q, v = rigid_hinge_motion(mechanism, q0, v0, times) or _rigid_motion(mechanism.rigid, q0, v0, times)
    motion = Kinematics(mechanism.rigid, times, q, v)
    return {link.name: motion.body_spin(k) for k, link in enumerate(mechanism.links)}


def _rigid_motion(rigid: Mechanism, q0: Array, v0: Array, times: Array) -> tuple[Array, Array]:
    """Integrate a mechanism of rigid bodies: positions and rates, (n_times, …) each."""
    if not rigid.n:
        return np.zeros((len(times), 0)), np.zeros((len(times), 0))
    from pipeline.integrators.scipy_ivp import ScipyIvp

    try:
        motion = ScipyIvp("DOP853", 1e-4).march(rigid, q0, v0, times)
    except AccuracyError as error:
        raise AccuracyError(f"the scene with all bodies rigid: {error}") from error
    return motion.q, motion.v
