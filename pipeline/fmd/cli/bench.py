"""``fmd bench``: run time of time integration alone against error, and long marches against the predicted stability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from fmd.bench import whole_runs
from fmd.cli.inputs import solve_scene
from fmd.cli.options import Flag, Json, Set, print_json
from fmd.cli.tables import new_table, open_console, print_files
from fmd.core.errors import InputError
from fmd.core.progress import bars

if TYPE_CHECKING:
    from fmd.bench.mode_study import ConvergedFrequencies, ModeStudyRow
    from fmd.bench.work_precision import WorkPrecision


def bench(
    scenes: list[str] | None = None,
    /,
    *,
    out: Path = Path("out/bench"),
    set_: Set = None,
    peer: Flag = False,
    stability: Flag = False,
    modes: Flag = False,
    pipeline: Flag = False,
    json: Json = False,
) -> None:
    """Run time of integration alone against error: every integrator on a scene, as a table, a CSV and a chart.

    Parameters
    ----------
    scenes
        Ready scenes or TOML files; by default rod-slider, the beam with 5, 20 and 60 modes, and the arm.
    out
        Folder for the CSV and the chart of each.
    peer
        Exudyn's solvers beside ours where a scene has them as a peer; needs the extra 'bench'.
    stability
        Stress tests of stability instead: long marches below and above the limits, against the prediction.
    modes
        Error of the frequencies of beam and propeller against time instead, for each element and mesh.
    pipeline
        Whole runs instead, cold and warm, in processes of their own: time of each stage and memory.
    """
    chosen, overrides = scenes or [], set_ or []
    if stability:
        result = _march_stress_tests(out, json)
    elif modes:
        result = _measure_modes(chosen, out, json)
    elif pipeline:
        result = _measure_runs(chosen, overrides, out, json)
    else:
        result = _compare_integrators(chosen, overrides, out, peer, json)
    if json:
        print_json(result)


def _compare_integrators(
    scenes: Sequence[str], overrides: Sequence[str], out: Path, peer: bool, json: bool
) -> dict[str, Any]:
    """March the mechanism of each scene, or of the ready ones, by every integrator."""
    from fmd.bench.integrators import READY, compare_on_scene, peer_rows, write_comparison

    rows: list[dict[str, Any]] = []
    for name, scene, own in [(Path(scene).stem, scene, ()) for scene in scenes] if scenes else READY:
        run = solve_scene(scene, [*own, *overrides])
        result = compare_on_scene(run)
        if peer:
            result = replace(result, rows=(*result.rows, *peer_rows(name)))
        files = write_comparison(run, result, out, name)
        rows += [{"scene": name, **_finite(row)} for row in result.rows]
        if not json:
            _print_comparison(run.scene.title, result)
            print_files(out, files)
    return {"rows": rows}


def _print_comparison(title: str, result: WorkPrecision) -> None:
    title = f"{title} (two references differ by {result.reference_error:.0e})"
    table = new_table(title, "method", "step", "seconds", "error")
    for row in result.rows:
        table.add_row(row.integrator, f"{row.step_s:.3g}", f"{row.seconds:.3g}", f"{row.error:.2e}")
    open_console().print(table)


def _measure_modes(scenes: Sequence[str], out: Path, json: bool) -> dict[str, Any]:
    """Measure frequencies of beam and propeller for each element and mesh.

    Raises
    ------
    InputError
        Another scene is named.
    """
    from fmd.bench import mode_study

    known = [ready.scene for ready in mode_study.STUDIES]
    for scene in scenes:
        if scene not in known:
            raise InputError("--modes", "", scene, f"must be one of {', '.join(known)}")
    chosen = [ready for ready in mode_study.STUDIES if not scenes or ready.scene in scenes]
    with threadpool_limits(1):
        references = {ready.scene: mode_study.converged_frequencies(ready) for ready in chosen}
        rows = [row for ready in chosen for row in mode_study.measure_meshes(ready, references[ready.scene])]
    files = mode_study.write_study(rows, references, out)
    if not json:
        for scene, reference in references.items():
            _print_meshes(scene, reference, [row for row in rows if row.scene == scene])
        print_files(out, files)
    return {"rows": [_finite(row) for row in rows], "files": files}


def _print_meshes(scene: str, reference: ConvergedFrequencies, rows: Sequence[ModeStudyRow]) -> None:
    """Print all meshes of a scene, and the fastest of each element within the wanted error."""
    from fmd.bench.mode_study import WANTED_ERROR, fastest

    console = open_console()
    title = f"{scene}: two elements' limits agree to {reference.uncertainty:.0e}"
    table = new_table(title, "element", "mesh", "unknowns", "seconds", "error", wide=1)
    for row in rows:
        table.add_row(row.element, row.mesh, str(row.unknowns), f"{row.seconds:.3f}", f"{row.error:.1e}")
    console.print(table)
    for element in dict.fromkeys(row.element for row in rows):
        best = fastest([row for row in rows if row.element == element])
        text = f"{best.mesh}, {best.unknowns} unknowns, {best.seconds:.3f} s" if best else "none of these"
        console.print(f"fastest {element} within {WANTED_ERROR:g}: {text}")


def _measure_runs(scenes: Sequence[str], overrides: Sequence[str], out: Path, json: bool) -> dict[str, Any]:
    """Measure scenes from start to end, cold and warm."""
    path = out / "pipeline.csv"
    rows = [row for scene in scenes or whole_runs.SCENES for row in whole_runs.measure_runs(scene, overrides)]
    whole_runs.write_stages(rows, path)
    if not json:
        for scene, run in dict.fromkeys((row.scene, row.run) for row in rows):
            _print_stages(f"{scene}, {run}", [row for row in rows if (row.scene, row.run) == (scene, run)])
        print_files(out, [path.name])
    return {"rows": [_finite(row) for row in rows], "files": [path.name]}


def _print_stages(title: str, rows: Sequence[whole_runs.StageRow]) -> None:
    table = new_table(title, "stage", "seconds", "share", "")
    for row in rows:
        note = "from the cache" if row.cached else ""
        if row.stage == "whole":
            note = f"{row.megabytes:.0f} MB at most"
        table.add_row(row.stage, f"{row.seconds:.3f}", f"{100 * row.share:.1f} %", note)
    open_console().print(table)


def _march_stress_tests(out: Path, json: bool) -> dict[str, Any]:
    """March long below and above the limits of stability, against the prediction."""
    from fmd.bench.stress_test import stress_test

    with bars("stability") as advance:
        rows = stress_test(out, advance)
    if not json:
        counts = ("marches", "cycles", "lived", "diverged", "undecided", "wrong")
        table = new_table("Stress tests", "family", *counts[:5], "predicted wrongly", "largest gain of energy")
        for row in rows:
            table.add_row(row["family"], *(str(row[key]) for key in counts), f"{row['drift']:.1e}")
        open_console().print(table)
        print_files(out, ["stability.csv"])
    return {"rows": rows, "files": ["stability.csv"]}


def _finite(row: Any) -> dict[str, Any]:
    """Return a row's figures with None for what isn't finite, which JSON can't hold."""
    return {key: None if isinstance(x, float) and not isfinite(x) else x for key, x in asdict(row).items()}
