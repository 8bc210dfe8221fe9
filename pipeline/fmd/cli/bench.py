"""``fmd bench``: run time of time integration alone against error."""

from __future__ import annotations

from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmd.cli.inputs import Options
from fmd.cli.options import Flag, Json, Set, print_json
from fmd.cli.tables import print_files, print_table
from fmd.core.errors import InputError

if TYPE_CHECKING:
    from fmd.output.work_precision import WorkPrecision


def bench(
    scenes: list[str], /, *, out: Path = Path("out/bench"), set_: Set = None, peer: Flag = False, json: Json = False
) -> None:
    """Run time of integration alone against error: every integrator on a scene, as a table, a CSV and a chart.

    Parameters
    ----------
    scenes
        Ready scenes or TOML files.
    out
        Folder for the CSV and the chart of each.
    peer
        Other programs' solvers beside ours where a scene has them as a peer; needs the extra 'bench'.
    """
    from fmd.output.work_precision import compare_on_scene, peer_rows, write_comparison

    rows: list[dict[str, Any]] = []
    for scene in scenes:
        name, run = Path(scene).stem, Options(set_).solve(scene)
        if run.scene.sampled:
            mend = "samples, which most methods don't end their steps at: without sample_time all can be compared"
            raise InputError(run.scene.file, f"controller.{run.scene.sampled[0]}", None, mend)
        result = compare_on_scene(run)
        if peer:
            result = replace(result, rows=(*result.rows, *peer_rows(name)))
        files = write_comparison(run, result, out, name)
        rows += [{"scene": name, **_finite(row)} for row in result.rows]
        if not json:
            _print_comparison(run.scene.title, result)
            print_files(out, files)
    if json:
        print_json({"rows": rows})


def _print_comparison(title: str, result: WorkPrecision) -> None:
    columns = {"method": "{}", "step": "{:.3g}", "seconds": "{:.3g}", "error": "{:.2e}"}
    title = f"{title} (two references differ by {result.reference_error:.0e})"
    print_table(title, columns, ((r.integrator, r.step_s, r.seconds, r.error) for r in result.rows))


def _finite(row: Any) -> dict[str, Any]:
    """Return a row's figures with None for what isn't finite, which JSON can't hold."""
    return {key: None if isinstance(x, float) and not isfinite(x) else x for key, x in asdict(row).items()}
