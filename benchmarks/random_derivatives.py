"""Tangents and adjoints of random scenes without friction beside extrapolated differences of whole marches.

Run from the project's root: ``python benchmarks/random_derivatives.py SEED …``; seeds that random_derivatives.csv has
are not computed again. Each has a process of its own, which ends after 900 processor seconds. Scenes are those of
`truth_scenes`, over a fifth of their duration, or 1,000 of the longest stable steps, by each method in turn;
numbers are up to four of all that a scene has.
Results are the tip's position and the kinetic energy. Marches of scenes solved anew at eight values of a number or more
give two extrapolations of order 6; what these differ by is the reference's noise. Where that is much, more
follow of values nearer to each other: over a per mille fast vibrations come out of phase.
"""

import csv
import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from table_format import HERE, SAME_DERIVATIVE
from truth_scenes import Case, random_case

import fmd
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, InputError
from fmd.dynamics.compiler import store
from fmd.fitting import result_function  # noqa: F401 - registers how steps are taken back
from fmd.fitting.frozen_run import FrozenRun
from fmd.fitting.parameters import Parameter, find_parameter
from fmd.fitting.sensitivities import Sensitivity
from fmd.fitting.tangents import march_tangents
from fmd.integrators.adjoint import pull_back
from fmd.kernels.machine import compile_object
from fmd.output.channels import ResultChannel

TABLE = HERE / "random_derivatives.csv"
COLUMNS = ("seed", "kind", "features", "method", "numbers", "lacking", "apart", "noise", "stated", "adjoint", "remark")
SECONDS, PART, NUMBERS = 900, 0.2, 4
FAST = 0.3  # fast step of sub-cycling over the longest stable one: others need not be looked for
MOST_STEPS = 1000  # of the largest stable length, to which a scene is shortened
SHARE, HALVINGS = 8e-3, 10  # of a number, below and above which it is marched, and how often this is halved at most
PRECISE = 1e-9  # of the largest derivative: noise of a reference that is good enough
METHODS = ("central-difference", "runge-kutta", "generalized-alpha", "exponential", "sub-cycling")
SETTINGS = {
    "runge-kutta": ", tolerance=1e-12",
    "generalized-alpha": ", step='{step} s'",
    "exponential": ", step='{step} s'",
    "sub-cycling": ", substeps=4, forces='tangents', step='{fast} s'",
}


def numbers_of(scene: Any) -> Iterator[str]:
    """Yield keys of numbers of all kinds that a scene has, some of which are 0."""
    yield from (f"simulation.gravity.{k}" for k in range(3))
    for name, body in scene.body.items():
        own = ("E", "rho", "depth", "modes.damping") if hasattr(body, "E") else ("mass", "inertia.2", "centre.0")
        yield from (f"body.{name}.{key}" for key in own)
    for name, joint in scene.joint.items():
        yield from (f"joint.{name}.{key}" for key in ("spring", "damper", "rate") if hasattr(joint, key))
    for name, drive in scene.drive.items():
        yield from (f"drive.{name}.{key}" for key in ("force", "torque", "angle") if hasattr(drive, key))
    for room, keys in {"spring": ("stiffness",), "bushing": ("stiffness.1",), "bearing": ("radial",)}.items():
        yield from (f"{room}.{name}.{key}" for name in getattr(scene, room) for key in keys)


def choose_numbers(frozen: FrozenRun, seed: int) -> list[Parameter]:
    """Return some numbers of a scene."""
    known = list[Parameter]()
    for key in numbers_of(frozen.run.scene):
        try:
            parameter = find_parameter(frozen.run.scene, key)
        except InputError:
            continue
        if parameter.value:
            known.append(parameter)
    chosen = np.random.default_rng(seed).permutation(len(known))[:NUMBERS]
    return [known[k] for k in sorted(chosen)]


def load(case: Case) -> tuple[fmd.Result, FrozenRun]:
    """Return a scene's run by the method of its seed, or the next one that takes it."""
    whole = float(case.table["simulation"]["duration"].split()[0])
    limit = fmd.load(case.table).run.system.largest_step
    duration = min(PART * whole, MOST_STEPS * limit)
    lengths = {"step": f"{duration / 400:.3g}", "fast": f"{min(FAST * limit, duration / 400):.3g}"}
    refused: Exception = ValueError("no method takes the scene")
    for k in range(len(METHODS)):
        method = METHODS[(case.seed + k) % len(METHODS)]
        own = SETTINGS.get(method, "").format(**lengths)
        run = f"simulation.run=[{{integrator='{method}'{own}}}]"
        times = (
            f"simulation.duration={duration!r} s",
            f"simulation.output_step={duration / 40!r} s",
            "simulation.step=auto",
        )
        try:
            result = fmd.load(case.table, *times, run)
            frozen = FrozenRun(result.run)
            method_found = frozen.plan.integrator.name  # refuses what the method can't march
        except (InputError, AccuracyError, ValueError) as error:
            refused = error
            continue
        if method_found == method:
            return result, frozen
    raise refused


def extrapolate(
    frozen: FrozenRun, parameter: Parameter, channels: list[ResultChannel]
) -> tuple[list[Array], list[float]]:
    """Return derivatives of results by a number's logarithm from whole marches, and the noise of each."""
    found, best = list[list[Array]](), list[tuple[Array, float]]()
    for share in (SHARE * 0.5**k for k in range(HALVINGS + 1)):
        low, high = (frozen.at({parameter: parameter.value * (1.0 + side * share)}).run for side in (-1.0, 1.0))
        found.append([np.asarray(each.read(high) - each.read(low)) / (2.0 * share) for each in channels])
        best = [choose_extrapolation(own) for own in zip(*found, strict=True)] if len(found) > 4 else []
        if best and all(noise <= PRECISE * np.abs(value).max() for value, noise in best):
            break
    return [value for value, _ in best], [noise for _, noise in best]


def choose_extrapolation(differences: Sequence[Array]) -> tuple[Array, float]:
    """Return the best extrapolation of differences over distances that are halved again and again, and its noise.

    An extrapolation is as far off as from the one before it, or as round-off that the later ones show: it grows as
    their distances get shorter. So it counts for little that two agree by chance, as over distances that put fast
    vibrations out of phase. The last one, whose round-off no later one shows, is never chosen.
    """
    threes = zip(differences, differences[1:], differences[2:], strict=False)
    found = [(64.0 * c - 20.0 * b + a) / 45.0 for a, b, c in threes]
    apart = [float(np.abs(b - a).max()) for a, b in pairwise(found)]
    noise = [max(0.5**k * later for k, later in enumerate(apart[first:])) for first in range(len(apart))]
    best = int(np.argmin(noise[:-1]))
    return found[best + 1], noise[best]


def compare_tangents(
    frozen: FrozenRun, found: list[Sensitivity], parameters: list[Parameter]
) -> tuple[float, float, float]:
    """Return the largest difference from the reference, that one's noise, and the stated error, of one number.

    It is the one that is most beyond 1e-8, or beyond noise and stated error, if any is. All are parts of the largest
    derivative of a result; components of the position count as one.
    """
    channels = list({each.channel.name: each.channel for each in found}.values())
    mine = {
        (each.parameter.key, each.channel.name): (
            each.slope * each.parameter.value,
            np.abs(each.error * each.parameter.value),
        )
        for each in found
    }
    references = {parameter: extrapolate(frozen, parameter, channels) for parameter in parameters}
    found_apart = list[tuple[float, float, float]]()
    for placed in (True, False):
        group = [(k, each) for k, each in enumerate(channels) if ("position" in each.name) == placed]
        largest = max(np.abs(near[k]).max() for near, _ in references.values() for k, _ in group) or 1.0
        for parameter, (near, noise) in references.items():
            apart = max(np.abs(mine[parameter.key, each.name][0] - near[k]).max() for k, each in group) / largest
            own = max(noise[k] for k, _ in group) / largest
            stated = max(mine[parameter.key, each.name][1].max() for _, each in group) / largest
            found_apart.append((float(apart), float(own), float(stated)))
    return max(found_apart, key=lambda each: (max(each[0] / max(SAME_DERIVATIVE, each[1] + each[2]), 1.0), each[0]))


def compare_adjoint(frozen: FrozenRun, parameters: list[Parameter]) -> float:
    """Return how far an adjoint of all output, with random weights, is from tangents of the same steps."""
    motion = frozen.at({})
    directions = [each for each in (frozen.direction(motion, key) for key in parameters) if each is not None]
    system, q0, v0 = motion.plan.marched
    if not directions:
        return float("nan")
    rng = np.random.default_rng(0)
    by_q, by_v = (rng.normal(size=(len(frozen.times), size)) for size in (system.n_positions, system.n))
    found = pull_back(motion.plan.integrator, system, q0, v0, frozen.times, by_q, by_v, directions)
    places, rates = slice(None), slice(None)
    if motion.plan.excited is not None and motion.plan.excited_system is not None:
        places, rates = motion.plan.excited.positions, motion.plan.excited.rates
    tangents = march_tangents(motion.plan, directions, frozen.times)
    expected = np.array([(by_q * each.q[:, places]).sum() + (by_v * each.v[:, rates]).sum() for each in tangents])
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def compute(seed: int) -> dict[str, Any]:
    """Return a seed's row."""
    case = random_case(seed)
    row: dict[str, Any] = {"seed": seed, "kind": case.kind, "features": "; ".join(case.features)}
    result, frozen = load(case)
    parameters = choose_numbers(frozen, seed)
    row |= {"method": frozen.plan.integrator.name, "numbers": " ".join(each.key for each in parameters)}
    names = [f"{frozen.run.scene.simulation.tip}.position", "kinetic_energy"]
    found = fmd.jacobian(result, names, [each.key for each in parameters])
    lacking = {each.lacking for each in found if not each.by_tangents}
    apart = zip(("apart", "noise", "stated"), compare_tangents(frozen, found, parameters), strict=True)
    row |= {"lacking": "; ".join(lacking)} | {name: f"{size:.1e}" for name, size in apart}
    return row | {"adjoint": f"{compare_adjoint(frozen, parameters):.1e}"}


def compute_apart(seed: int) -> dict[str, Any]:
    """Return a seed's row from a process of its own, or why there is none."""
    case = random_case(seed)
    row: dict[str, Any] = dict.fromkeys(COLUMNS, "") | {"seed": seed, "kind": case.kind}
    if "friction" in case.features:
        return row | {"features": "; ".join(case.features), "remark": "friction"}
    own = subprocess.run([sys.executable, __file__, "--alone", str(seed)], capture_output=True, text=True, check=False)
    if own.returncode == 0:
        return row | json.loads(own.stdout.splitlines()[-1])
    last = own.stderr.strip().splitlines()[-1] if own.returncode > 0 else f"more than {SECONDS} processor seconds"
    return row | {"features": "; ".join(case.features), "remark": last}


def main(seeds: list[int]) -> None:
    """Compute what the table doesn't have."""
    done = {row["seed"] for row in csv.DictReader(TABLE.open())} if TABLE.exists() else set()
    with TABLE.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if not done:
            writer.writeheader()
        for seed in seeds:
            if str(seed) not in done:
                writer.writerow(row := compute_apart(seed))
                file.flush()
                print(row, flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "--alone":
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
        with tempfile.TemporaryDirectory() as folder:  # each variant has code of its own: compiled with little effort
            store.compile_object = lambda text, **_: compile_object(text, effort=0)
            store.kernel_folder = lambda: Path(folder)
            print(json.dumps(compute(int(sys.argv[2]))))
    else:
        main([int(seed) for seed in sys.argv[1:]])
