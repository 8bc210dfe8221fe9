"""More commands: a scene to start from, a page of what came out, the Campbell diagram."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from pipeline.cli import Json, NoCache, Set, _pipeline, _print_json, _rate


def new(path: Path, *, from_: Annotated[str | None, Parameter(name="--from")] = None) -> None:
    """Write a commented scene to start from; a file that exists is left alone.

    Parameters
    ----------
    path
        The file to write, e.g. part.toml.
    from_
        Copy this ready scene, e.g. beam, instead of the one made for a start.
    """
    from pipeline.starting import start_scene

    start_scene(path, from_)
    Console(soft_wrap=True).print(f"{path} is written; fmd run {path} computes it", markup=False)


def report(
    scene: str,
    *,
    out: Path | None = None,
    set_: Set = None,
    no_budget: Annotated[bool, Parameter(negative=())] = False,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """One web page of all results: frequencies, modes, a part that turns, charts, run times and errors, versions.

    Parameters
    ----------
    scene
        Name of a ready scene, or path of a TOML file.
    out
        The page; out/SCENE/report.html by default.
    no_budget
        Don't estimate the errors of the results.
    """
    from pipeline.report.page import write_report

    run = _pipeline(scene, set_, no_cache)
    path = out or Path("out") / run.scene.name / "report.html"
    write_report(run, path, set_ or (), budget=not no_budget)
    if json:
        _print_json({"scene": run.scene.name, "file": str(path), "bytes": path.stat().st_size})
    else:
        Console(soft_wrap=True).print(f"{path}: {path.stat().st_size / 1e6:.2f} MB; open it in a browser", markup=False)


def campbell(
    scene: str,
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
    scene
        Name of a ready scene, or path of a TOML file.
    to
        Highest rate of rotation, e.g. "8000 rpm".
    points
        How many rates, from 0 on.
    out
        Folder for the results; out/SCENE by default.
    """
    import numpy as np

    from pipeline.checks import InputError
    from pipeline.frequencies import campbell as compute

    pipeline = _pipeline(scene, set_, no_cache)
    highest = _rate("--to", to)
    if not highest > 0:
        raise InputError("--to", "", to, "must be above zero")
    if not 2 <= points <= 10_000:
        raise InputError("--points", "", points, "must be 2 … 10000")
    folder = out or Path("out") / pipeline.scene.name
    rates = np.linspace(0.0, highest, points)
    table, files = compute(pipeline, rates, folder)
    if json:
        rows = [
            {"rate_rad_s": rate, "frequencies_hz": row[np.isfinite(row)].tolist()}
            for rate, row in zip(rates.tolist(), table, strict=True)
        ]
        _print_json({"rows": rows, "files": files})
    else:
        from pipeline.tables import print_campbell

        print_campbell(pipeline.scene.title, rates, table, folder, files)
