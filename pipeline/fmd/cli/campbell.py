"""``fmd campbell``: natural frequencies over the rate of rotation, on a turning hub or in bearings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fmd.cli.inputs import read_rate, solve_scene
from fmd.cli.options import Json, NoCache, SceneName, Set, print_json
from fmd.cli.tables import new_table, open_console, print_files
from fmd.core.errors import InputError
from fmd.core.limits.shown import CAMPBELL_CROSSINGS, CAMPBELL_LINES, CAMPBELL_MODES
from fmd.core.progress import bars

if TYPE_CHECKING:
    from fmd.output.campbell import CampbellDiagram

_MARKS = {"forward": " ↻", "backward": " ↺", "none": ""}


def campbell(
    scene: SceneName,
    *,
    to: str,
    points: int = 41,
    orders: str = "",
    out: Path | None = None,
    set_: Set = None,
    no_cache: NoCache = False,
    json: Json = False,
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
    out
        Folder for the results; out/SCENE by default.
    """
    highest = read_rate("--to", to)
    if not highest > 0:
        raise InputError("--to", "", to, "must be above zero")
    if not 2 <= points <= 10_000:
        raise InputError("--points", "", points, "must be 2 … 10000")
    multiples = _read_orders(orders)
    from fmd.output.campbell import compute_campbell, write_campbell

    pipeline = solve_scene(scene, set_, no_cache)
    folder = out or Path("out") / pipeline.scene.name
    diagram = compute_campbell(pipeline, np.linspace(0.0, highest, points), multiples, "rpm" in to, bars)
    files = write_campbell(diagram, folder)
    if json:
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
    columns = [f"mode {k + 1}" for k in range(n_modes)]
    table = new_table(f"{diagram.title} [Hz]", diagram.unit, *columns)
    for k in range(0, len(diagram.rates), max(1, len(diagram.rates) // CAMPBELL_LINES)):
        cells = [
            f"{value:.3f}{_MARKS[whirl_word(whirl)]}"
            for value, whirl in zip(diagram.frequencies_hz[k, :n_modes], diagram.whirl[k], strict=False)
        ]
        table.add_row(f"{diagram.told(diagram.rates[k]):.4g}", *cells)
    console = open_console()
    console.print(table)
    console.print("↻ forward, ↺ backward: points whirl in the sense of the rotation, or against it")
    for warning in diagram.warnings():
        console.print(f"warning: {warning['text']}")


def _print_crossings(diagram: CampbellDiagram) -> None:
    """Print where multiples of the rate meet frequencies."""
    title = "Crossings with multiples of the rate"
    table = new_table(title, "order", diagram.unit, "Hz", "mode", "whirl", "damping ratio")
    for row, at in list(zip(diagram.crossing_rows(), diagram.crossings, strict=True))[:CAMPBELL_CROSSINGS]:
        figures = (f"{diagram.told(at.rate):.2f}", f"{at.frequency_hz:.3f}", str(at.mode))
        table.add_row(f"{at.order:g}", *figures, row["whirl"], f"{at.damping:.3g}")
    console = open_console()
    console.print(table)
    if len(diagram.crossings) > CAMPBELL_CROSSINGS:
        console.print(f"and {len(diagram.crossings) - CAMPBELL_CROSSINGS} more at higher rates")
