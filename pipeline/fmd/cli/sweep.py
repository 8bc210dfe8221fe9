"""``fmd sweep``: one scene at every combination of values."""

import time
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from fmd.cli.options import Flag, Json, SceneName, Set, Several, print_json
from fmd.core.errors import InputError
from fmd.core.files import refusing
from fmd.core.progress import Bars
from fmd.sweep.local import compute_locally, prepare_workers
from fmd.sweep.points import Design
from fmd.sweep.record import Wanted

Vary = Annotated[
    list[str],
    Parameter(
        name="--vary", negative=(), help="A key and its values: key=a,b,c, or a range: key=low..high:count unit [log]."
    ),
]


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
    if workers is not None and (workers < 1 or scheduler is not None):
        raise InputError("--workers", "", workers, "must be 1 or more, and can't stand beside --scheduler")
    tick = time.perf_counter()
    name = Path(scene).stem
    folder = out or Path("out") / f"{name}-sweep"
    if histories and not of:
        raise InputError("--histories", "", None, "keeps histories among the results of --of: name some")
    if scheduler is None and not (folder / "points").exists():
        prepare_workers()  # which load while this process loads what reads scenes
    from joblib import cpu_count

    from fmd.cli.swept_points import print_sweep, read_results
    from fmd.sweep.plot import draw_sweep, prepare_charts
    from fmd.sweep.points import choose_values, make_points
    from fmd.sweep.study import run_sweep
    from fmd.sweep.table import SweepTable, write_tables

    variations, combinations = choose_values(vary, design, points, seed)
    summaries = budget or not of  # results by name are of the first run
    # Keys of the simulation are those over which runs are compared.
    every = summaries and (all_runs or any(variation.key.startswith("simulation.") for variation in variations))
    chosen = make_points(scene, variations, set_ or (), combinations, every)
    wanted = Wanted(budget, read_results(of or [], chosen), histories)
    compute = partial(compute_locally, workers=workers or cpu_count(), wanted=wanted)
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
        print_sweep(table, folder, files, summaries, seconds)
