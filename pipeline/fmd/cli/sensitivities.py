"""``fmd sensitivities``: how results depend on numbers of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmd.cli.inputs import DEFAULTS, Options, settle
from fmd.cli.options import Folder, Names, SceneName, print_json
from fmd.cli.tables import open_console, print_files, print_table
from fmd.core.errors import InputError
from fmd.core.files import refusing
from fmd.core.html import scaled

if TYPE_CHECKING:
    from fmd.fitting.sensitivities import Sensitivity


def sensitivities(
    scene: SceneName,
    *,
    of: Names,
    to: Names,
    out: Folder = None,
    options: Options = DEFAULTS,
) -> None:
    """Derivatives of results by numbers of a scene, in per cent of the result per per cent of the number.

    Parameters
    ----------
    of
        Results, with commas between them: tip (the tip's largest deflection), BODY.stress (largest von Mises stress),
        BODY.frequency.N, or a history, e.g. forearm.wrist.position.y, elbow.position, shoulder.force.x.
    to
        Keys of numbers, with commas between them, e.g. joint.elbow.spring,body.gripper.mass; a load's formula counts
        as one number, its factor.
    """
    from fmd.fitting.sensitivities import jacobian
    from fmd.fitting.sensitivity_files import write_sensitivities

    names, keys = split_names("--of", of), split_names("--to", to)
    solved = options.open(scene)
    run = settle(solved)
    found = jacobian(solved, names, keys)
    folder = out or Path("out") / run.scene.name
    with refusing("--out", folder):
        times = run.output_times if run.scene.moves else None
        files = write_sensitivities(found, times, folder, f"{run.scene.title}: sensitivities")
    rows = [each.row() for each in found]
    if options.json:
        print_json({"scene": run.scene.name, "rows": rows, "files": files})
    else:
        _print(found, rows)
        print_files(folder, files)


def split_names(option: str, texts: Sequence[str]) -> list[str]:
    """Return names that are given with commas between them, or by several options."""
    names = [name.strip() for text in texts for name in text.split(",")]
    if not all(names):
        raise InputError(option, "", ",".join(texts), "has an empty name; give names with commas between them")
    return names


def _print(found: Sequence[Sensitivity], rows: Sequence[dict[str, Any]]) -> None:
    columns = {"result": "{}", "value": "{}", "by": "{}", "at": "{}", "% per %": "{:+.5g}", "±": "{:.1g}"}
    order = sorted(range(len(rows)), key=lambda k: (_first(rows, rows[k]["of"]), -abs(rows[k]["relative"] or 0.0)))
    cells = []
    for k in order:
        row, off = rows[k], found[k].relative_error
        value = scaled(row["value"], row["unit"]) + (" rms" if row["history"] else "")
        number = scaled(row["number"], row["number_unit"]) if row["number_unit"] else f"{row['number']:.5g}"
        share = row["relative"]
        cells.append((row["of"], value, row["to"], number, share, None if share is None else off))
    print_table("Sensitivities", columns, cells, wide=2)
    console = open_console()
    if any(row["history"] for row in rows):
        console.print("of histories: ratios of root mean squares over time, without signs")
    for row in rows:
        if row["jumps"]:
            console.print(
                f"warning: the largest {row['of']} jumps to another place or time when {row['to']} changes by 0.1 %; "
                "its derivative is that where it is now"
            )


def _first(rows: Sequence[dict[str, Any]], name: str) -> int:
    return next(k for k, row in enumerate(rows) if row["of"] == name)
