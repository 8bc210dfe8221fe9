"""Cost of derivatives beside that of a march by central difference, written to derivatives.csv.

Run from the project's root: ``python benchmarks/derivatives.py``. Of each scene a march, one with eight tangents by
inputs of the equations, one with eight by numbers that change the equations in proportion, and the adjoint, which
marches the motion itself, are timed by turns; the least of each counts.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from few_modes import few_modes
from table_format import HERE, write_rows

import fmd
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiled_system.tangents import Direction, TangentSystem, Variant
from fmd.integrators.adjoint import pull_back
from fmd.integrators.central_difference import CentralDifference

TABLE = HERE / "derivatives.csv"
SCENES = ("beam", "arm", "robot", "four-bar")
STEPS, TURNS, LANES = 4000, 15, 8


@dataclass
class Row:
    """Run time of a step, and of a march with derivatives over that of one without; NaN where there is no way."""

    scene: str
    coordinates: int
    step_ns: float
    tangents: float
    by_masses: float
    adjoint: float


def measure(name: str) -> Row:
    """Time the ways of a scene."""
    run = fmd.load(name, *few_modes(name)).run
    system, (q0, v0) = run.system, run.start
    method = CentralDifference(0.5 * system.largest_step)
    times = np.linspace(0.0, STEPS * method.step, 5)
    still = np.zeros(len(system.compiled.numbers)), [], np.zeros(system.n_positions), np.zeros(system.n)
    ones = np.ones(system.n_positions), np.ones(system.n)
    variants = [Variant(system.compiled, weight, *ones) for weight in (-1.0, 1.0)]
    weights = np.ones((len(times), system.n))
    ways: dict[str, Callable[[], float]] = {
        "march": lambda: method.march(system, q0, v0, times).seconds,
        "tangents": lambda: march_tangents(method, system, [Direction(*still)], q0, v0, times),
        "by_masses": lambda: march_tangents(method, system, [Direction(*still, variants)], q0, v0, times),
        "adjoint": lambda: timed(lambda: pull_back(method, system, q0, v0, times, weights, weights, [])),
    }
    if not system.has_adjoint:
        ways.pop("adjoint")
    least = dict.fromkeys(ways, np.inf)
    for _ in range(TURNS):
        for way, take in ways.items():
            least[way] = min(least[way], take())
    shares = {way: round(seconds / least["march"], 2) for way, seconds in least.items() if way != "march"}
    return Row(name, system.n, round(least["march"] / STEPS * 1e9, 1), **{"adjoint": np.nan, **shares})


def march_tangents(
    method: CentralDifference,
    system: CompiledSystem,
    along: list[Direction],
    q0: np.ndarray,
    v0: np.ndarray,
    times: np.ndarray,
) -> float:
    """Return the run time of a march with eight tangents [s]."""
    both = TangentSystem(system, along * LANES)
    return method.march(both, *both.join(q0, v0), times).seconds


def timed(take: Callable[[], object]) -> float:
    """Return the run time of a call [s]."""
    tick = time.perf_counter()
    take()
    return time.perf_counter() - tick


if __name__ == "__main__":
    rows = []
    for scene in SCENES:
        rows.append(measure(scene))
        print(rows[-1], flush=True)
    write_rows(TABLE, rows)
