"""``fmd campbell``: natural frequencies over the rate of rotation, on a turning hub or in bearings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.accuracy.error_estimates import percent
from fmd.cli.inputs import DEFAULTS, Options, read_quantity
from fmd.cli.options import Flag, Folder, SceneName, print_json
from fmd.cli.tables import open_console, print_files, print_table, print_warnings
from fmd.core.errors import InputError
from fmd.core.limits.shown import CAMPBELL_CROSSINGS, CAMPBELL_LINES, CAMPBELL_MODES

if TYPE_CHECKING:
    from fmd.output.campbell import CampbellDiagram

_MARKS = {"forward": " ↻", "backward": " ↺", "none": ""}


def campbell(
    scene: SceneName,
    *,
    to: str,
    points: int = 41,
    orders: str = "",
    no_budget: Flag = False,
    out: Folder = None,
    options: Options = DEFAULTS,
) -> None:
    """Campbell diagram: frequencies, damping and whirl over the rate of rotation, as a table and a chart.

    A part on a hub is seen from the hub; a rotor whose free body runs in bearings is seen from space.

    Parameters
    ----------
    to
        Highest rate of rotation, e.g. "8000 rpm"; with rpm, all rates are told in rpm.
    points
        Number of rates, from 0 on.
    orders
        Multiples of the rate whose crossings with the frequencies are wanted, e.g. 1,2,6.
    no_budget
        Don't estimate the errors of the frequencies.
    """
    highest = read_quantity("--to", to, "angular rate", above_zero=True)
    if not 2 <= points <= 10_000:
        raise InputError("--points", "", points, "must be 2 … 10000")
    multiples = _read_orders(orders)
    from fmd.output.campbell import compute_campbell, write_campbell

    pipeline = options.solve(scene)
    folder = out or Path("out") / pipeline.scene.name
    diagram = compute_campbell(
        pipeline, np.linspace(0.0, highest, points), multiples, "rpm" in to, pipeline.store.monitor
    )
    diagram = diagram if no_budget else diagram.with_errors(pipeline)
    files = write_campbell(diagram, folder)
    if options.json:
        found = {"rows": diagram.rows(), "crossings": diagram.crossing_rows(), "unstable": diagram.unstable_rows()}
        print_json({**found, "warnings": diagram.warnings(), "files": files})
        return
    _print_diagram(diagram)
    if multiples:
        _print_crossings(diagram)
    print_files(folder, files)


def _read_orders(text: str) -> list[float]:
    """Read a list of orders above zero, separated by commas."""
    try:
        found = [float(word) for word in text.split(",") if word.strip()]
    except ValueError:
        found = [np.nan]
    if not all(0 < order < 1e6 for order in found):
        raise InputError("--orders", "", text, "must be numbers above zero with commas between them, e.g. 1,2,6")
    return found


def _print_diagram(diagram: CampbellDiagram) -> None:
    """Print the frequencies of the first modes at about ten of the rates, with an arrow for their whirl."""
    from fmd.output.campbell import whirl_word

    n_modes = min(diagram.frequencies_hz.shape[1], CAMPBELL_MODES)
    columns = {diagram.unit: "{:.6g}", **{f"mode {k + 1}": "{}" for k in range(n_modes)}}
    rows: list[tuple[Any, ...]] = [
        (
            diagram.in_unit(diagram.rates[k]),
            *(
                f"{value:.3f}{_MARKS[whirl_word(whirl)]}"
                for value, whirl in zip(diagram.frequencies_hz[k, :n_modes], diagram.whirl[k], strict=False)
            ),
        )
        for k in range(0, len(diagram.rates), max(1, len(diagram.rates) // CAMPBELL_LINES))
    ]
    print_table(f"{diagram.title} [Hz]", columns, rows)
    if any(mark and mark in cell for row in rows for cell in row[1:] for mark in _MARKS.values()):
        said = (
            "points whirl in the sense of the rotation, or against it; what doesn't move the axis turns with the part"
        )
        open_console().print(f"↻ forward, ↺ backward: {said}", soft_wrap=True)
    worst = diagram.largest_error(n_modes)
    if worst is None:
        some = f"not each of these {n_modes} has an error, since variants have fewer; campbell.csv has the others'"
        said = f"errors not stated: {diagram.errors_hz}" if isinstance(diagram.errors_hz, str) else some
        open_console().print(said, soft_wrap=True)
    else:
        open_console().print(f"these {n_modes} are off by up to {percent(worst)} %; campbell.csv has the error of each")
    print_warnings(diagram.warnings())


def _print_crossings(diagram: CampbellDiagram) -> None:
    """Print where multiples of the rate meet frequencies."""
    rows = [
        (at.order, diagram.in_unit(at.rate), at.frequency_hz, at.mode, row["whirl"], at.damping)
        for row, at in zip(diagram.crossing_rows(), diagram.crossings, strict=True)
    ]
    if not rows:
        highest = f"{diagram.in_unit(diagram.rates[-1]):.5g} {diagram.unit}"
        open_console().print(f"no multiple of the rate meets a frequency up to {highest}")
        return
    columns = {"order": "{:g}", diagram.unit: "{:.2f}", "Hz": "{:.3f}", "mode": "{}", "whirl": "{}"}
    columns["damping ratio"] = "{:.3g}"
    print_table("Crossings with multiples of the rate", columns, rows[:CAMPBELL_CROSSINGS])
    if len(rows) > CAMPBELL_CROSSINGS:
        open_console().print(f"and {len(rows) - CAMPBELL_CROSSINGS} more at higher rates")
