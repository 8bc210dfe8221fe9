"""Fixed steps beside the scene's loads, vibrations and duration: refused with what works."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.errors import InputError
from fmd.integrators.missed_work import round_down
from fmd.stages.limit_words import describe_fastest

if TYPE_CHECKING:
    from fmd.dynamics.compiled_system.system import CompiledSystem
    from fmd.integrators.protocol import Integrator
    from fmd.scene.simulation import Simulation

_MOST_STEPS = 1e12  # a day or more


def require_resolved_loads(file: str, key: str, method: Integrator, system: CompiledSystem) -> None:
    """Check that a method with a fixed step doesn't step over a load.

    Raises
    ------
    InputError
        A load acts, rises and falls, or vibrates within too few steps; the message has a step that works.
    """
    if not method.step:
        return
    cycle = cycle_of(method, system)
    longest, lasts = system.resolving_step(cycle * method.step)
    if longest >= cycle * method.step:
        return
    held = f", which holds loads over {cycle} steps," if cycle > 1 else ""
    raise InputError(
        file,
        key,
        f"{method.step:.6g} s",
        f"a load acts for {lasts:.4g} s only, which {method.name}{held} would step over; "
        f"a step of {round_down(longest / cycle):g} s or less works, and auto, runge-kutta and "
        "exponential-rosenbrock find theirs",
    )


def require_countable_steps(file: str, key: str, step: float, duration: float) -> None:
    """Check that a march by a fixed step [s] can come to an end.

    Raises
    ------
    InputError
        It takes more steps than a machine does in days.
    """
    if 0.0 < step * _MOST_STEPS < duration:
        shortest = duration / _MOST_STEPS
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
    if method.name != "exponential":
        return
    lost = float(np.sqrt(system.stiffness.max(initial=0.0))) * run.duration * np.finfo(float).eps
    if lost > run.error:
        raise InputError(
            file,
            key,
            f"{method.step:.6g} s",
            f"round-off leaves the phase of the fastest vibration unknown by {lost:.1g} rad at the end"
            f"{describe_fastest(system, run.duration)}",
        )


def cycle_of(method: Integrator, system: CompiledSystem) -> int:
    """Return the number of a method's steps between two samples of the loads."""
    two_rate: Any = method
    held = method.name == "reversible-sub-cycling" or system.n_slow
    return int(getattr(two_rate, "substeps", 1)) if held else 1
