"""Measure modes with their derivatives beside parts in pieces and linear modes: error and run time over the load.

Run from the project's root: ``python benchmarks/nonlinear_modes.py``. A cantilever of solid elements is pulled at its
end, in a plane against the elastica and in space against a rod that bends and twists. Then it is let go from rest, and
compared with the whole solid of its mesh.
Writes ``nonlinear_modes.csv``, and the chart by `nonlinear_modes_chart`.
"""

from __future__ import annotations

import csv
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path += [str(HERE), str(HERE.parent)]
from large_deflection import DEPTH, LENGTH, MODULUS, PRINCETON, WIDTH  # noqa: E402
from large_deflection import LOAD as PRINCETON_LOAD  # noqa: E402
from modal_derivatives import bending_modes, twist_shape  # noqa: E402
from nonlinear_modes_chart import draw  # noqa: E402
from nonlinear_solid import NonlinearSolid  # noqa: E402
from reduced_solid import ReducedSolid, reduce_solid, rest_of_reduced  # noqa: E402

from fmd import Pipeline, load_scene  # noqa: E402
from fmd.core.errors import AccuracyError, StabilityError  # noqa: E402
from fmd.dynamics.compiled_system.shared import share_system  # noqa: E402
from fmd.dynamics.kinematics import Kinematics  # noqa: E402
from fmd.dynamics.mechanism import Mechanism  # noqa: E402
from fmd.integrators.central_difference import CentralDifference  # noqa: E402
from fmd.integrators.generalized_alpha import GeneralizedAlpha  # noqa: E402
from fmd.stages.mechanism import find_start  # noqa: E402
from tests.verification.rods import bend_rod, torsion_of_rectangle  # noqa: E402
from tests.verification.test_large_deflection import FORCE, elastica, end_of, strip  # noqa: E402

# ν = 0: a root whose nodes are all held is then no stiffer than one held in the mean
PLANE, SPACE = {"ALONG": 48}, {**PRINCETON, "POISSON": 0.0, "ALONG": 64, "1, 1]": "2, 2]"}
PLANE_LOADS = (0.1, 0.2, 0.5, 1, 2, 5, 10)  # P L²/EI
SPACE_LOADS = (0.1, 0.2, 0.5, 1, 2)  # of 8.896 N
RELEASED = (0.2, 0.5, 1, 2, 5)  # P L²/EI
ACROSS = np.array([0.0, np.sqrt(0.5), np.sqrt(0.5)])
SPATIAL = {3: (1, 1, 1), 6: (3, 2, 1), 8: (4, 3, 1)}  # modes along z and y, and the twist
BASES_IN_SPACE = {f"derivatives of {count} modes in space": numbers for count, numbers in SPATIAL.items()}
BASES_IN_PLANE = {f"derivatives of {count} modes": (count, 0, 0) for count in (2, 3, 4, 6)}
BASES_IN_PLANE |= {"derivatives of 6 modes in space": SPATIAL[6]}  # for a body that may be bent any way, as pieces may
STEPS = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)
TIMES = np.linspace(0.0, 1.0, 201)  # a period of the lowest mode [s]
OF_LIMIT = 0.8  # explicit steps: stretched shapes are stiffer than the undeformed ones
NEAR = 1.25  # times the least error: the fastest march as good as that is taken
REFERENCE_STEP = 1.25e-4  # of the whole solid [s]: twice as long changes its path by 0.02 %
TIP = np.array([1.0, 0.0, 0.0])  # of the undeformed strip
REPEATS = 15
MOST_SECONDS, MOST_STEPS = 3.0, 200_000  # of a march: finer ones aren't tried
Row = dict[str, Any]
Loads = dict[float, tuple[Any, Any]]
Bases = dict[str, tuple[int, int, int]]
Marches = list[tuple[Any, float, str]]


def best_of(solve: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a function gives and its least time [s]."""
    times = []
    for _ in range(REPEATS):
        tick = time.perf_counter()
        result = solve()
        times.append(time.perf_counter() - tick)
    return result, min(times)


def cantilever(folder: Path, values: dict[str, Any], pieces: int, stiffening: str, load: float) -> Pipeline:
    """Make the strip in pieces, or with two modes and its static shapes in one."""
    run = strip(folder, PIECES=pieces, LOAD=f"{load!r} N", **FORCE | values | {"STIFFENING": stiffening})
    if pieces > 1:
        return run
    overrides = ["body.strip.modes.boundary=interface", "body.strip.modes.count=2"]
    return run.variant(load_scene(folder / "strip.toml", overrides))


def solid_of(run: Pipeline) -> NonlinearSolid:
    """Return the mesh of a run in one piece as a solid of large displacements."""
    return NonlinearSolid(run.part.fe, run.part.markers["root"], run.part.markers["tip"])


def reduce_bases(solid: NonlinearSolid, bases: Bases) -> dict[str, ReducedSolid]:
    """Reduce a solid to each basis."""
    reduced = {}
    for name, (along_z, along_y, twists) in bases.items():
        modes = [bending_modes(solid, along_z, np.eye(3)[2]), bending_modes(solid, along_y, np.eye(3)[1])]
        modes += [twist_shape(solid, 0)] * twists
        tick = time.perf_counter()
        reduced[name] = reduce_solid(solid, np.concatenate(modes, axis=2))
        seconds = time.perf_counter() - tick
        print(f"{name}, {reduced[name].n} coordinates, reduced in {seconds:.2g} s", flush=True)
    return reduced


def tip_of(solid: NonlinearSolid, reduced: ReducedSolid, q: Any) -> Any:
    """Return the displacement (…, 3) of the tip at coordinates q (…, n) [m]."""
    return q @ solid.tip.translation(reduced.basis).T


def measure_statics(
    folder: Path, case: str, values: dict[str, Any], loads: Loads, pieces: tuple[int, ...], bases: Bases
) -> list[Row]:
    """Measure rests under forces; ``loads`` gives each one's force (3,) [N] and the true displacement (3,) [m]."""
    rows: list[Row] = []
    first, _ = next(iter(loads.values()))
    whole = cantilever(folder, values | {"DIRECTION": first.tolist()}, 1, "off", 1.0)
    solid, length = solid_of(whole), float(np.ptp(whole.part.fe.x[:, 0]))
    reduced = reduce_bases(solid, bases)
    for load, (force, exact) in loads.items():

        def add(model: str, n: int, moved: Any, seconds: float, load: float = load, exact: Any = exact) -> None:
            size = float(np.linalg.norm(exact))
            error = float(np.linalg.norm(moved - exact)) / size
            rows.append(row_of(case, load, size / length, model, n, error, seconds, "Newton"))
            print(rows[-1], flush=True)

        values = values | {"DIRECTION": (force / np.linalg.norm(force)).tolist()}
        for count, stiffening in [(1, "off"), (1, "auto"), *((count, "auto") for count in pieces)]:
            run = cantilever(folder, values, count, stiffening, float(np.linalg.norm(force)))
            moved = end_of(run) - [length, 0, 0]
            _, seconds = best_of(partial(find_start, run.divided_scene, run.system))
            add(name_of(count, stiffening), run.system.n, moved, seconds)
        for name, model in reduced.items():
            load_q = model.basis.reshape(-1, model.n).T @ solid.load(force).ravel()
            q, seconds = best_of(partial(rest_of_reduced, model, load_q))
            add(name, model.n, tip_of(solid, model, q), seconds)
    return rows


def name_of(pieces: int, stiffening: str) -> str:
    """Name a model of pieces."""
    if pieces > 1:
        return f"{pieces} pieces"
    return "linear modes" if stiffening == "off" else "linear modes, second order"


def row_of(
    case: str, load: float, deflection: float, model: str, n: int, error: float, seconds: float, method: str
) -> Row:
    """Return a row of the table."""
    figures = {"deflection": f"{deflection:.3g}", "model": model, "coordinates": n}
    return (
        {"case": case, "load": f"{load:g}"}
        | figures
        | {"error_percent": f"{100 * error:.3g}", "seconds": f"{seconds:.3g}", "method": method}
    )


def march_all(system: Any, q0: Any, tip: Callable[[Any], Any], steps: tuple[float, ...] = STEPS) -> Marches:
    """March from rest by several methods and steps; return the tip's path, the time and the method of each."""
    methods = [CentralDifference(OF_LIMIT * 2.0 / system.highest_frequency)]
    methods += [GeneralizedAlpha(step) for step in steps]
    found: Marches = []
    for method in methods:
        if TIMES[-1] / method.step > MOST_STEPS or (len(found) > 1 and found[-1][1] > MOST_SECONDS):
            continue
        try:
            march = method.march(system, q0, np.zeros(system.n), TIMES)
            again = method.march(system, q0, np.zeros(system.n), TIMES) if march.seconds < 1.0 else march
        except (AccuracyError, StabilityError):
            continue
        found.append((tip(march), min(march.seconds, again.seconds), f"{method.name}, {1e3 * method.step:.2g} ms"))
    return found


def measure_release(folder: Path) -> list[Row]:
    """Measure how a strip that is let go from rest under a force swings in its plane."""
    rows: list[Row] = []
    solid = solid_of(cantilever(folder, PLANE, 1, "off", 1.0))
    reduced = reduce_bases(solid, BASES_IN_PLANE)
    for load in RELEASED:
        paths: dict[str, tuple[int, Marches]] = {}
        for count, stiffening in ((1, "off"), (1, "auto"), *((count, "auto") for count in (2, 4, 8, 16))):
            loaded = cantilever(folder, PLANE, count, stiffening, load)
            free = share_system(replace(loaded.mechanism, loads=()))  # displacements of second order stay as they are

            def tip(march: Any, mechanism: Mechanism = free.mechanism) -> Any:
                motion = Kinematics(mechanism, march.times, march.q, march.v)
                return motion.marker_position(mechanism.find_marker(mechanism.number_of("strip"), "tip"), "tip") - [
                    1,
                    0,
                    0,
                ]

            steps = STEPS if count < 16 else ()
            name = name_of(count, stiffening)
            paths[name] = free.n, march_all(free, loaded.start[0], tip, steps)
        for name, model in reduced.items():
            load_q = model.basis.reshape(-1, model.n).T @ solid.load(np.array([0.0, 0.0, load])).ravel()
            q = rest_of_reduced(model, load_q)
            marches = march_all(model, q, lambda march, model=model: tip_of(solid, model, march.q))
            paths[name] = model.n, marches
        exact = solid.march(solid.rest([0.0, 0.0, load]), TIMES, REFERENCE_STEP)
        size = float(np.linalg.norm(exact, axis=1).max())
        for name, (n, marches) in paths.items():
            errors = [float(np.linalg.norm(path - exact, axis=1).max()) / size for path, *_ in marches]
            good = [k for k, error in enumerate(errors) if error <= NEAR * min(errors)]
            k = min(good, key=lambda k: marches[k][1])
            rows.append(row_of("release", load, size, name, n, errors[k], marches[k][1] / TIMES[-1], marches[k][2]))
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Measure, write the table and draw the chart."""
    G, area = MODULUS / 2, DEPTH * WIDTH
    bending = (
        G * torsion_of_rectangle(DEPTH, WIDTH),
        MODULUS * DEPTH * WIDTH**3 / 12,
        MODULUS * WIDTH * DEPTH**3 / 12,
    )
    plane, space = {}, {}
    for load in PLANE_LOADS:
        x, z = elastica(load)
        plane[float(load)] = np.array([0.0, 0.0, load]), np.array([x - 1, 0.0, z])
    for load in SPACE_LOADS:
        force = load * PRINCETON_LOAD * ACROSS
        rod = bend_rod(LENGTH, bending, (MODULUS * area, G * area * 5 / 6, G * area * 5 / 6), force)
        space[float(load)] = force, rod - [LENGTH, 0, 0]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = measure_statics(folder, "plane", PLANE, plane, (2, 4, 8, 16), BASES_IN_PLANE)
        rows += measure_statics(folder, "space", SPACE, space, (2, 4, 8), BASES_IN_SPACE)
        rows += measure_release(folder)
    with (HERE / "nonlinear_modes.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    draw()


if __name__ == "__main__":
    main()
