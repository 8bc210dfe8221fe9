"""``fmd bench``: what can be measured; each prints its tables unless JSON is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from pipeline.cli.options import Json, Set, open_pipeline, print_json
from pipeline.core.errors import InputError


def bench(
    scenes: list[str] | None = None,
    /,
    *,
    out: Path = Path("out/bench"),
    set_: Set = None,
    peer: Annotated[bool, Parameter(negative=())] = False,
    stability: Annotated[bool, Parameter(negative=())] = False,
    modes: Annotated[bool, Parameter(negative=())] = False,
    whole: Annotated[bool, Parameter(name="--pipeline", negative=())] = False,
    json: Json = False,
) -> None:
    """Run time against error: every integrator on a scene's mechanism, as a table, a CSV and a chart.

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
    whole
        Whole runs instead, cold and warm, in processes of their own: time of each stage and memory.
    """
    chosen, overrides = scenes or [], set_ or []
    if stability:
        found = _stress_test(out, json)
    elif modes:
        found = _modes(chosen, out, json)
    elif whole:
        found = _whole_runs(chosen, overrides, out, json)
    else:
        found = _integrators(chosen, overrides, out, peer, json)
    if json:
        print_json(found)


def _integrators(scenes: Sequence[str], overrides: Sequence[str], out: Path, peer: bool, json: bool) -> dict[str, Any]:
    """Every integrator on the mechanism of each scene, or of the ready ones."""
    from pipeline.bench.integrators import READY, bench, peer_rows, write_bench

    rows: list[dict[str, Any]] = []
    for name, scene, own in [(Path(scene).stem, scene, ()) for scene in scenes] if scenes else READY:
        run = open_pipeline(scene, [*own, *overrides], no_cache=False)
        result = bench(run)
        if peer:
            result = replace(result, rows=(*result.rows, *peer_rows(name)))
        files = write_bench(run, result, out, name)
        rows += [{"scene": name, **_figures(row)} for row in result.rows]
        if not json:
            from pipeline.cli.tables import print_bench

            print_bench(run.scene.title, result, out, files)
    return {"rows": rows}


def _modes(scenes: Sequence[str], out: Path, json: bool) -> dict[str, Any]:
    """Error of the frequencies of beam and propeller against time, for each element and mesh.

    Raises
    ------
    InputError
        Another scene is named.
    """
    from threadpoolctl import threadpool_limits

    from pipeline.bench import mode_study as study

    known = [ready.scene for ready in study.STUDIES]
    for scene in scenes:
        if scene not in known:
            raise InputError("--modes", "", scene, f"must be one of {', '.join(known)}")
    chosen = [ready for ready in study.STUDIES if not scenes or ready.scene in scenes]
    with threadpool_limits(1):
        references = {ready.scene: study.reference_of(ready) for ready in chosen}
        rows = [row for ready in chosen for row in study.measure(ready, references[ready.scene])]
    files = study.write_study(rows, references, out)
    if not json:
        study.print_study(rows, references, out, files)
    return {"rows": [_figures(row) for row in rows], "files": files}


def _whole_runs(scenes: Sequence[str], overrides: Sequence[str], out: Path, json: bool) -> dict[str, Any]:
    """Ready scenes from start to end, cold and warm."""
    from pipeline.bench import whole_runs as runs

    rows = [row for scene in scenes or runs.SCENES for row in runs.measure(scene, overrides)]
    runs.write_rows(rows, out / "pipeline.csv")
    if not json:
        runs.print_rows(rows, out / "pipeline.csv")
    return {"rows": [_figures(row) for row in rows], "files": ["pipeline.csv"]}


def _figures(row: Any) -> dict[str, Any]:
    """A row's figures as JSON has them, where there is no number that is none."""
    return {key: None if isinstance(x, float) and not isfinite(x) else x for key, x in asdict(row).items()}


def _stress_test(out: Path, json: bool) -> dict[str, Any]:
    """Long marches below and above the limits of stability, against the prediction."""
    from pipeline.bench.stress_test import stress_test
    from pipeline.core.progress import bars

    with bars("stability") as advance:
        found = stress_test(out, advance)
    if not json:
        from pipeline.cli.tables import print_stress_test

        print_stress_test(found, out)
    return {"rows": found, "files": ["stability.csv"]}
