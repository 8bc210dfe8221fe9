"""``fmd campbell``: a part's natural frequencies on a turning hub."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.cli.inputs import open_pipeline, read_rate
from pipeline.cli.options import Json, NoCache, SceneName, Set, print_json
from pipeline.cli.tables import new_table, open_console, print_files
from pipeline.core.arrays import Array
from pipeline.core.errors import InputError
from pipeline.output.frequencies import campbell as compute

_MOST_MODES = 8  # in the terminal's table; the file has all
_LINES = 10


def campbell(
    scene: SceneName,
    *,
    to: str,
    points: int = 41,
    out: Path | None = None,
    set_: Set = None,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Campbell diagram: frequencies on a turning hub over its rate of rotation, as a table and a chart.

    Parameters
    ----------
    to
        Highest rate of rotation, e.g. "8000 rpm".
    points
        Number of rates, from 0 on.
    out
        Folder for the results; out/SCENE by default.
    """
    pipeline = open_pipeline(scene, set_, no_cache)
    highest = read_rate("--to", to)
    if not highest > 0:
        raise InputError("--to", "", to, "must be above zero")
    if not 2 <= points <= 10_000:
        raise InputError("--points", "", points, "must be 2 … 10000")
    folder = out or Path("out") / pipeline.scene.name
    rates = np.linspace(0.0, highest, points)
    frequencies, files = compute(pipeline, rates, folder)
    if json:
        rows = [
            {"rate_rad_s": rate, "frequencies_hz": row[np.isfinite(row)].tolist()}
            for rate, row in zip(rates.tolist(), frequencies, strict=True)
        ]
        print_json({"rows": rows, "files": files})
    else:
        _print_diagram(pipeline.scene.title, rates, frequencies)
        print_files(folder, files)


def _print_diagram(title: str, rates: Array, frequencies: Array) -> None:
    """Print the frequencies of the first modes at about ten of the rates."""
    n_modes = min(frequencies.shape[1], _MOST_MODES)
    columns = [f"mode {k + 1}" for k in range(n_modes)]
    table = new_table(f"{title}: frequencies on a turning hub [Hz]", "rad/s", *columns)
    for k in range(0, len(rates), max(1, len(rates) // _LINES)):
        table.add_row(f"{rates[k]:.4g}", *(f"{value:.3f}" for value in frequencies[k, :n_modes]))
    open_console().print(table)
