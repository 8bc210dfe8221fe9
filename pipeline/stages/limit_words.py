"""Words for the limit of a method's step, for the message that refuses a longer one."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.dynamics.compiled_system.system import CompiledSystem

_DAMPED = 1.01  # step without dampers over that with them, from which they are named
_ROUND_OFF = 1e-12


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
