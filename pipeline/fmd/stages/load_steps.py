"""Fixed steps beside the scene's loads, vibrations and duration: refused with what works."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.errors import InputError
from fmd.core.limits.stepping import MANY_RADIANS, MOST_STEPS
from fmd.dynamics.fastest_part import find_fastest_part
from fmd.integrators.missed_work import round_down
from fmd.scene.runs import name_methods

if TYPE_CHECKING:
    from fmd.dynamics.compiled_system.system import CompiledSystem
    from fmd.integrators.protocol import Integrator
    from fmd.scene.simulation import Simulation


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
    held = f", which holds loads over {cycle} steps," if cycle > 1 else ""
    raise InputError(
        file,
        key,
        f"{method.step:.6g} s",
        f"a load acts for {lasts:.4g} s only, which {method.name}{held} would step over; "
        f"a step of {round_down(longest / cycle):g} s or less works, and "
        f"{name_methods('chooses_steps', 'keeps_loops')} find theirs",
    )


def require_countable_steps(file: str, key: str, step: float, duration: float) -> None:
    """Check that a march by a fixed step [s] can come to an end.

    Raises
    ------
    InputError
        It takes more steps than a machine does in days.
    """
    if 0.0 < step * MOST_STEPS < duration:
        shortest = duration / MOST_STEPS
        raise InputError(
            file,
            key,
            f"{step:.6g} s",
            f"makes {duration / step:.3g} steps, which never come to an end; {1.1 * shortest:.2g} s or longer does",
        )


def require_known_phases(file: str, key: str, method: Integrator, system: CompiledSystem, run: Simulation) -> None:
    """Check that double precision knows the phase of the fastest vibration to the wanted error up to the end.

    Only the exponential method gives it for any step; others refuse such a step, or damp such vibrations.

    Raises
    ------
    InputError
        Vibrations are too many; the message names the part that makes them.
    """
    lost = method.lost_phase(system, run.duration)
    if lost > run.error:
        raise InputError(
            file,
            key,
            f"{method.step:.6g} s",
            f"round-off leaves the phase of the fastest vibration unknown by {lost:.1g} rad at the end"
            f"{describe_fastest(system, run.duration)}",
        )


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
