"""``fmd sweep``: one scene at every combination of values."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from fmd.cli.options import Flag, Json, SceneName, Set, Several, print_json
from fmd.cli.tables import open_console, print_files, print_table
from fmd.core.errors import InputError
from fmd.core.files import refusing
from fmd.core.html import scaled
from fmd.core.limits.shown import SWEPT_JOINTS, SWEPT_ROWS
from fmd.core.progress import Bars
from fmd.scene.result_names import require_results
from fmd.sweep.designs import Design
from fmd.sweep.local import compute_locally, prepare_workers
from fmd.sweep.plot import JOINT_FIGURE, draw_sweep, prepare_charts
from fmd.sweep.points import Point, choose_values, make_points, split_names
from fmd.sweep.record import Wanted
from fmd.sweep.study import Compute, Sweep, run_sweep
from fmd.sweep.table import SweepTable, write_tables

Vary = Annotated[
    list[str],
    Parameter(
        name="--vary", negative=(), help="A key and its values: key=a,b,c, or a range: key=low..high:count unit [log]."
    ),
]
_COMPARING = "simulation."  # keys over which runs are compared
# Figures that fit a terminal, with their column and unit; the files have all.
_FIGURES = {
    "frequencies_hz.0": ("mode 1 Hz", ""),
    "worst_stress.von_mises_pa": ("stress", "Pa"),
    "peak_tip_deflection_m": ("tip", "m"),
    "run.0.stability_margin": ("limit/step", ""),
    "run.0.seconds": ("time of integration", "s"),
}


def sweep(
    scene: SceneName,
    *,
    vary: Vary,
    of: Several = None,
    set_: Set = None,
    out: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    design: Design | None = None,
    points: int | None = None,
    seed: int = 0,
    budget: Flag = False,
    histories: Flag = False,
    all_runs: Flag = False,
    json: Json = False,
) -> None:
    """Run a scene at every combination of values, on all cores or a cluster; a sweep that was stopped goes on.

    Parameters
    ----------
    of
        Results that become columns and charts, with commas between them: tip, BODY.stress, BODY.life, arm.force.size,
        "OUTPUT by INPUT" (peak of a frequency response of the scene), or a formula, "error = arm.tip.y - 0.3". Nothing
        else is computed of the points; without it they have the figures of a run's summary.
    out
        Folder for the table, the plot and the points that are done; out/SCENE-sweep by default.
    workers
        Number of processes, all cores by default.
    scheduler
        Address of a Dask scheduler, e.g. tcp://host:8786, to send the points to; needs the extra 'cluster'.
    design
        Sample ranges key=low..high unit in place of combining values.
    points
        Number of points of the design.
    seed
        Of the design's random numbers.
    budget
        State errors: each point gets its error budget, which takes up to three times as long as its run.
    histories
        Keep the histories among the results of --of in sweep.nc.
    all_runs
        Compute all of the scene's runs at each point, not the first alone; so do keys of the simulation without it.
    """
    from joblib import cpu_count

    if workers is not None and (workers < 1 or scheduler is not None):
        raise InputError("--workers", "", workers, "must be 1 or more, and can't stand beside --scheduler")
    tick = time.perf_counter()
    variations, combinations = choose_values(vary, design, points, seed)
    name = Path(scene).stem
    folder = out or Path("out") / f"{name}-sweep"
    if histories and not of:
        raise InputError("--histories", "", None, "keeps histories among the results of --of: name some")
    if scheduler is None and len([*folder.glob("points/*.json")]) < len(combinations):
        prepare_workers()
    summaries = budget or not of  # results by name are of the first run
    every = summaries and (all_runs or any(variation.key.startswith(_COMPARING) for variation in variations))
    chosen = make_points(scene, variations, set_ or (), combinations, every)
    wanted = Wanted(budget, _read_results(of or [], chosen), histories)
    compute: Compute = partial(compute_locally, workers=workers or cpu_count(), wanted=wanted)
    if scheduler is not None:
        from fmd.sweep.cluster import compute_on_cluster

        compute = partial(compute_on_cluster, address=scheduler, wanted=wanted)
    prepare_charts()
    with refusing("--out", folder):
        result = run_sweep(variations, chosen, folder / "points", compute, Bars(), wanted)
        table = SweepTable(result)
        files, rows = write_tables(table, folder), table.rows
        files += draw_sweep(table, folder, f"{name}: {len(rows)} points")
    seconds = time.perf_counter() - tick
    if json:
        counts = {"points": len(rows), "computed": result.computed, **result.counts}
        print_json({"scene": name, **counts, "seconds": seconds, "rows": rows, "files": files})
    else:
        _print_points(table, rows)
        print_messages(result)
        if summaries and (left_out := max(point.left_out for point in result.points)):
            open_console().print(f"points have the first of the scene's {left_out + 1} runs; --all-runs computes all")
        statuses = ", ".join(f"{number} {status}" for status, number in result.counts.items() if number)
        open_console().print(f"{len(rows)} points: {statuses}; {result.computed} computed now, in {seconds:.1f} s")
        print_files(folder, files)


def _read_results(of: Sequence[str], chosen: Sequence[Point]) -> tuple[str, ...]:
    """Read the names of the results of ``--of``, which the first scene that isn't refused must have."""
    if not of:
        return ()
    results = tuple(dict.fromkeys(split_names("--of", of)))
    require_results(next(point.scene for point in chosen if point.scene is not None), results)
    return results


def _print_points(table: SweepTable, rows: Sequence[dict[str, Any]]) -> None:
    result, asked = table.sweep, {column: (column, unit) for unit, own in table.results.values() for column in own}
    joints = [name for name in rows[0] if name.startswith(JOINT_FIGURE)][:SWEPT_JOINTS]
    figures = _FIGURES | {name: (name.removeprefix(JOINT_FIGURE), "") for name in joints}
    figures = {
        name: words for name, words in (asked or figures).items() if any(row.get(name) is not None for row in rows)
    }
    short = {variation.key: variation.key.rpartition(".")[2] for variation in result.variations}
    taken = [*short.values(), "status", *(column for column, _ in figures.values())]
    keys = [key if taken.count(name) > 1 else name for key, name in short.items()]
    columns = dict.fromkeys(("", *keys, *taken[len(keys) :]), "{}")
    cells = [
        (k, *point.values, row["status"], *(_write(row[name], unit) for name, (_, unit) in figures.items()))
        for k, (point, row) in enumerate(zip(result.points[:SWEPT_ROWS], rows, strict=False), start=1)
    ]
    print_table("Points", columns, cells)
    if (more := len(rows) - len(cells)) > 0:
        open_console().print(f"and {more} more {'point' if more == 1 else 'points'}: sweep.csv")


def _write(value: float | None, unit: str) -> str:
    return "" if value is None else scaled(value, unit)


def print_messages(result: Sweep) -> None:
    """Print each message and each warning once, after the numbers of its points."""
    points: dict[str, list[str]] = {}
    for number, record in enumerate(result.records, start=1):
        told = [record.message, *(f"warning: {each['text']}" for each in record.summary.get("warnings", []))]
        for text in filter(None, told):
            points.setdefault(text, []).append(str(number))
    for text, where in points.items():
        open_console().print(f"{', '.join(where)}: {text}")
