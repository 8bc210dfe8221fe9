"""``fmd bench``: run time of time integration alone against error."""

from __future__ import annotations

from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmd.cli.inputs import solve_scene
from fmd.cli.options import Flag, Json, Set, print_json
from fmd.cli.tables import new_table, open_console, print_files

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
        name, run = Path(scene).stem, solve_scene(scene, set_)
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
    title = f"{title} (two references differ by {result.reference_error:.0e})"
    table = new_table(title, "method", "step", "seconds", "error")
    for row in result.rows:
        table.add_row(row.integrator, f"{row.step_s:.3g}", f"{row.seconds:.3g}", f"{row.error:.2e}")
    open_console().print(table)


def _finite(row: Any) -> dict[str, Any]:
    """Return a row's figures with None for what isn't finite, which JSON can't hold."""
    return {key: None if isinstance(x, float) and not isfinite(x) else x for key, x in asdict(row).items()}
