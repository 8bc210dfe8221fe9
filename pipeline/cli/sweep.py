"""``fmd sweep``."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from pipeline.cli.options import Json, SceneName, Set, print_json

Vary = Annotated[
    list[str],
    Parameter(name="--vary", negative=(), help="A key and its values: key=a,b,c, e.g. simulation.step=1us,2us."),
]


def sweep(
    scene: SceneName,
    *,
    vary: Vary,
    set_: Set = None,
    out: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    json: Json = False,
) -> None:
    """Run a scene at every combination of values, on all cores or a cluster; a sweep that was stopped goes on.

    Parameters
    ----------
    out
        Folder for the table and the points that are done; out/SCENE-sweep by default.
    workers
        How many processes, all cores by default.
    scheduler
        Address of a Dask scheduler, e.g. tcp://host:8786, to send the points to; needs the extra 'cluster'.
    """
    from joblib import cpu_count

    from pipeline.core.errors import InputError
    from pipeline.core.progress import bars
    from pipeline.sweep.cluster import on_cluster
    from pipeline.sweep.local import on_this_machine
    from pipeline.sweep.points import points_of, varied_of
    from pipeline.sweep.study import sweep as compute
    from pipeline.sweep.table import write_tables

    if workers is not None and (workers < 1 or scheduler is not None):
        raise InputError("--workers", "", workers, "must be 1 or more, and can't stand beside --scheduler")
    tick = time.perf_counter()
    varied = varied_of(vary)
    points = points_of(scene, varied, set_ or ())
    name = Path(scene).stem
    folder = out or Path("out") / f"{name}-sweep"
    work = (
        partial(on_this_machine, workers=workers or cpu_count())
        if scheduler is None
        else partial(on_cluster, address=scheduler)
    )
    try:
        found = compute(varied, points, folder / "points", work, bars)
        files, rows = write_tables(found, folder)
    except OSError as error:
        raise InputError("--out", "", str(folder), f"can't be written: {error.strerror or error}") from error
    seconds = time.perf_counter() - tick
    if json:
        counts = {"points": len(rows), "computed": found.computed, **found.counts}
        print_json({"scene": name, **counts, "seconds": seconds, "rows": rows, "files": files})
    else:
        from pipeline.cli.tables import print_sweep

        print_sweep(found, rows, seconds, folder, files)
