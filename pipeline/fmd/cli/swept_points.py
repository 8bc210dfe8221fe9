"""Points of a sweep in the terminal, and the results that are asked for of them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fmd.cli.tables import open_console, print_files, print_table
from fmd.core.html import scaled
from fmd.core.limits.shown import SWEPT_JOINTS, SWEPT_ROWS
from fmd.scene.result_names import require_results
from fmd.sweep.plot import JOINT_FIGURE
from fmd.sweep.points import Point, split_names
from fmd.sweep.study import Sweep
from fmd.sweep.table import SweepTable

# Figures that fit a terminal, with their column and unit; the files have all.
_FIGURES = {
    "frequencies_hz.0": ("mode 1 Hz", ""),
    "worst_stress.von_mises_pa": ("stress", "Pa"),
    "peak_tip_deflection_m": ("tip", "m"),
    "run.0.stability_margin": ("limit/step", ""),
    "run.0.seconds": ("time of integration", "s"),
}


def read_results(of: Sequence[str], chosen: Sequence[Point]) -> tuple[str, ...]:
    """Read the names of the results of ``--of``, which the first scene that isn't refused must have."""
    if not of:
        return ()
    results = tuple(dict.fromkeys(split_names("--of", of)))
    require_results(next(point.scene for point in chosen if point.scene is not None), results)
    return results


def print_sweep(table: SweepTable, folder: Path, files: Sequence[str], summaries: bool, seconds: float) -> None:
    """Print a sweep's points, what they say, how many runs they lack if they have summaries, and its time and files."""
    _print_points(table)
    print_messages(result := table.sweep)
    if summaries and (left_out := max(point.left_out for point in result.points)):
        open_console().print(f"points have the first of the scene's {left_out + 1} runs; --all-runs computes all")
    statuses = ", ".join(f"{number} {status}" for status, number in result.counts.items() if number)
    open_console().print(f"{len(table.rows)} points: {statuses}; {result.computed} computed now, in {seconds:.1f} s")
    print_files(folder, files)


def _print_points(table: SweepTable) -> None:
    """Print the first points with the figures that fit a terminal."""
    rows, result, asked = (
        table.rows,
        table.sweep,
        {column: (column, unit) for unit, own in table.results.values() for column in own},
    )
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


def _write(value: Any, unit: str) -> str:
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
