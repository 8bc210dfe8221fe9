"""Method ``auto`` against the best one at the same true error, and the error that it tells against the true one.

Run from the project's root: ``python benchmarks/auto.py choice`` and ``… errors``; ``--scene arm --scene 21`` takes a
ready scene or a seed of `truth_scenes`. For ``auto_choice.csv`` ready scenes, a spatial robot and twenty random scenes
are marched by ``auto`` and by each method from coarse to fine, until its true error is below that of ``auto`` and below
the wanted one; run times, of the whole call of a march with kernels compiled before, are interpolated at both. For
``auto_error.csv`` 300 random scenes are marched once; those that are refused, and those whose reference takes too long
or is made by ``auto`` itself, have no row. True errors, by the measure of ``auto``, are against a march by the
Runge–Kutta method with a tolerance of 1e-10, or where that takes too long by ``auto`` with a thousandth of the wanted
error.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from few_modes import few_modes
from table_format import write_rows
from tables import seconds_at
from truth_scenes import random_case

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.errors import SAFETY
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.automatic import Automatic
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.exponential import Exponential
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.march_pairs import motion_difference
from fmd.integrators.protocol import Integrator, Trajectory
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.runge_kutta import RungeKutta

HERE = Path(__file__).parent
READY = ("rod-slider", "beam-paper", "arm", "spin-up", "propeller", "propeller-torque", "propeller-gust", "robot")
RANDOM, SEEDS = 20, 300
PATIENCE = 12.0  # seconds of a reference
LONGEST = 60.0  # seconds of a march whose error is judged
REPEATS, SHORT = 10, 0.1  # a march is timed so often, or for so many seconds; that of auto after each other method


@dataclass
class Row:
    """What ``auto`` chose for a scene, its true error and run time [s] with all trials, and the best method's.

    ``best`` is the fastest method at that error, ``wanted_best`` that at the wanted one; ratios are over their times.
    """

    scene: str
    method: str
    error: float
    seconds: float
    evaluations: int
    best: str
    best_seconds: float
    ratio: float
    wanted: float
    wanted_best: str
    wanted_seconds: float
    wanted_ratio: float


@dataclass
class ErrorRow:
    """Errors of a scene over the largest value of each kind of coordinate: wanted, told by two marches, and true."""

    seed: str
    method: str
    wanted: float
    told: float
    true: float
    evaluations: int


class TooLongError(Exception):
    """A march takes longer than it may."""


def limit(seconds: float) -> Callable[[float], None]:
    """Return a progress that ends a march after a time."""
    end = time.perf_counter() + seconds

    def watch(done: float) -> None:
        if time.perf_counter() > end:
            raise TooLongError

    return watch


@dataclass
class Scene:
    """A scene's system with its start and output times."""

    name: str
    system: CompiledSystem
    start: tuple[np.ndarray, np.ndarray]
    times: np.ndarray
    auto: Automatic

    def timed(self, method: Integrator, most: float) -> tuple[float, Trajectory]:
        """Return the seconds of a march, the least of `REPEATS` if it is short, and what it found."""
        seconds, spent, repeats, found = np.inf, 0.0, 0, None
        while found is None or (spent < SHORT and repeats < REPEATS):
            begun = time.perf_counter()
            found = method.march(self.system, *self.start, self.times, limit(most))
            took = time.perf_counter() - begun
            seconds, spent, repeats = min(seconds, took), spent + took, repeats + 1
        return seconds, found

    def error(self, found: Trajectory, exact: Trajectory) -> float:
        """Return a true error by the measure of ``auto``: of positions, or half of the rates' if that is more."""
        return motion_difference(self.system, found.q, found.v, exact)

    def methods(self) -> Iterator[tuple[str, Iterator[Integrator]]]:
        """Yield each method's name, and the method from coarse to fine."""
        duration, stable = float(self.times[-1]), 2.0 / self.system.highest_frequency
        tolerances = [10.0**-k for k in np.arange(1.0, 10.5, 0.5)]
        steps = [duration / 2.0**k for k in np.arange(4.0, 22.0)]
        yield "runge-kutta", (RungeKutta(x) for x in tolerances)
        yield "exponential-rosenbrock", (ExponentialRosenbrock(x) for x in tolerances)
        yield "generalized-alpha", (GeneralizedAlpha(h) for h in steps)
        yield "central-difference", (CentralDifference(0.9 * stable / 2.0**k) for k in range(12))
        yield "exponential", (Exponential(h) for h in steps)


def open_scene(name: str) -> Scene:
    """Open a ready scene, the robot, or a random one by its seed, for ``auto``."""
    if name.isdigit():
        file = Path(tempfile.mkdtemp()) / f"truth-{name}.toml"
        file.write_text(random_case(int(name)).text)
        scene = load_scene(file)
    else:
        scene = load_scene(
            HERE / "scenes" / "robot.toml" if name == "robot" else name,
            [*few_modes(name), 'simulation.run=[{integrator="auto"}]'],
        )
    run = Pipeline(scene, Cache(None))
    plan = next(iter(run.plans.values()))
    (q, v), part, system = plan.start, plan.excited, plan.system
    if part is not None and plan.excited_system is not None:
        q, v, system = q[part.positions], v[part.rates], plan.excited_system
    assert isinstance(plan.integrator, Automatic)
    return Scene(name, system, (q, v), run.output_times, plan.integrator)


def exact_march(scene: Scene) -> Trajectory:
    """Return the reference."""
    try:
        return RungeKutta(1e-10).march(scene.system, *scene.start, scene.times, limit(PATIENCE))
    except (TooLongError, AccuracyError):
        auto = replace(scene.auto, error=1e-3 * scene.auto.error)
        return auto.march(scene.system, *scene.start, scene.times, limit(2 * PATIENCE))


def judge_choice(scene: Scene) -> Row:
    """Compare ``auto`` with each method."""
    scene.auto.march(scene.system, *scene.start, scene.times[:2])
    exact = exact_march(scene)
    seconds, found = scene.timed(scene.auto, 2 * PATIENCE)
    target, wanted = max(scene.error(found, exact), 1e-9), scene.auto.error
    points: dict[str, list[tuple[float, float]]] = {}
    slowest = seconds
    for name, finer in scene.methods():
        own = points[name] = []
        for method in finer:
            try:
                method.march(scene.system, *scene.start, scene.times[:2], limit(PATIENCE))
                took, each = scene.timed(method, 3 * slowest + 0.1)
            except TooLongError:
                break
            except (AccuracyError, InputError, ValueError):  # too coarse, or not for this scene
                continue
            own.append((took, max(scene.error(each, exact), 1e-15)))
            if own[-1][1] <= min(target, wanted) or took > 3 * slowest:
                break
        seconds = min(seconds, scene.timed(scene.auto, 2 * PATIENCE)[0])
    chosen = _name_method(found)
    cells: list[Any] = []
    for error in (target, wanted):
        best_seconds, best = min((seconds_at(own, error), name) for name, own in points.items() if own)
        if best_seconds > seconds and error <= target:  # no other reaches the error sooner
            best, best_seconds = chosen, seconds
        cells += [best, best_seconds, seconds / best_seconds]
    return Row(scene.name, chosen, target, seconds, found.evaluations, *cells[:3], wanted, *cells[3:])


def judge_error(scene: Scene) -> ErrorRow | None:
    """March a scene by ``auto`` and compare it with its reference; None if it has none."""
    found = scene.auto.march(scene.system, *scene.start, scene.times, limit(LONGEST))
    exact = exact_march(scene)
    if exact.integrator.startswith("auto") or found.error is None:
        return None
    method = _name_method(found)
    return ErrorRow(
        scene.name, method, scene.auto.error, SAFETY * found.error, scene.error(found, exact), found.evaluations
    )


def _name_method(found: Trajectory) -> str:
    return found.integrator.removeprefix("auto (").removesuffix(")")


def main(arguments: list[str]) -> None:
    """Judge scenes and write a table; a random scene that is refused makes way for the next."""
    parser = argparse.ArgumentParser(description="Method auto beside the best one, and its error beside the true one.")
    parser.add_argument("table", choices=("choice", "errors"))
    parser.add_argument("--scene", action="append")
    options = parser.parse_args(arguments)
    judge, ready, wanted = {"choice": (judge_choice, READY, RANDOM), "errors": (judge_error, (), SEEDS)}[options.table]
    names, rows = options.scene or [*ready, *map(str, range(SEEDS))], list[Any]()
    for name in names:
        if name.isdigit() and wanted == 0 and not options.scene:
            break
        try:
            row = judge(open_scene(name))
        except (AccuracyError, InputError, TooLongError) as error:
            print(f"{name}: {type(error).__name__} {str(error)[:100]}", flush=True)
            continue
        print(row or f"{name}: no reference", flush=True)
        wanted -= name.isdigit()
        rows += [row] if row else []
    if rows and not options.scene:
        write_rows(HERE / f"auto_{options.table.removesuffix('s')}.csv", rows)


if __name__ == "__main__":
    main(sys.argv[1:])
