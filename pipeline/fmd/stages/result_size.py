"""Memory that the results of a scene's runs take, forecast before anything is integrated."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fmd.core.errors import InputError
from fmd.core.limits.memory import ALWAYS_FIT, FINE_RUNS, NUMBERS_OF_BODY, NUMBERS_OF_COORDINATE
from fmd.reduction.factor.figures import available_memory

if TYPE_CHECKING:
    from fmd.dynamics.mechanism import Mechanism
    from fmd.scene.scene import Scene


def result_bytes(mechanism: Mechanism, n_runs: int) -> float:
    """Return the memory that each output time of a scene's motions takes [bytes]."""
    numbers = NUMBERS_OF_BODY * len(mechanism.links) + NUMBERS_OF_COORDINATE * (mechanism.n_positions + mechanism.n)
    fine = FINE_RUNS if any(len(link.omega) for link in mechanism.links) else 0
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
    if n_outputs * each <= ALWAYS_FIT or n_outputs * each <= (free := available_memory()):
        return
    shortest = simulation.duration * each / free
    raise InputError(
        scene.file,
        "simulation.output_step",
        f"{simulation.output_step:.6g} s",
        f"makes {n_outputs:.3g} output times, whose results take about {n_outputs * each / 1e9:.3g} GB of memory; "
        f"{free / 1e9:.3g} GB are free: {1.1 * shortest:.2g} s or longer fits",
    )
