"""Check if the loads through each flexible body change its stiffness, by the motion with all bodies rigid.

Tension stiffens and compression softens. The linear floating frame knows neither: it softens with spin, by ``Ω²`` times
a body's second moments, and has no stiffness left at a critical rate.
"""

from collections.abc import Collection, Mapping
from dataclasses import field, replace
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits import modes as limits
from fmd.core.limits.stability import RIGID_TOLERANCE
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.controllers import HeldValues
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.open_loads import largest_residual, open_loads, share_open_loads
from fmd.dynamics.transmitted_loads import BodyLoads, change_by_inertia, transmitted_loads, without_negligible_terms
from fmd.integrators.protocol import Integrator
from fmd.reduction.body import FlexibleBody
from fmd.scene.modes import damping_ratios
from fmd.scene.scene import Scene
from fmd.stages.assembly import movable_rigid
from fmd.stages.division import part_of
from fmd.stages.mechanism import build_mechanism, place_joints
from fmd.stages.run_checks import require_inertia


@dataclass(frozen=True)
class StiffeningLoads:
    """Loads through a body over a scene, and whether they count."""

    largest_rate: float  # largest angular rate of the body over the scene [rad/s]
    first_frequency: float  # its lowest angular frequency [rad/s]
    critical_rate: float  # rate at which it would have no stiffness left without geometric stiffening [rad/s]
    stiffened: bool  # true if the body has its geometric stiffness
    change: float  # estimate from above of how much the loads change the stiffness of a mode, as a part of it
    loads: BodyLoads = field(repr=False)  # loads through the body with all bodies rigid
    times: Array = field(repr=False)  # (n_times,): at which they are known [s]
    positions: Array = field(repr=False)  # (n_times, n_positions): of the mechanism with all bodies rigid


class RigidLoads(NamedTuple):
    """A scene's mechanism, its motion with all bodies rigid, and the loads on each body over that."""

    mechanism: Mechanism
    motion: Kinematics
    loads: list[BodyLoads]


def find_rigid_loads(scene: Scene, mechanism: Mechanism) -> RigidLoads:
    """Find the loads on each body of a scene's mechanism by its motion with all bodies rigid; raises as `move_rigidly`.

    Those that the motion leaves open are as stiffness shares them.
    """
    motion = move_rigidly(scene, mechanism)
    loads = transmitted_loads(motion)
    if mechanism.closures or mechanism.elements:
        unknown = open_loads(mechanism.rigid, motion.times, motion.q)
        loads = [replace(known, open=own) for known, own in zip(loads, unknown, strict=True)]
        constrained = Kinematics(mechanism.rigid, motion.times, motion.q, motion.v)
        loads = share_open_loads(mechanism, constrained, loads)
    return RigidLoads(mechanism, motion, loads)


def move_rigidly(scene: Scene, mechanism: Mechanism) -> Kinematics:
    """Compute a scene's motion with all bodies of its mechanism rigid.

    Raises
    ------
    InputError
        A joint moves without any inertia.
    AccuracyError
        The motion can't be integrated.
    """
    require_inertia(scene, share_system(mechanism.rigid))
    rigid = movable_rigid(mechanism)
    return rigid_motion(rigid, *place_joints(scene, rigid), scene.simulation.duration)


def check_stiffening_loads(
    scene: Scene,
    bodies: Mapping[str, FlexibleBody],
    meshed: Collection[str] | None = None,
    found: RigidLoads | None = None,
) -> dict[str, StiffeningLoads]:
    """Check the loads through each flexible body of a scene, and if they count, before anything is integrated.

    Bodies are reduced and not stiffened; those of names ``meshed``, all by default, have elements, and so stress. The
    loads by rigid bodies are those that were found, if any.

    Raises
    ------
    InputError
        The scene wants no stiffening, and a body would lose its stiffness; or a joint moves without any inertia.
    """
    if not bodies:
        return {}
    setting, error = scene.simulation.stiffening, scene.simulation.error
    mechanism, motion, all_loads = found or find_rigid_loads(scene, build_mechanism(scene, bodies))
    checks = {}
    for name, body in bodies.items():
        loads = all_loads[mechanism.number_of(name)]
        rates = np.linalg.norm(loads.spin, axis=1)
        largest, first = float(rates.max()), float(body.omega[0])
        critical = critical_rate(body, loads.spin[rates.argmax()])
        if setting == "off" and largest >= critical:
            mend = (
                f"body '{name}' would diverge: it turns at up to {largest:.4g} rad/s, and from {critical:.4g} rad/s on "
                "the linear floating frame has no stiffness left; 'auto' adds geometric stiffening"
            )
            raise InputError(scene.file, "simulation.stiffening", "off", mend)
        change = estimate_change(body, loads)
        (ratio,) = damping_ratios(scene.flexible[name].modes.damping, [first])
        lasting = 1.0 / max(ratio, 1e-300)  # radians of ringing
        matters = change * (1.0 + 0.5 * limits.RINGING * min(first * scene.simulation.duration, lasting)) > error
        # Displacements of second order in its pieces also make the rotations of a chain converge faster.
        counts = (matters and (meshed is None or name in meshed)) or bool(part_of(name))
        stiffened = setting == "on" or (setting == "auto" and counts)
        checks[name] = StiffeningLoads(largest, first, critical, stiffened, change, loads, motion.times, motion.q)
    opened = largest_residual(mechanism.rigid, motion.times, motion.q) > limits.CLOSED_BY_DEFORMING
    if setting == "auto" and (opened or any(check.stiffened for check in checks.values())):
        for name, check in checks.items():  # stretched by a body that deflects, or by a motion that is prescribed
            strained = bool(check.loads.open.any()) and (meshed is None or name in meshed)
            checks[name] = replace(check, stiffened=check.stiffened or strained)
    return checks


def estimate_change(body: FlexibleBody, loads: BodyLoads) -> float:
    """Estimate from above the part by which loads change the stiffness of a mode, without geometric stiffness."""
    length = float(np.linalg.norm(body.x, axis=1).max())
    peaks = (body.shapes**2).sum(axis=1).max(axis=0)
    spin, turning, acceleration = (np.linalg.norm(a, axis=1) for a in (loads.spin, loads.turning, loads.acceleration))
    forces = (
        np.linalg.norm(loads.wrenches[:, :, :3], axis=2) + np.linalg.norm(loads.wrenches[:, :, 3:], axis=2) / length
    )
    inertia = body.integrals.mass * (acceleration + 0.5 * length * (spin**2 + turning))
    return float(limits.SLOPES * (forces.sum(axis=0) + inertia).max() * (peaks / body.omega**2).max() / length)


def keep_what_counts(mechanism: Mechanism, checks: Mapping[str, StiffeningLoads], error: float) -> Mechanism:
    """Leave out of a mechanism those terms of stiffening that don't count beside a required error.

    Pieces keep all: they count by their own deflection, not by the loads alone.
    """
    for name, check in checks.items():
        if check.stiffened and not part_of(name):
            mechanism = without_negligible_terms(
                mechanism, mechanism.number_of(name), check.loads, limits.NEGLIGIBLE_TERMS * error
            )
    return mechanism


def keep_inertia_of_pieces(
    linear: Mapping[str, FlexibleBody],
    stiffened: Mapping[str, FlexibleBody],
    checks: Mapping[str, StiffeningLoads],
    error: float,
) -> dict[str, FlexibleBody]:
    """Return the pieces among stiffened bodies with their inertia of second order where it counts.

    Without it a piece is stiffened by the forces at its ends, but not by its own inertia. All pieces of a part have it
    or none, so that equal ones stay equal. It always counts if the required relative error is 0. The linear bodies have
    no displacements of second order.
    """
    pieces = {name: body for name, body in stiffened.items() if part_of(name)}
    counts = {
        part_of(name)
        for name, body in pieces.items()
        if not error or limits.OF_PIECES * change_by_inertia(body, checks[name].loads) > error
    }
    return {
        name: body if part_of(name) in counts else replace(body, integrals=linear[name].integrals)
        for name, body in pieces.items()
    }


def with_whole_energy(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism in which displacements of second order count with their whole kinetic energy."""
    links = [replace(link, integrals=replace(link.integrals, whole=True)) for link in mechanism.links]
    return replace(mechanism, links=links)


def critical_rate(body: FlexibleBody, spin: Array) -> float:
    """Rate about the direction of ``spin`` at which ``ω² − Ω² D`` loses its stiffness [rad/s]; infinite at no spin."""
    size = np.linalg.norm(spin)
    if not size:
        return np.inf
    e = spin / size
    D = np.einsum("ab,abij->ij", np.eye(3) - np.outer(e, e), body.integrals.G)[1:, 1:]
    softest = np.linalg.eigvalsh(0.5 * (D + D.T) / np.outer(body.omega, body.omega))[-1]
    return float(1 / np.sqrt(softest)) if softest > 0 else np.inf


def rigid_spins(mechanism: Mechanism, q0: Array, v0: Array, duration: float) -> dict[str, Array]:
    """Compute the angular velocity (n_samples, 3) [rad/s] of each body in its axes over a motion in which none deforms.

    It starts with positions (n_positions,) and rates (n,) of `Mechanism.rigid`, and has a duration [s].
    """
    motion = rigid_motion(mechanism, q0, v0, duration)
    return {link.name: motion.body_spin(k) for k, link in enumerate(mechanism.links)}


def rigid_motion(mechanism: Mechanism, q0: Array, v0: Array, duration: float) -> Kinematics:
    """Compute the motion of a mechanism in which no body deforms; the arguments are those of `rigid_spins`."""
    times = np.linspace(0.0, duration, limits.SAMPLED_TIMES)
    rigid = mechanism.rigid
    q, v, held = _march_rigid(rigid, q0, v0, times)
    return Kinematics(rigid if held is None else rigid.with_known(held.know), times, q, v)


def _march_rigid(rigid: Mechanism, q0: Array, v0: Array, times: Array) -> tuple[Array, Array, HeldValues | None]:
    """Integrate a mechanism of rigid bodies: positions and rates, (n_times, …) each, and what controllers have held."""
    if not rigid.n:
        return np.zeros((len(times), 0)), np.zeros((len(times), 0)), None
    system = share_system(rigid)
    try:
        motion = _method_for(system, times[-1]).march(system, q0, v0, times)
    except AccuracyError as error:
        raise AccuracyError(f"the scene with all bodies rigid: {error}") from error
    return motion.q, motion.v, motion.held


def _method_for(system: CompiledSystem, duration: float) -> Integrator:
    """Return a compiled method of high order, or implicit ones where strong dampers or many vibrations want these.

    Vibrations that are too many to be followed keep their size by the trapezoidal rule, though not their frequency.
    """
    if system.highest_frequency * duration > limits.MOST_RADIANS and not system.is_sampled:
        from fmd.integrators.generalized_alpha import GeneralizedAlpha

        return GeneralizedAlpha(duration / limits.RIGID_IMPLICIT_STEPS, rho=1.0)
    if duration <= limits.RIGID_LEAPFROGS * system.largest_step:
        from fmd.integrators.runge_kutta import RungeKutta

        return RungeKutta(RIGID_TOLERANCE)
    if system.mechanism.closures or system.is_sampled:  # whose steps end at the samples
        from fmd.integrators.rosenbrock import ExponentialRosenbrock

        return ExponentialRosenbrock(1e-4)
    from fmd.integrators.scipy_ivp import ScipyIvp

    return ScipyIvp("Radau", RIGID_TOLERANCE)
