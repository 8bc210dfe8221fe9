"""``fmd sensitivities``: how results depend on numbers of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmd.cli.inputs import DEFAULTS, Options, settle
from fmd.cli.options import Folder, Names, SceneName, Several, print_json
from fmd.cli.tables import open_console, print_files, print_table
from fmd.core.errors import InputError
from fmd.core.files import refusing
from fmd.core.html import scaled
from fmd.core.limits.fitting import FEWEST_SAMPLES
from fmd.sweep.points import split_names

if TYPE_CHECKING:
    from fmd.core.arrays import Array
    from fmd.fitting.sensitivities import Sensitivity
    from fmd.fitting.uncertainty import Uncertainty
    from fmd.stages.pipeline import Pipeline


def sensitivities(
    scene: SceneName,
    *,
    of: Names,
    to: Several = None,
    sample: int = 0,
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
        as one number, its factor. By default those to which the scene gives tolerances, mass = "0.4 kg ± 2 %".
    sample
        Number of scenes within the tolerances that are computed, beside their combination to first order.
    """
    from fmd.fitting.fit_files import write_sensitivities, write_uncertainties
    from fmd.fitting.sensitivities import jacobian
    from fmd.fitting.uncertainty import combine_tolerances

    names, keys = split_names("--of", of), split_names("--to", to or [])
    solved = options.open(scene)
    run = settle(solved)
    tolerances = run.scene.tolerances
    if not (keys or tolerances):
        mend = 'is missing: keys of numbers, or tolerances in the scene, e.g. mass = "0.4 kg ± 2 %"'
        raise InputError("--to", "", None, mend)
    found = jacobian(solved, names, keys or [*tolerances])
    uncertain = combine_tolerances(found, tolerances, _sample(run, found, sample) if sample else None)
    folder = out or Path("out") / run.scene.name
    with refusing("--out", folder):
        times = run.output_times if run.scene.moves else None
        files = write_sensitivities(found, times, folder, f"{run.scene.title}: sensitivities")
        if uncertain:
            files += write_uncertainties(uncertain, folder, f"{run.scene.title}: uncertainties by tolerances")
    rows = [each.row() for each in found]
    if options.json:
        rows_of = [each.row() for each in uncertain]
        print_json({"scene": run.scene.name, "rows": rows, "uncertainties": rows_of, "files": files})
    else:
        _print(found, rows)
        _print_uncertainties(uncertain)
        print_files(folder, files)


def _sample(run: Pipeline, found: Sequence[Sensitivity], count: int) -> dict[str, Array]:
    """Return intervals of results by sampled numbers; raises ``InputError`` if there are too few, or no tolerances."""
    from fmd.fitting.uncertainty import sample_tolerances

    tolerances = run.scene.tolerances
    parameters = [*dict.fromkeys(each.parameter for each in found if each.parameter.key in tolerances)]
    if count < FEWEST_SAMPLES or not parameters:
        mend = f"takes {FEWEST_SAMPLES} at least, and tolerances in the scene"
        raise InputError("--sample", "", count, mend)
    channels = {each.channel.name: each.channel for each in found}
    return sample_tolerances(run, [*channels.values()], parameters, tolerances, count)


def _print(found: Sequence[Sensitivity], rows: Sequence[dict[str, Any]]) -> None:
    columns = {"result": "{}", "value": "{}", "by": "{}", "at": "{}", "% per %": "{:+.5g}", "±": "{}"}
    names = [row["of"] for row in rows]
    order = sorted(range(len(rows)), key=lambda k: (names.index(names[k]), -abs(rows[k]["relative"] or 0.0)))
    cells = []
    for k in order:
        row, off = rows[k], found[k].relative_error
        value = scaled(row["value"], row["unit"]) + (" rms" if row["history"] else "")
        number = scaled(row["number"], row["number_unit"]) if row["number_unit"] else f"{row['number']:.5g}"
        share = row["relative"]
        plus_minus = "not stated" if row["unstated"] else f"{off:.1g}"
        cells.append((row["of"], value, row["to"], number, share, None if share is None else plus_minus))
    print_table("Sensitivities", columns, cells, wide=2)
    console = open_console()
    if any(row["history"] for row in rows):
        console.print("of histories: ratios of root mean squares over time, without signs")
    for way in dict.fromkeys(_way(each) for each in found if each.channel.moves):
        keys = [*dict.fromkeys(each.parameter.key for each in found if each.channel.moves and _way(each) == way)]
        console.print(f"by {way}: {', '.join(keys)}")
    for reason in dict.fromkeys(row["unstated"] for row in rows if row["unstated"]):
        console.print(f"± not stated: {reason}")
    for row in rows:
        if row["jumps"]:
            console.print(
                f"warning: the largest {row['of']} jumps to another place or time when {row['to']} changes by 0.1 %; "
                "its derivative is that where it is now"
            )


def _way(each: Sensitivity) -> str:
    """Say how the motion has been differentiated."""
    if each.by_tangents:
        return "tangents of the motion"
    return f"differences of motions (without tangents: {each.lacking})"


def _print_uncertainties(found: Sequence[Uncertainty]) -> None:
    if not found:
        return
    columns = {"result": "{}", "value": "{}", "± 95 %": "{}", "most of its variance from": "{}"}
    if any(each.sampled is not None for each in found):
        columns["sampled"] = "{}"
    cells = []
    for each in found:
        row = each.row()
        parts = sorted(row["contributions"].items(), key=lambda part: -part[1])[:3]
        most = ", ".join(f"{key} {100 * part:.3g} %" for key, part in parts if part)
        ends = [scaled(x, row["unit"]) for x in row["sampled"] or ()]
        sampled = f"± {ends[0]}" if len(ends) == 1 else " … ".join(ends)
        cell = (row["of"], scaled(each.value, row["unit"]), scaled(row["half_width"], row["unit"]), most, sampled)
        cells.append(cell[: len(columns)])
    print_table("Uncertainties by tolerances, to first order", columns, cells)
