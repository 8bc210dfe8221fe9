"""Whether a body's spin matters to its stiffness: how fast it will turn, found with all bodies rigid.

The linear floating frame softens with spin, by ``Ω²`` times a body's second moments, and has no stiffness left at a
critical rate. Geometric stiffening, by the stress of the inertia loads themselves, more than makes up for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

from pipeline.core.arrays import Array
from pipeline.core.errors import AccuracyError, InputError
from pipeline.dynamics.kinematics import Kinematics

if TYPE_CHECKING:
    from pipeline.dynamics.mechanism import Mechanism
    from pipeline.reduction.body import FlexibleBody
    from pipeline.stages.mechanism import Chain
    from pipeline.stages.pipeline import Pipeline

# Spin counts where it changes the lowest stiffness by more than this part.
_MATTERS = 0.01
_SAMPLES = 401


@dataclass(frozen=True)
class SpinCheck:
    """What a body's spin does to its stiffness.

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


def check_spins(pipeline: Pipeline) -> dict[str, SpinCheck]:
    """Check each flexible body of a scene, before it is integrated.

    Raises
    ------
    InputError
        The scene wants no stiffening, and a body would lose its stiffness.
    """
    if not pipeline.parts:
        return {}
    wanted = pipeline.scene.simulation.stiffening
    bodies = {name: part.body for name, part in pipeline.parts.items()}
    spins = _spins(pipeline, bodies)
    found = {}
    for name, body in bodies.items():
        rates = np.linalg.norm(spins[name], axis=1)
        largest, first = float(rates.max()), float(body.omega[0])
        critical = critical_rate(body, spins[name][rates.argmax()])
        if wanted == "off" and largest >= critical:
            raise InputError(
                pipeline.scene.file,
                "simulation.stiffening",
                "off",
                f"body '{name}' would diverge: it turns at up to {largest:.4g} rad/s, and from {critical:.4g} rad/s on "
                "the linear floating frame has no stiffness left; 'auto' adds geometric stiffening",
            )
        matters = (largest / first) ** 2 > _MATTERS
        found[name] = SpinCheck(largest, first, critical, wanted == "on" or (wanted == "auto" and matters))
    return found


def critical_rate(body: FlexibleBody, spin: Array) -> float:
    """Rate about the direction of ``spin`` at which ``ω² − Ω² D`` loses its stiffness [rad/s]; infinite at no spin."""
    size = np.linalg.norm(spin)
    if not size:
        return np.inf
    e = spin / size
    D = np.einsum("ab,abij->ij", np.eye(3) - np.outer(e, e), body.gram.G)[1:, 1:]
    softest = eigh(0.5 * (D + D.T), np.diag(body.omega**2), eigvals_only=True)[-1]
    return float(1 / np.sqrt(softest)) if softest > 0 else np.inf


def _spins(pipeline: Pipeline, bodies: dict[str, FlexibleBody]) -> dict[str, Array]:
    """Angular velocities of the bodies in their own axes over the scene, (n_samples, 3) each, all bodies rigid."""
    from pipeline.stages.mechanism import chain_of, rotor_of

    if pipeline.is_rotor:
        (body,) = bodies.values()
        (joint,) = pipeline.scene.joint.values()
        reached = rotor_of(pipeline.scene, body).driven_rate
        start = joint.rate if joint.type == "revolute" else 0.0
        return {body_name: np.outer([start, start + reached], body.axis) for body_name in bodies}
    found = spins_of(chain_of(pipeline.scene, bodies), pipeline.scene.simulation.duration)
    return {name: spins for name, spins in found.items() if name in bodies}


def spins_of(chain: Chain, duration: float) -> dict[str, Array]:
    """Angular velocity of each body of a chain in its own axes, all bodies rigid, (n_samples, 3) each [rad/s]."""
    rigid = chain.tree.rigid
    times = np.linspace(0.0, duration, _SAMPLES)
    q, v = _rigid_motion(rigid, chain.q0[: rigid.n_positions], chain.v0[: rigid.n], times)
    motion = Kinematics(rigid, times, q, v)
    return {link.name: motion.body_spin(k) for k, link in enumerate(rigid.links)}


def _rigid_motion(rigid: Mechanism, q0: Array, v0: Array, times: Array) -> tuple[Array, Array]:
    if not rigid.n:
        return np.zeros((len(times), 0)), np.zeros((len(times), 0))
    from pipeline.integrators.scipy_ivp import ScipyIvp

    try:
        motion = ScipyIvp("DOP853", 1e-4).march(rigid, q0, v0, times)
    except AccuracyError as error:
        raise AccuracyError(f"the scene with all bodies rigid: {error}") from error
    return motion.q, motion.v
