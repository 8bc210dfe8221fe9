"""Commands around a scene: one to start from, one to look at what came out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from pipeline.cli.options import Json, NoCache, SceneName, Set, open_pipeline, print_json


def new(path: Path, *, from_: Annotated[str | None, Parameter(name="--from")] = None) -> None:
    """Write a commented scene to start from; a file that exists is left alone.

    Parameters
    ----------
    path
        The file to write, e.g. part.toml.
    from_
        Copy this ready scene, e.g. beam, instead of the one made for a start.
    """
    from pipeline.cli.start_scene import start_scene

    start_scene(path, from_)
    Console(soft_wrap=True).print(f"{path} is written; fmd run {path} computes it", markup=False)


def report(
    scene: SceneName,
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
    out
        The page; out/SCENE/report.html by default.
    no_budget
        Don't estimate the errors of the results.
    """
    from pipeline.output.report.page import write_report

    run = open_pipeline(scene, set_, no_cache)
    path = out or Path("out") / run.scene.name / "report.html"
    write_report(run, path, set_ or (), budget=not no_budget)
    if json:
        print_json({"scene": run.scene.name, "file": str(path), "bytes": path.stat().st_size})
    else:
        Console(soft_wrap=True).print(f"{path}: {path.stat().st_size / 1e6:.2f} MB; open it in a browser", markup=False)
