"""Cost of derivatives beside that of a march by central difference, written to derivatives.csv.

Run from the project's root: ``python benchmarks/derivatives.py``. Of each scene a march, one with eight tangents by
inputs of the equations, one with eight by numbers that change the equations in proportion, and the adjoint, which
marches the motion itself, by eight of either kind, are timed by turns; the least of each counts. Whole gradients of a
chain of links, with all stages beside the marches, by the adjoint and by tangents, go to gradients.csv.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from few_modes import few_modes
from table_format import HERE, write_rows

import fmd
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiled_system.tangents import Direction, TangentSystem, Variant
from fmd.fitting import adjoint
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
    adjoint_by_masses: float


@dataclass
class GradientRow:
    """Run time of a gradient by so many numbers by the adjoint, over that by tangents."""

    numbers: int
    springs: float
    masses: float


def measure(name: str) -> Row:
    """Time the ways of a scene."""
    run = fmd.load(name, *few_modes(name)).run
    system, (q0, v0) = run.system, run.start
    method = CentralDifference(0.5 * system.largest_step)
    times = np.linspace(0.0, STEPS * method.step, 5)
    still = np.zeros(len(system.compiled.numbers)), [], np.zeros(system.n_positions), np.zeros(system.n)
    ones = np.ones(system.n_positions), np.ones(system.n)
    variants = [Variant(system.compiled, weight, *ones) for weight in (-1.0, 1.0)]
    by_q, by_v = np.ones((len(times), system.n_positions)), np.ones((len(times), system.n))

    def pull(along: tuple[object, ...]) -> float:
        eight = [Direction(*along)] * LANES
        return timed(lambda: pull_back(method, system, q0, v0, times, by_q, by_v, eight))

    ways: dict[str, Callable[[], float]] = {
        "march": lambda: method.march(system, q0, v0, times).seconds,
        "tangents": lambda: march_tangents(method, system, [Direction(*still)], q0, v0, times),
        "by_masses": lambda: march_tangents(method, system, [Direction(*still, variants)], q0, v0, times),
        "adjoint": lambda: pull(still),
        "adjoint_by_masses": lambda: pull((*still, variants)),
    }
    least = dict.fromkeys(ways, np.inf)
    for _ in range(TURNS):
        for way, take in ways.items():
            least[way] = min(least[way], take())
    shares = {way: round(seconds / least["march"], 2) for way, seconds in least.items() if way != "march"}
    return Row(name, system.n, round(least["march"] / STEPS * 1e9, 1), **shares)


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


def chain(links: int) -> dict[str, object]:
    """Return a chain of rods on springs and dampers that swings for a second in 20,000 steps."""
    markers = {"a": {"at": ["0 m", "0 m", "0 m"]}, "b": {"at": ["0.3 m", "0 m", "0 m"]}}
    rod = {"shape": "rod", "mass": "0.7 kg", "length": "0.3 m", "marker": markers}
    hinge = {"type": "revolute", "axis": [0, 0, 1], "spring": "9 N m", "damper": "0.02 N m s", "rest": "5 deg"}
    ends = ["ground", *(f"link{k}.b" for k in range(links - 1))]
    simulation = {"duration": "1 s", "step": "50 us", "output_step": "20 ms", "tip": f"link{links - 1}.b"}
    return {
        "title": "Chain",
        "body": {f"link{k}": rod for k in range(links)},
        "joint": {f"hinge{k}": hinge | {"parent": end, "child": f"link{k}.a"} for k, end in enumerate(ends)},
        "simulation": simulation | {"run": [{"integrator": "central-difference"}]},
    }


def compare(count: int, kinds: Sequence[str]) -> float:
    """Return the run time of a gradient by numbers of some kinds by the adjoint, over that by tangents."""
    links = -(-count // len(kinds))
    keys = [kind.format(k) for k in range(links) for kind in kinds][:count]
    run, least = fmd.load(chain(links)), dict.fromkeys((1, count + 1), np.inf)
    for _ in range(3):
        for fewest in least:
            adjoint.FEWEST_BY_ADJOINT = fewest
            function = fmd.ResultFunction(run, of=[f"link{links - 1}.b.position"], to=keys)
            weights = np.ones(len(function(function.start)))
            own = function
            least[fewest] = min(least[fewest], timed(lambda own=own, weights=weights: own.vjp(own.start, weights)))
    return float(round(least[1] / least[count + 1], 2))


SPRINGS = ("joint.hinge{}.spring", "joint.hinge{}.damper", "joint.hinge{}.rest")
MASSES = ("body.link{}.mass", "body.link{}.length", "body.link{}.marker.b.at.0")

if __name__ == "__main__":
    rows = []
    for scene in SCENES:
        rows.append(measure(scene))
        print(rows[-1], flush=True)
    write_rows(TABLE, rows)
    found = []
    for count in (8, 16, 24, 32, 50):
        found.append(GradientRow(count, compare(count, SPRINGS), compare(count, MASSES)))
        print(found[-1], flush=True)
    write_rows(HERE / "gradients.csv", found)
