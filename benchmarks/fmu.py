"""FMUs of the ready scenes, run by FMPy beside the scene's own motion: errors, sizes and run time; writes fmu.csv.

    python benchmarks/fmu.py [--out CSV] [SCENE …]

Errors are those of the tip's place over the duration, relative to its farthest from the origin, and of the angle or
displacement of the joints; the reference is the scene's own Runge–Kutta method at a tolerance of 1e-13. Run time is
that of one long step beside the machine code's by the same method, side by side, the least of several. The sources are
also built by each compiler that is here, and run. Needs FMPy, ziglang and gcc.
"""

import argparse
import re
import shutil
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import fmpy
import numpy as np
from few_modes import few_modes
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu
from table_format import write_rows

from fmd import load
from fmd.core.limits.stepping import CO_SIMULATED
from fmd.integrators.runge_kutta import RungeKutta
from fmd.output.fmu.build import TARGETS
from fmd.output.fmu.write import list_platforms, write_fmu
from fmd.recovery.motion import Motion

SCENES = ("rod-slider", "beam-paper", "arm", "spin-up", "propeller")
TOLERANCES = (1e-6, 1e-9, 1e-12)
FINER = 8  # CVode takes 500 steps at most from one output to the next
REPEATS = 7
PLACES = (str(Path.home()), str(Path.cwd()), sys.prefix, "fmd-fmu-")


def error_of(motion: Motion, file: Path, kind: str, finer: int = 1, **options: Any) -> float:
    """Return the largest error of joints and tip over the duration, each relative to its own largest value."""
    joints = [f"{name}.position" for name in motion.joints]
    tip = [f"{motion.tip}.position[{k}]" for k in (1, 2, 3)]
    end, step = float(motion.times[-1]), float(motion.times[1])
    rows = fmpy.simulate_fmu(
        str(file), fmi_type=kind, stop_time=end, output_interval=step / finer, output=[*joints, *tip], **options
    )
    at = np.argmin(np.abs(rows["time"][:, None] - motion.times), axis=1)
    there = np.abs(rows["time"] - motion.times[at]) < 1e-9
    at = at[there]
    errors = []
    for name, own in zip(joints, motion.joints, strict=True):
        ours = motion.joint_position(own)
        errors.append(np.abs(rows[name][there] - ours[at]).max() / np.abs(ours).max())
    place = np.stack([rows[name][there] for name in tip], axis=1)
    farthest = np.linalg.norm(motion.tip_position, axis=1).max()
    errors.append(np.linalg.norm(place - motion.tip_position[at], axis=1).max() / farthest)
    return float(max(errors))


def open_slave(file: Path, folder: Path) -> FMU2Slave:
    """Open an FMU of FMI 2.0 for co-simulation."""
    description = fmpy.read_model_description(str(file))
    fmpy.extract(str(file), unzipdir=str(folder))
    name = description.coSimulation.modelIdentifier
    slave = FMU2Slave(guid=description.guid, unzipDirectory=str(folder), modelIdentifier=name, instanceName="x")
    slave.instantiate()
    return slave


def seconds_of(slave: FMU2Slave, duration: float) -> float:
    """Return the run time of one step over the duration [s]."""
    slave.reset()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    tick = time.perf_counter()
    slave.doStep(0.0, duration)
    return time.perf_counter() - tick


def compare_speed(run: Any, file: Path, folder: Path) -> tuple[float, float, int]:
    """Return the least run times of the machine code and of the FMU [s], and the former's evaluations."""
    duration, method = float(run.scene.simulation.duration), RungeKutta(CO_SIMULATED)
    slave, times = open_slave(file, folder), np.array([0.0, duration])
    method.march(run.system, *run.start, times)
    ours, theirs = [], []
    for _ in range(REPEATS):
        march = method.march(run.system, *run.start, times)
        ours.append(march.seconds)
        theirs.append(seconds_of(slave, duration))
    return min(ours), min(theirs), march.evaluations


def build_sources(file: Path, folder: Path) -> list[str]:
    """Build the FMU's sources by gcc and by Zig with plain options, and run both; return the compilers."""
    done = []
    compilers = {"gcc": ["gcc"], "zig": [sys.executable, "-m", "ziglang", "cc"]}
    for name, compiler in compilers.items():
        place = folder / name
        fmpy.extract(str(file), unzipdir=str(place))
        (library,) = place.glob("binaries/linux64/*")
        library.unlink()
        sources = sorted(str(path) for path in place.glob("sources/*.c"))
        command = [*compiler, "-std=c99", "-O2", "-Wall", "-Werror", "-shared", "-fPIC", "-o", str(library), *sources]
        subprocess.run([*command, "-lm"], check=True)
        packed = shutil.make_archive(str(folder / name), "zip", place)
        fmpy.simulate_fmu(packed, fmi_type="CoSimulation", stop_time=1e-3)
        done.append(name)
    return done


def find_paths(file: Path) -> list[str]:
    """Return places of this machine that occur in an FMU."""
    found = []
    with zipfile.ZipFile(file) as archive:
        for name in archive.namelist():
            data = archive.read(name)
            found += [f"{name}: {place}" for place in PLACES if place.encode() in data]
            found += [f"{name}: {hit.decode()}" for hit in re.findall(rb"/(?:home|root|tmp|work|Users)/[\w./-]+", data)]
    return found


def measure(scene: str, folder: Path) -> dict[str, str]:
    """Export a scene and measure its FMUs; one row of the table."""
    run = load(scene, *few_modes(scene)).run
    tick = time.perf_counter()
    files = write_fmu(run, None, folder / f"{scene}.fmu")
    seconds = time.perf_counter() - tick
    for file in files:
        if faults := [*validate_fmu(str(file)), *find_paths(file)]:
            raise SystemExit(f"{file.name}: {faults}")
    if list_platforms(files[1]) != sorted(target.name for target in TARGETS):
        raise SystemExit(f"{scene} lacks binaries")
    exact = load(scene, *few_modes(scene), 'simulation.run=[{integrator="runge-kutta", tolerance=1e-13}]').motion
    row = {"scene": scene, "modes": str(sum(len(link.omega) for link in run.mechanism.links))}
    row |= {"kilobytes_fmi2": f"{files[0].stat().st_size / 1e3:.0f}"}
    row |= {"kilobytes_fmi3": f"{files[1].stat().st_size / 1e3:.0f}", "export_s": f"{seconds:.2g}"}
    for file, version in zip(files, (2, 3), strict=True):
        for tolerance in TOLERANCES:
            error = error_of(exact, file, "CoSimulation", start_values={"solver.tolerance": tolerance})
            row[f"cs_{tolerance:.0e}_fmi{version}"] = f"{error:.1e}"
        row[f"me_fmi{version}"] = f"{error_of(exact, file, 'ModelExchange', FINER, relative_tolerance=1e-13):.1e}"
    ours, theirs, evaluations = compare_speed(run, files[0], folder / "speed" / scene)
    row |= {"evaluations": str(evaluations), "fmd_s": f"{ours:.3g}", "fmu_s": f"{theirs:.3g}"}
    row |= {"ratio": f"{theirs / ours:.2f}", "sources_built_by": " ".join(build_sources(files[0], folder / scene))}
    return row


def main() -> None:
    """Measure all scenes and write the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".csv"))
    given = parser.parse_args()
    rows = []
    with TemporaryDirectory() as folder:
        for scene in given.scenes:
            rows.append(measure(scene, Path(folder)))
            print(rows[-1], flush=True)
    write_rows(given.out, rows)


if __name__ == "__main__":
    main()
