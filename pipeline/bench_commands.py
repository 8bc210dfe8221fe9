"""What `fmd bench` can measure: integrators, elements and whole runs; each prints its tables unless JSON is wanted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.checks import InputError

if TYPE_CHECKING:
    from pipeline.stages import Pipeline


def integrators(
    scenes: Sequence[str], load: Callable[[str, Sequence[str]], Pipeline], out: Path, peer: bool, json: bool
) -> dict[str, Any]:
    """Every integrator on the mechanism of each scene, or of the ready ones."""
    from pipeline.bench import READY, bench, peer_rows, write_bench

    rows: list[dict[str, Any]] = []
    for name, scene, overrides in [(Path(scene).stem, scene, ()) for scene in scenes] if scenes else READY:
        run = load(scene, overrides)
        result = bench(run)
        if peer:
            result = replace(result, rows=(*result.rows, *peer_rows(name)))
        files = write_bench(run, result, out, name)
        rows += [{"scene": name, **_figures(row)} for row in result.rows]
        if not json:
            from pipeline.tables import print_bench

            print_bench(run.scene.title, result, out, files)
    return {"rows": rows}


def modes(scenes: Sequence[str], out: Path, json: bool) -> dict[str, Any]:
    """Error of the frequencies of beam and propeller against time, for each element and mesh.

    Raises
    ------
    InputError
        Another scene is named.
    """
    from threadpoolctl import threadpool_limits

    from pipeline import mode_study as study

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


def whole_runs(scenes: Sequence[str], overrides: Sequence[str], out: Path, json: bool) -> dict[str, Any]:
    """Ready scenes from start to end, cold and warm."""
    from pipeline import whole_runs as runs

    rows = [row for scene in scenes or runs.SCENES for row in runs.measure(scene, overrides)]
    runs.write_rows(rows, out / "pipeline.csv")
    if not json:
        runs.print_rows(rows, out / "pipeline.csv")
    return {"rows": [_figures(row) for row in rows], "files": ["pipeline.csv"]}


def _figures(row: Any) -> dict[str, Any]:
    """A row's figures as JSON has them, where there is no number that is none."""
    return {key: None if isinstance(x, float) and not isfinite(x) else x for key, x in asdict(row).items()}
