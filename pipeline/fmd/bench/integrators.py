"""Run time against error of every integrator on a scene's mechanism: rows, a CSV and a chart."""

from __future__ import annotations

import csv
import importlib
import platform
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.files import whole_file
from fmd.integrators.protocol import Trajectory
from fmd.stages.pipeline import Pipeline

if TYPE_CHECKING:
    from fmd.bench.work_precision import Errors, ErrorsOf, WorkPrecision, WorkPrecisionRow

# Scenes that `fmd bench` compares by default: name of the files, scene, overrides.
READY: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("rod-slider", "rod-slider", ()),
    ("beam", "beam", ()),
    ("beam-20-modes", "beam", ("body.beam.modes.count=20",)),
    ("beam-60-modes", "beam", ("body.beam.modes.count=60",)),
    ("arm", "arm", ()),
)
_PEERS = Path(__file__).parents[3] / "benchmarks"
_PEER_SCRIPTS = ("exudyn_peer", "exudyn_chains", "heyoka_peer")  # each has CASES, and peer_rows of one of them
_EMPTY: Any = None


def compare_on_scene(run: Pipeline, repeats: int = 5) -> WorkPrecision:
    """Compare all integrators on a scene's mechanism, from its start to its end; ``repeats`` marches are timed."""
    from fmd.bench.work_precision import compare

    times = np.linspace(0.0, run.scene.simulation.duration, 101)
    q0, v0 = run.start
    return compare(run.system, q0, v0, times, errors_of(run), repeats)


def errors_of(run: Pipeline) -> ErrorsOf:
    """Make the function of the errors of the tip, of modal and of joint coordinates.

    The tip of a flexible body on the ground is seen from its joint, any other in space.
    """
    from fmd.bench.work_precision import Errors
    from fmd.recovery.motion import Motion

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
                rows += module.peer_rows(scene)
        except ModuleNotFoundError as error:
            raise InputError("--peer", "", None, f"{error}, or the extra 'bench'") from None
    return rows


def write_comparison(run: Pipeline, result: WorkPrecision, folder: Path, name: str) -> list[str]:
    """Write the rows as CSV, after a line that names the machine, and the chart; return the files' names."""
    from fmd.render.precision_chart import draw_work_precision

    folder.mkdir(parents=True, exist_ok=True)
    with whole_file(folder / f"{name}.csv") as part, part.open("w", newline="") as file:
        file.write(f"# {platform.machine()}, {platform.system()}, Python {platform.python_version()}; ")
        file.write(f"two references differ by {result.reference_error:.1e}\n")
        rows = [asdict(row) for row in result.rows]
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)
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
