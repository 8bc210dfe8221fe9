"""Words for the limit of a method's step, for the message that refuses a longer one."""

from __future__ import annotations

from typing import Any

import numpy as np

from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.fastest_part import find_fastest_part

_DAMPED = 1.01  # step without dampers over that with them, from which they are named
_ROUND_OFF = 1e-12
_MANY = 1e6  # radians, or times in which a motion falls to 37 %: more are due to one part, which is named


def describe_limit(method: Any, system: CompiledSystem, limit: float) -> str:
    """Say which frequency limits a method's step [s], and what its dampers take of that."""
    if method.name == "exponential":
        stops = ", and of end stops" if np.any(system.linear_forces.stop_K) else ""
        return (
            f"2/ω with {1 / (np.pi * limit):.5g} Hz, the frequency of what couples joints and modes through the "
            f"mass matrix{stops}, which this method doesn't solve exactly; exponential-rosenbrock does"
        )
    m, omega, which = getattr(method, "substeps", 1), system.highest_frequency, "2/ω of its highest frequency"
    if m > 1:
        omega = system.highest_reacting_frequency if "reversible" in method.name else system.highest_fast_frequency
        if system.largest_slow_step <= limit * m * (1.0 + _ROUND_OFF):
            omega, which = system.highest_slow_frequency * m, "2/(m ω) of its slow coordinates"
    text = f"{which}, {omega / (m if 'slow' in which else 1) / (2 * np.pi):.5g} Hz"
    undamped = 2.0 / omega
    return text if undamped <= _DAMPED * limit else f"{text}; without dampers it would be {undamped:.4g} s"


def describe_fastest(system: CompiledSystem, duration: float) -> str:
    """Name the part whose vibration or decay is too fast for a duration [s], and a value that is not; else nothing."""
    part = find_fastest_part(system)
    if part is None or not part.rate * duration > _MANY:
        return ""
    share, times = _MANY / (part.rate * duration), part.rate * duration
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
        "generalized-alpha passes over fast vibrations"
    )
