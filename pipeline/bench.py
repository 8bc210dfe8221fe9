"""Run time against error for a scene: rows, a CSV and a chart."""

from __future__ import annotations

import csv
import platform
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.files import whole_file
from pipeline.integrators.protocol import Trajectory
from pipeline.stages import Pipeline

if TYPE_CHECKING:
    from pipeline.studies.work_precision import ErrorOf, WorkPrecision

ERROR_LABEL = {
    True: "largest error of the tip's deflection / largest deflection",
    False: "largest error of the tip / 1 m",
}


def bench(run: Pipeline, repeats: int = 5) -> WorkPrecision:
    """Compare all integrators on a scene's mechanism, from its start to its end; ``repeats`` marches are timed."""
    from pipeline.studies.work_precision import compare

    times = np.linspace(0.0, run.scene.simulation.duration, 101)
    q0, v0 = run.start
    return compare(run.mechanism, q0, v0, times, _error_of(run), repeats)


def _error_of(run: Pipeline) -> ErrorOf:
    """Error of the tip: of its deflection where there is one, else of its position."""
    from pipeline.recovery.chain_motion import ChainMotion
    from pipeline.recovery.motion import Motion

    if run.flexible:
        motion = Motion(run.rotor, _EMPTY, run.scene.simulation.tip.partition(".")[2])

        def deflection(found: Trajectory, exact: Trajectory) -> float:
            wanted = replace(motion, trajectory=exact).tip_deflection
            apart = replace(motion, trajectory=found).tip_deflection - wanted
            return float(np.abs(apart).max() / np.abs(wanted).max())

        return deflection
    chain = ChainMotion(run.chain.tree, _EMPTY, run.chain.tip, run.chain.joints)

    def position(found: Trajectory, exact: Trajectory) -> float:
        apart = replace(chain, trajectory=found).tip_position - replace(chain, trajectory=exact).tip_position
        return float(np.linalg.norm(apart, axis=1).max())

    return position


_EMPTY: Any = None


def write_bench(run: Pipeline, result: WorkPrecision, folder: Path) -> list[str]:
    """Write the rows as CSV, with the machine they came from, and the chart; return the files' names."""
    from pipeline.render.precision_chart import draw_work_precision

    folder.mkdir(parents=True, exist_ok=True)
    name = run.scene.name
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
    draw_work_precision(
        {label: np.array(points) for label, points in curves.items()},
        folder / f"{name}.png",
        title=f"{run.scene.title}: run time against error",
        error_label=ERROR_LABEL[run.flexible],
    )
    return [f"{name}.csv", f"{name}.png"]
