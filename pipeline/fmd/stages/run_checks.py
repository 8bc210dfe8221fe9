"""Checks before anything is integrated: of steps, of joints without inertia, of the memory for results."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.contact import DEEP_START
from fmd.core.limits.mechanism import NO_INERTIA
from fmd.core.limits.memory import ALWAYS_FIT, FINE_RUNS, NUMBERS_OF_BODY, NUMBERS_OF_COORDINATE
from fmd.core.limits.stepping import MANY_RADIANS, MOST_STEPS
from fmd.core.memory import available_memory
from fmd.dynamics.compiled_system.reference_state import find_fastest_part
from fmd.integrators.protocol import Integrator, evaluate
from fmd.integrators.work_bounds import round_down
from fmd.scene.runs import name_methods

if TYPE_CHECKING:
    from fmd.dynamics.compiled_system.system import CompiledSystem
    from fmd.dynamics.mechanism import Mechanism
    from fmd.scene.scene import Scene
    from fmd.scene.simulation import Simulation


def require_free_start(scene: Scene, system: CompiledSystem, start: tuple[Array, Array]) -> None:
    """Raise ``InputError`` if a body begins in what it touches, not at rest: what presses it there isn't known."""
    if scene.simulation.start == "equilibrium":
        return
    parameters: Any = system.parameters
    evaluate(parameters, 0.0, *start, np.zeros(system.n))
    table, number = parameters.contact, 0
    for body in system.mechanism.contacts:
        for name in body.names:
            depth = table.deepest(number)
            if depth > DEEP_START * body.points.extent:
                mend = f"{body.body} has to start above what it touches, or on it"
                raise InputError(scene.file, f"contact.{name}", None, f"begins {depth:.4g} m deep: {mend}")
            number += 1
    if table.lost:
        raise InputError(scene.file, "contact", None, f"has no forces at the start: {table.lost}")


def require_no_contact(scene: Scene, what: str) -> None:
    """Raise ``InputError`` if a scene has contacts, of which a use of it knows nothing."""
    if scene.contact:
        names = ", ".join(scene.contact)
        raise InputError(scene.file, "contact", names, f"{what} would leave contacts out; --set contact={{}} does so")


def require_no_gears(scene: Scene, what: str) -> None:
    """Raise ``InputError`` if a scene has gears in mesh, which a use of it doesn't take."""
    if scene.gear_mesh:
        names = ", ".join(scene.gear_mesh)
        mend = f"{what} takes no gears in mesh; --set gear_mesh={{}} leaves their teeth out"
        raise InputError(scene.file, "gear_mesh", names, mend)


def require_resolved_loads(file: str, key: str, method: Integrator, system: CompiledSystem) -> None:
    """Check that a method with a fixed step doesn't step over a load.

    Raises
    ------
    InputError
        A load acts, rises and falls, or vibrates within too few steps; the message has a step that works.
    """
    if not method.step:
        return
    cycle = method.load_cycle(system)
    longest, lasts = system.resolving_step(cycle * method.step)
    if longest >= cycle * method.step:
        return
    frozen = f", which freezes loads over {cycle} steps," if cycle > 1 else ""
    mend = (
        f"a load acts for {lasts:.4g} s only, which {method.name}{frozen} would step over; "
        f"a step of {round_down(longest / cycle):g} s or less works, and "
        f"{name_methods('chooses_steps', 'keeps_loops')} find theirs"
    )
    raise InputError(file, key, f"{method.step:.6g} s", mend)


def require_countable_steps(file: str, key: str, step: float, duration: float) -> None:
    """Check that a march by a fixed step [s] can come to an end.

    Raises
    ------
    InputError
        It takes more steps than a machine does in days.
    """
    if 0.0 < step * MOST_STEPS < duration:
        shortest = duration / MOST_STEPS
        mend = f"makes {duration / step:.3g} steps, which never come to an end; {1.1 * shortest:.2g} s or longer does"
        raise InputError(file, key, f"{step:.6g} s", mend)


def require_known_phases(file: str, key: str, method: Integrator, system: CompiledSystem, run: Simulation) -> None:
    """Check that double precision knows the phase of the fastest vibration to the required error up to the end.

    Only the exponential method gives it for any step; others refuse such a step, or damp such vibrations.

    Raises
    ------
    InputError
        Vibrations are too many; the message names the part that makes them.
    """
    lost = method.lost_phase(system, run.duration)
    if lost > run.error:
        mend = (
            f"round-off leaves the phase of the fastest vibration unknown by {lost:.1g} rad at the end"
            f"{describe_fastest(system, run.duration)}"
        )
        raise InputError(file, key, f"{method.step:.6g} s", mend)


def describe_fastest(system: CompiledSystem, duration: float) -> str:
    """Name the part whose vibration or decay is too fast for a duration [s], and a value that is not; else nothing."""
    part = find_fastest_part(system)
    if part is None or not part.rate * duration > MANY_RADIANS:
        return ""
    share, times = MANY_RADIANS / (part.rate * duration), part.rate * duration
    if part.damps:
        return (
            f"; the damper of {part.name} stops what it moves in {1.0 / part.rate:.2g} s, {times:.1e} of which are in "
            f"{duration:g} s: {share:.1g} times its value or less is quickly marched, and a joint in its place holds "
            "without any"
        )
    hertz = part.rate / (2 * np.pi)
    return (
        f"; the stiffness of {part.name} makes vibrations of {hertz:.2g} Hz, {hertz * duration:.1e} in {duration:g} s: "
        f"{share**2:.1g} times its value or less is quickly marched, a joint in its place holds without any, and "
        f"{name_methods('passes_over')} passes over fast vibrations"
    )


def require_inertia(scene: Scene, system: CompiledSystem) -> None:
    """Raise ``InputError`` if a joint has a motion that nothing resists: no mass moves in it.

    A rod or a point mass on a ball joint, for one, turns about its own axis without any inertia.
    """
    if not system.n or system.lightest_motion[0] > NO_INERTIA * system.n:
        return
    joint, motion = _describe_rate(system.mechanism, system.lightest_motion[1])
    mend = (
        f"nothing has inertia against its {motion}; give what it carries an extent (shape 'rigid' with inertias above "
        "0 or 'rod' across the axis), or take a joint without this motion"
    )
    raise InputError(scene.file, f"joint.{joint}", None, mend)


def _describe_rate(mechanism: Mechanism, vector: Array) -> tuple[str, str]:
    """Return the joint that moves most in a combination of rates (n,), and its motion in words."""
    parts = [vector[at : at + link.n_rates] for at, link in zip(mechanism.layout.rate, mechanism.links, strict=True)]
    worst = int(np.argmax([np.abs(part).max(initial=0.0) for part in parts]))
    link, part = mechanism.links[worst], parts[worst]
    slides = link.n_slides
    turns = int(np.abs(part).argmax()) >= slides
    part = part[slides:] if turns else part[:slides]
    if len(part) == 1:
        return link.joint_name, "rotation" if turns else "displacement"
    direction = part / part[np.abs(part).argmax()]
    text = ", ".join(f"{x:.3g}" for x in np.where(np.abs(direction) < 1e-6, 0.0, direction) + 0.0)
    return link.joint_name, f"{'rotation about' if turns else 'displacement along'} [{text}] in the child's axes"


def expected_bytes(scene: Scene) -> float:
    """Return the memory that the results of a scene's runs take, by its bodies, joints and modes alone [bytes]."""
    kinds = [joint.kind for joint in scene.joint.values()]
    modes = sum(body.modes.count for body in scene.flexible.values() if body.shape != "reduced")
    numbers = sum(kind.n_positions + kind.n_rates for kind in kinds) + 2 * modes
    simulation = scene.simulation
    each = _bytes_of_time(len(scene.body), numbers, len(simulation.run), bool(scene.flexible))
    return each * simulation.duration / simulation.output_step


def _bytes_of_time(n_bodies: int, n_coordinates: int, n_runs: int, flexible: bool) -> float:
    """Return the memory of each output time; coordinates are positions and rates [bytes]."""
    return 8.0 * (NUMBERS_OF_BODY * n_bodies + NUMBERS_OF_COORDINATE * n_coordinates) * (n_runs + FINE_RUNS * flexible)


def require_room(scene: Scene, mechanism: Mechanism | None = None) -> None:
    """Check that the results of a scene's runs at all output times fit into the memory.

    Before there is a mechanism, sizes are those that the scene tells.

    Raises
    ------
    InputError
        They don't; the message has the shortest output step that fits.
    """
    simulation = scene.simulation
    n_outputs = simulation.duration / simulation.output_step
    if mechanism is None:
        needed = expected_bytes(scene)
    else:
        flexible = any(len(link.omega) for link in mechanism.links)
        sizes = len(mechanism.links), mechanism.n_positions + mechanism.n
        needed = n_outputs * _bytes_of_time(*sizes, len(simulation.run), flexible)
    if needed <= ALWAYS_FIT or needed <= (free := available_memory()):
        return
    shortest = simulation.output_step * needed / free
    mend = (
        f"makes {n_outputs:.3g} output times, whose results take about {needed / 1e9:.3g} GB of memory; "
        f"{free / 1e9:.3g} GB are free: {1.1 * shortest:.2g} s or longer fits"
    )
    raise InputError(scene.file, "simulation.output_step", f"{simulation.output_step:.6g} s", mend)
