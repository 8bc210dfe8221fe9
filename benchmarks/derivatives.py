"""Cost of derivatives beside that of a march by central difference, written to derivatives.csv and gradients.csv.

Run from the project's root: ``python benchmarks/derivatives.py``. Of each scene a march, one with eight tangents by
springs and the like, one with eight by dimensions, and the adjoint of the first, which marches the motion itself, are
timed by turns; the least of each counts. Whole gradients of a chain of 17 links, with all stages beside the marches,
are timed by the adjoint and by tangents.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from few_modes import few_modes
from table_format import HERE, write_rows

import fmd
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiled_system.tangents import Direction, TangentSystem, Variant
from fmd.fitting import result_function
from fmd.integrators.adjoint import pull_back
from fmd.integrators.central_difference import CentralDifference

TABLE = HERE / "derivatives.csv"
SCENES = ("beam", "arm", "robot", "four-bar", "propeller")
STEPS, TURNS, LANES, LINKS = 4000, 15, 8, 17


@dataclass
class Row:
    """Run time of a step, and of a march with derivatives over that of one without."""

    scene: str
    coordinates: int
    step_ns: float
    tangents: float
    by_dimensions: float
    adjoint: float


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
    method = CentralDifference(0.1 * system.largest_step)
    times = np.linspace(0.0, STEPS * method.step, 5)
    still = [], np.zeros(system.n_positions), np.zeros(system.n)
    ones = np.ones(system.n_positions), np.ones(system.n)
    variants = [Variant(system.compiled, weight, *ones) for weight in (-1.0, 1.0)]
    springs = Direction(np.zeros(len(system.compiled.numbers)), *still)
    by_q, by_v = np.ones((len(times), system.n_positions)), np.ones((len(times), system.n))

    def pull(along: Direction) -> float:
        return timed(lambda: pull_back(method, system, q0, v0, times, by_q, by_v, [along] * LANES))

    ways: dict[str, Callable[[], float]] = {
        "march": lambda: method.march(system, q0, v0, times).seconds,
        "tangents": lambda: march_tangents(method, system, [springs], q0, v0, times),
        "by_dimensions": lambda: march_tangents(method, system, [replace(springs, variants=variants)], q0, v0, times),
        "adjoint": lambda: pull(springs),
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


def chain() -> dict[str, object]:
    """Return a chain of rigid links on springs and dampers that swings for a second in 20,000 steps."""
    markers = {"a": {"at": ["0 m", "0 m", "0 m"]}, "b": {"at": ["0.3 m", "0 m", "0 m"]}}
    link = {"shape": "rigid", "mass": "0.7 kg", "centre": ["0.15 m", "0 m", "0 m"], "marker": markers}
    link |= {"inertia": ["0.01 kg m^2", "0.01 kg m^2", "0.01 kg m^2"]}
    hinge = {"type": "revolute", "axis": [0, 0, 1], "spring": "9 N m", "damper": "0.02 N m s", "rest": "5 deg"}
    ends = ["ground", *(f"link{k}.b" for k in range(LINKS - 1))]
    simulation = {"duration": "1 s", "step": "50 us", "output_step": "20 ms", "tip": f"link{LINKS - 1}.b"}
    return {
        "title": "Chain",
        "body": {f"link{k}": link for k in range(LINKS)},
        "joint": {f"hinge{k}": hinge | {"parent": end, "child": f"link{k}.a"} for k, end in enumerate(ends)},
        "simulation": simulation | {"run": [{"integrator": "central-difference"}]},
    }


def compare(count: int, kinds: Sequence[str]) -> float:
    """Return the run time of a gradient by numbers of some kinds by the adjoint, over that by tangents."""
    keys = [kind.format(k) for k in range(LINKS) for kind in kinds][:count]
    run, least = fmd.load(chain()), dict.fromkeys((1, count + 1), np.inf)
    for _ in range(2):
        for fewest in least:
            result_function.FEWEST_BY_ADJOINT = fewest
            function = fmd.ResultFunction(run, of=[f"link{LINKS - 1}.b.position"], to=keys)
            weights = np.ones(len(function(function.start)))
            least[fewest] = min(least[fewest], timed(partial(function.vjp, function.start, weights)))
    return float(round(least[1] / least[count + 1], 2))


SPRINGS = ("joint.hinge{}.spring", "joint.hinge{}.damper", "joint.hinge{}.rest")
MASSES = ("body.link{}.mass", "body.link{}.centre.0", "body.link{}.inertia.2")

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
