"""Memory that the results of a scene's runs take, forecast before anything is integrated."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fmd.core.errors import InputError
from fmd.reduction.factor.memory import available_memory

if TYPE_CHECKING:
    from fmd.dynamics.mechanism import Mechanism
    from fmd.scene.scene import Scene

# Numbers kept for each output time. Measured: 1.0 kB a run with two rigid bodies, 0.7 kB with one body of five modes.
_OF_A_BODY = 60
_OF_A_COORDINATE = 4
_FINE_RUNS = 2  # as many runs more for the times between outputs at which a tip's deflection is largest
_ALWAYS_FIT = 1e8  # bytes, for which no memory is looked up


def result_bytes(mechanism: Mechanism, n_runs: int) -> float:
    """Return the memory that each output time of a scene's motions takes [bytes]."""
    numbers = _OF_A_BODY * len(mechanism.links) + _OF_A_COORDINATE * (mechanism.n_positions + mechanism.n)
    fine = _FINE_RUNS if any(len(link.omega) for link in mechanism.links) else 0
    return 8.0 * numbers * (n_runs + fine)


def require_room(scene: Scene, mechanism: Mechanism) -> None:
    """Check that the results of a scene's runs at all output times fit into the memory.

    Raises
    ------
    InputError
        They don't; the message has the shortest output step that fits.
    """
    simulation = scene.simulation
    assert simulation is not None
    n_outputs, each = simulation.duration / simulation.output_step, result_bytes(mechanism, len(simulation.run))
    if n_outputs * each <= _ALWAYS_FIT or n_outputs * each <= (free := available_memory()):
        return
    shortest = simulation.duration * each / free
    raise InputError(
        scene.file,
        "simulation.output_step",
        f"{simulation.output_step:.6g} s",
        f"makes {n_outputs:.3g} output times, whose results take about {n_outputs * each / 1e9:.3g} GB of memory; "
        f"{free / 1e9:.3g} GB are free: {1.1 * shortest:.2g} s or longer fits",
    )
