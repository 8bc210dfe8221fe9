"""Time of a step by each method, side by side with an earlier version of the project.

Run from the project's root: ``python benchmarks/march_speed.py --before CHECKOUT [SCENE]…``; CHECKOUT is the root of
the earlier version. Each version marches in a process of its own, by turns, from the same start with the same steps;
each has the smallest time of its repetitions, and the ratio is that of these. Steps are a fifth of the largest stable
one of central differences, fast steps where the method sub-cycles; generalised-α and the exponential method take ten
times as long ones. Adaptive methods have a tolerance of 1e-6, and their time is that of an evaluation of the equations
as the method counts them, the ratio that of whole marches.

Operations are those of the compiled function that a step of central differences calls, counted in its graph. The rate
of multiplications and additions that this reaches stands beside that of a dense matrix product on one thread. Compiling
is measured apart: all that `Pipeline.motions` traces and compiles for the ready scenes where nothing is kept.
"""

import argparse
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from few_modes import few_modes
from table_format import machine, renew_rows

ROOT = Path(__file__).parents[1]
HERE = Path(__file__).parent
REPETITIONS = 7
MANY = 40  # coordinates, with which a first march is shorter
SHORTEST, LONGEST = 0.01, 0.4  # s, of a march that is timed, but for what the scene's duration is too short for
SCENES: dict[str, tuple[str, tuple[str, ...]]] = {
    "beam, 5 modes": ("beam-paper", ()),
    "beam, 20 modes": ("beam-paper", ("body.beam.modes.count=20",)),
    "beam, 60 modes": ("beam-paper", ("body.beam.modes.count=60",)),
    "arm": ("arm", few_modes("arm")),
    "robot": (str(HERE / "scenes" / "robot.toml"), ()),
    "ten links": ("chain", ()),
    "rod-slider": ("rod-slider", ()),
}
# Module, class, and the step in fast steps, or a tolerance.
METHODS_OF = {
    "central-difference": ("central_difference", "CentralDifference", 1.0),
    "reversible": ("reversible", "ReversibleSubcycling", 1.0),
    "generalized-alpha": ("generalized_alpha", "GeneralizedAlpha", 10.0),
    "exponential": ("exponential", "Exponential", 10.0),
    "exponential-rosenbrock": ("rosenbrock", "ExponentialRosenbrock", 1e-6),
    "runge-kutta": ("runge_kutta", "RungeKutta", 1e-6),
}
RATIOS = {"reversible": (" 10:1",)}
METHODS = tuple(label + ratio for label in METHODS_OF for ratio in RATIOS.get(label, ("",)))
TOO_LONG = {("ten links", "exponential-rosenbrock")}  # an earlier version takes minutes
LINKS = {"chain": 10, "long chain": 30}  # numbers of links
READY = ("rod-slider", "beam-paper", "arm", "spin-up", "propeller", "propeller-torque", "propeller-gust")
COMPILED = {scene: scene for scene in READY}
COMPILED |= {"beam-paper": "beam", "chain": "ten links", "long chain": "thirty links"}


def chain_of_links(count: int) -> str:
    """Write a scene with links of five modes, each turned by a right angle about the last one's axis."""
    parts = ['title = "Chain of flexible links"']
    for k in range(count):
        axis, parent = ("[0, 0, 1]", "[0, 1, 0]")[k % 2], f"link{k - 1}.end" if k else "ground"
        parts.append(f"""
[body.link{k}]
shape = "bar"
length = "200 mm"
depth = "10 mm"
width = "12 mm"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = {{ element = "hexahedron", order = 2, divisions = [8, 1, 1] }}
modes = {{ count = 5, boundary = "joint", enrich = "none" }}
marker = {{ base = {{ face = "x-" }}, end = {{ face = "x+" }} }}

[joint.hinge{k}]
type = "revolute"
parent = "{parent}"
child = "link{k}.base"
axis = {axis}
spring = "40 N m"
damper = "0.1 N m s"
""")
    parts.append(f"""
[drive.swing]
type = "torque"
joint = "hinge0"
torque = {{ formula = "5*sin(2*pi*t)", unit = "N m" }}

[simulation]
duration = "0.2 s"
step = "1 us"
output_step = "10 ms"
gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]
tip = "link{count - 1}.end"
stiffening = "off"

[[simulation.run]]
integrator = "central-difference"
""")
    return "\n".join(parts)


# In the process of a version: nothing here may use what only one of them has, but for the branch in `open_scene`.


def open_scene(scene: str, overrides: list[str]) -> tuple[Any, Any]:
    """Return a scene's pipeline and the system that its integrators march, of whichever version this process has."""
    from fmd import Pipeline, load_scene

    if scene in LINKS:
        path = Path(tempfile.mkdtemp()) / "chain.toml"
        path.write_text(chain_of_links(LINKS[scene]))
        scene = str(path)
    run = Pipeline(load_scene(scene, overrides))
    return run, run.system if hasattr(run, "system") else run.mechanism


def make_method(name: str, step: float) -> Any:
    """Make an integrator by its name in `METHODS`; ``step`` is the fast one [s]."""
    label, _, ratio = name.partition(" ")
    module, kind, setting = METHODS_OF[label]
    method = getattr(importlib.import_module(f"fmd.integrators.{module}"), kind)
    settings = (setting * step,) if setting > 1e-3 else (setting,)
    return method(*settings, *([int(ratio.partition(":")[0])] if ratio else []))


def step_of(scene: str, overrides: list[str]) -> dict[str, float]:
    """Return a fifth of the largest stable step of central differences and the scene's duration [s], and operations."""
    from fmd.integrators.central_difference import CentralDifference

    run, system = open_scene(scene, overrides)
    found = {"step": CentralDifference(1.0).largest_step(system) / 5, "duration": run.scene.simulation.duration}
    return found | {"n": system.n, "flops": system.compiled.flops("leap") if hasattr(system, "compiled") else 0}


def serve() -> None:
    """March as lines of the standard input ask, and answer each by a line."""
    systems: dict[str, tuple[Any, Any]] = {}
    for line in sys.stdin:
        asked = json.loads(line)
        key = json.dumps([asked["scene"], asked["overrides"]])
        if key not in systems:
            systems = {key: open_scene(asked["scene"], asked["overrides"])}
        run, system = systems[key]
        method, (q0, v0) = make_method(asked["method"], asked["step"]), run.start
        try:
            found = method.march(system, q0, v0, np.array([0.0, asked["time"]]))
        except Exception as error:  # a method that doesn't fit the scene: the answer says so
            answer: dict[str, Any] = {"error": f"{type(error).__name__}: {error}"}
        else:
            steps = asked["time"] / method.step if method.step else found.evaluations
            answer = {"seconds": found.seconds, "steps": steps, "speed": float(np.abs(found.v[-1]).max())}
        print("answer " + json.dumps(answer), flush=True)


def compile_all(scene: str) -> dict[str, float]:
    """Return the processor seconds for tracing and compiling all of a scene's motions, and their number."""
    from fmd.dynamics.compiler import compiled, signal_code, store

    spent, count = 0.0, 0

    def timed(load: Any) -> Any:
        def load_timed(*arguments: Any) -> Any:
            nonlocal spent, count
            tick = time.process_time()
            found = load(*arguments)
            spent, count = spent + time.process_time() - tick, count + 1
            return found

        return load_timed

    store.read_code = lambda path: None  # as if nothing was kept
    compiled.load_program = signal_code.load_program = timed(store.load_program)
    run, system = open_scene(scene, list(few_modes(scene)))
    if scene == "chain":
        make_method("central-difference", 1e-6).march(system, *run.start, np.array([0.0, 1e-4]))
    else:
        _ = run.motions
    return {"seconds": spent, "functions": count, "n": system.n}


# In the process that compares them.


@dataclass
class Version:
    """A version of the project in a process of its own."""

    root: Path
    cache: str

    def environment(self) -> dict[str, str]:
        """Return the variables of its processes: one thread, and a cache of its own."""
        alone = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        return os.environ | alone | {"PYTHONPATH": str(self.root / "pipeline"), "FMD_CACHE": self.cache}

    def start(self) -> None:
        """Start the process."""
        self.process = subprocess.Popen(
            [sys.executable, __file__, "--serve"], cwd=self.root, env=self.environment(), text=True, bufsize=1,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def ask(self, **what: Any) -> dict[str, Any]:
        """March once."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(what) + "\n")
        for line in self.process.stdout:
            if line.startswith("answer "):
                return dict(json.loads(line.removeprefix("answer ")))
        raise RuntimeError(f"{self.root}: the process ended")

    def call(self, *arguments: str) -> dict[str, float]:
        """Call this script in a process of its own."""
        command = [sys.executable, __file__, *arguments]
        done = subprocess.run(command, cwd=self.root, env=self.environment(), check=True, capture_output=True)
        return dict(json.loads(done.stdout.splitlines()[-1]))


def compare_methods(versions: list[Version], label: str, dgemm: float) -> list[dict[str, str]]:
    """March a scene by all methods, the versions by turns; the last version is this one."""
    scene, overrides = SCENES[label]
    found = versions[-1].call("--step-of", scene, *overrides)
    step, rows = found["step"], []
    for method in METHODS:
        if (label, method) in TOO_LONG:
            continue
        asked: dict[str, Any] = {"scene": scene, "overrides": overrides, "method": method, "step": step}
        asked["time"] = min(found["duration"], (5000 if found["n"] < MANY else 300) * step)
        first = [version.ask(**asked) for _ in range(2) for version in versions][2:]  # before, it compiles
        if any("error" in answer for answer in first):
            print(label, method, *first, flush=True)
            continue
        seconds = [answer["seconds"] for answer in first]
        longer = min(max(1.0, SHORTEST / min(seconds)), LONGEST / max(seconds))
        long = asked | {"time": min(found["duration"], asked["time"] * longer)}
        if not any("error" in version.ask(**long) for version in versions):  # else it diverges later
            asked = long
        answers = [[version.ask(**asked) for version in versions] for _ in range(REPETITIONS)]
        speeds = [answer["speed"] for answer in answers[0]]
        if max(speeds) > 1.5 * min(speeds):
            print(label, method, "not the same motion: small vibrations grow", *speeds, flush=True)
            continue
        best = [min(turn[k]["seconds"] for turn in answers) for k in range(len(versions))]
        each = [1e9 * seconds / answers[0][k]["steps"] for k, seconds in enumerate(best)]
        row = {"scene": label, "coordinates": f"{found['n']}", "method": method}
        row |= {"before_ns": f"{each[0]:.3g}", "now_ns": f"{each[-1]:.3g}", "ratio": f"{best[0] / best[-1]:.2f}"}
        plain = method == "central-difference"
        row |= {"flops": f"{found['flops']:.0f}" if plain else ""}
        row |= {"gflop_s": f"{found['flops'] / each[-1]:.2f}" if plain else ""}
        row |= {"of_dgemm": f"{found['flops'] / each[-1] / dgemm:.3f}" if plain else ""}
        rows.append(row)
        print(*row.values(), *(f"{turn['speed']:.6g}" for turn in answers[0]), sep="  ", flush=True)
    return rows


def measure_dgemm() -> float:
    """Return the 1e9 operations a second of a dense product of double precision, on as many threads as NumPy has."""
    A, seconds = np.random.default_rng(0).random((500, 500)), []
    for _ in range(100):
        tick = time.perf_counter()
        A @ A
        seconds.append(time.perf_counter() - tick)
    return 2 * 0.5**3 / min(seconds)


def measure_compiling(version: Version, scenes: Sequence[str]) -> list[dict[str, str]]:
    """Compile what scenes march with, each in a process of its own."""
    rows = []
    for scene in scenes:
        found = version.call("--compile", scene)
        row = {"scene": COMPILED[scene], "coordinates": f"{found['n']:.0f}"}
        rows.append(row | {"functions": f"{found['functions']:.0f}", "seconds": f"{found['seconds']:.2f}"})
        print(*rows[-1].values(), sep="  ", flush=True)
    return rows


def renew(name: str, rows: list[dict[str, str]], scenes: tuple[str, ...], note: str = "") -> None:
    """Write rows as CSV; those of other scenes that the file has stay."""
    renew_rows(HERE / name, rows, ("scene",), lambda row: scenes.index(row["scene"]), machine() + note)


def main() -> None:
    """Measure and write the tables, or do a part in the process of a version."""
    if sys.argv[1:2] == ["--serve"]:
        serve()
    elif sys.argv[1:2] == ["--step-of"]:
        print(json.dumps(step_of(sys.argv[2], sys.argv[3:])))
    elif sys.argv[1:2] == ["--compile"]:
        print(json.dumps(compile_all(sys.argv[2])))
    else:
        reader = argparse.ArgumentParser()
        reader.add_argument("--before", type=Path, help="a checkout of the earlier version; without, compiling alone")
        reader.add_argument(
            "scenes", nargs="*", help=f"some of {', '.join(SCENES)}; without, {', '.join(COMPILED)}", metavar="SCENE"
        )
        chosen = reader.parse_args()
        with tempfile.TemporaryDirectory() as folder:
            if chosen.before is None:
                here = Version(ROOT, os.environ.get("FMD_CACHE", folder))
                rows = measure_compiling(here, chosen.scenes or tuple(COMPILED))
                renew("compiling.csv", rows, tuple(COMPILED.values()))
                return
            versions = [Version(chosen.before.resolve(), f"{folder}/before"), Version(ROOT, f"{folder}/now")]
            if os.environ.get("FMD_CACHE"):
                versions = [Version(v.root, f"{os.environ['FMD_CACHE']}-{k}") for k, v in enumerate(versions)]
            for version in versions:
                version.start()
            dgemm = measure_dgemm()
            for label in chosen.scenes or SCENES:
                rows = compare_methods(versions, label, dgemm)
                note = "; of_dgemm is beside a dense product of the same run, on one thread"
                renew("march_speed.csv", rows, tuple(SCENES), note)


if __name__ == "__main__":
    main()
