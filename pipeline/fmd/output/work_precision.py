"""Run time against error of every integrator on a scene's mechanism: rows, a CSV and a chart."""

import importlib
import platform
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from math import nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, InputError
from fmd.core.files import write_table
from fmd.core.limits.patience import MARCH_SECONDS
from fmd.core.limits.stability import NEARLY_STABLE
from fmd.core.limits.stepping import MOST_REPEATS, REPEATED_SECONDS
from fmd.dynamics.system import System
from fmd.integrators.exponential import Exponential
from fmd.integrators.protocol import Integrator, Trajectory
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.runge_kutta import RungeKutta
from fmd.recovery.motion import Motion
from fmd.scene.runs import RUNS
from fmd.stages.pipeline import Pipeline
from fmd.stages.run_checks import require_no_contact, require_no_gears

_PEERS = Path(__file__).parents[3] / "benchmarks"
_PEER_SCRIPTS = ("exudyn_peer", "exudyn_chains", "heyoka_peer")  # each has CASES, and measures one of them by `measure`
_EMPTY: Any = None


class Errors(NamedTuple):
    """Errors of a trajectory, each relative to the largest value over the motion; NaN for what the system lacks."""

    tip: float
    modal: float
    joint: float


ErrorsOf = Callable[[Trajectory, Trajectory], Errors]
"""A function that returns the errors of one trajectory against another."""


@dataclass(frozen=True)
class WorkPrecisionRow:
    """Run time and errors of one march."""

    integrator: str  # name of the method, with its ratio if it sub-cycles
    step_s: float  # step, of adaptive methods the mean one [s]
    substeps: int  # fast steps to one slow step
    seconds: float  # median run time
    error: float  # error of the tip against the reference
    evaluations: int  # solutions of the whole system; those of the fast part alone come on top
    modal_error: float = nan  # error of the modal coordinates, from which stress is recovered
    joint_error: float = nan  # error of the joints' coordinates


@dataclass(frozen=True)
class WorkPrecision:
    """Run time against error of all methods on one system."""

    rows: tuple[WorkPrecisionRow, ...]  # all marches that came to their end, method by method, coarse to fine
    reference_error: float  # difference of two independent references at the tip


def compare(
    system: System, q0: Array, v0: Array, times: Array, errors_of: ErrorsOf, repeats: int = 5, limit: float = 1e-8
) -> WorkPrecision:
    """March a system by every method, and measure run times and errors at times (n_times,) [s].

    The least run time of ``repeats`` marches counts, more of short ones, each with output at the end alone. Both
    references may differ by ``limit``.

    Raises
    ------
    AccuracyError
        The references, a Runge–Kutta method of order 8 and an exponential one, differ by more.
    """
    duration = float(times[-1])
    reference = RungeKutta(1e-13).march(system, q0, v0, times)
    other: Integrator = ExponentialRosenbrock(1e-12) if system.coupled else Exponential(duration / 20480)
    reference_error = errors_of(other.march(system, q0, v0, times), reference).tip
    if not reference_error < limit:
        raise AccuracyError(f"two references differ by {reference_error:.1e}, above {limit:.0e}")
    rows: list[WorkPrecisionRow] = []
    for methods in _families(system, duration):
        for label, method in methods:
            try:
                motion = method.march(system, q0, v0, times)
            except AccuracyError:  # it diverged at this step
                continue
            ends = times[[0, -1]]
            seconds = [method.march(system, q0, v0, ends).seconds]
            while (len(seconds) < repeats and sum(seconds) < MARCH_SECONDS) or (
                len(seconds) < MOST_REPEATS and sum(seconds) < REPEATED_SECONDS
            ):
                seconds.append(method.march(system, q0, v0, ends).seconds)
            errors, substeps = errors_of(motion, reference), motion.substeps
            figures = (min(seconds), errors.tip, motion.evaluations, errors.modal, errors.joint)
            rows.append(WorkPrecisionRow(label, float(motion.step), substeps, *figures))
            if min(seconds) > MARCH_SECONDS:
                break
    return WorkPrecision(tuple(rows), reference_error)


def _families(system: System, duration: float) -> Iterator[Iterator[tuple[str, Integrator]]]:
    """Yield each method's range, coarse to fine; steps divide a fifth of the duration, where a drive may end."""
    steps = [duration / (5 * 2**k) for k in range(3, 20)]
    explicit = [step for step in steps if step < NEARLY_STABLE * system.largest_step][:7]
    coarse = [step for step in steps if step >= explicit[-1]]
    for run in RUNS:
        for family in run.ladders(explicit, coarse):
            yield (
                (f"{method.name} {method.substeps}:1" if method.substeps > 1 else method.name, method)
                for method in family
                if method.suits(system) and method.step < NEARLY_STABLE * method.largest_step(system)
            )


def compare_on_scene(run: Pipeline, repeats: int = 5) -> WorkPrecision:
    """Compare all integrators on a scene's mechanism, from its start to its end; ``repeats`` marches are timed."""
    require_no_contact(run.scene, "a comparison of methods")
    require_no_gears(run.scene, "a comparison of methods")
    times = np.linspace(0.0, run.scene.simulation.duration, 101)
    q0, v0 = run.start
    return compare(run.system, q0, v0, times, errors_of(run), repeats)


def errors_of(run: Pipeline) -> ErrorsOf:
    """Make the function of the errors of the tip, of modal and of joint coordinates.

    The tip of a flexible body on the ground is seen from its joint, any other in space.
    """
    empty, seen_from_joint = Motion(run.mechanism, _EMPTY, run.divided_scene.simulation.tip), _from_joint(run)

    def errors(trajectory: Trajectory, exact: Trajectory) -> Errors:
        one, other = replace(empty, trajectory=trajectory), replace(empty, trajectory=exact)
        modal = [_relative(one.modal(name), other.modal(name)) for name in run.parts]
        joints = [_relative(one.joint_position(name), other.joint_position(name)) for name in one.joints]
        pair = [motion.tip_deflection if seen_from_joint else motion.tip_position for motion in (one, other)]
        return Errors(_relative(*pair), max(modal, default=np.nan), max(joints, default=np.nan))

    return errors


def _from_joint(run: Pipeline) -> bool:
    """Tell whether the tip is on a flexible body that hangs on the ground."""
    link = run.mechanism.links[run.mechanism.number_of(run.divided_scene.simulation.tip.partition(".")[0])]
    return link.parent < 0 and len(link.omega) > 0


def _relative(found: Array, exact: Array) -> float:
    """Return the largest difference at any time over the largest value."""
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def peer_rows(scene: str) -> list[WorkPrecisionRow]:
    """Measure other programs on their models of a scene; return no rows for a scene that none of them has.

    Raises
    ------
    InputError
        The scripts or a program are missing.
    """
    if not _PEERS.is_dir():
        raise InputError("--peer", "", None, "needs a checkout of the project: its folder benchmarks isn't installed")
    if str(_PEERS) not in sys.path:
        sys.path.append(str(_PEERS))
    rows: list[WorkPrecisionRow] = []
    for name in _PEER_SCRIPTS:
        try:
            module = importlib.import_module(name)
            if scene in module.CASES:
                rows += module.measure(scene)
        except ModuleNotFoundError as error:
            raise InputError("--peer", "", None, f"{error}, or the extra 'bench'") from None
    return rows


def write_comparison(run: Pipeline, result: WorkPrecision, folder: Path, name: str) -> list[str]:
    """Write the rows as CSV, after a line that names the machine, and the chart; return the files' names."""
    from fmd.render.plane_charts import draw_work_precision

    machine = f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}"
    note = f"# {machine}; two references differ by {result.reference_error:.1e}\n"
    rows = [asdict(row) for row in result.rows]
    texts = ([f"{x:.4g}" if isinstance(x, float) else x for x in row.values()] for row in rows)
    write_table(folder / f"{name}.csv", [*rows[0]], texts, note)
    curves: dict[str, Any] = {}
    for row in result.rows:
        curves.setdefault(row.integrator, []).append((row.seconds, max(row.error, 1e-16)))
    what = "deflection" if _from_joint(run) else "position"
    draw_work_precision(
        {label: np.array(points) for label, points in curves.items()},
        folder / f"{name}.png",
        title=f"{run.scene.title} ({run.system.n} coordinates): run time against error",
        error_label=f"largest error of the tip's {what} / largest {what}",
    )
    return [f"{name}.csv", f"{name}.png"]
