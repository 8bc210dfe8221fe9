"""``fmd run``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from pipeline.cli.options import Json, NoCache, Repair, SceneName, Set, open_pipeline, print_json


def run(
    scene: SceneName,
    *,
    out: Path | None = None,
    set_: Set = None,
    no_pictures: Annotated[bool, Parameter(negative=())] = False,
    no_budget: Annotated[bool, Parameter(negative=())] = False,
    explain: Annotated[bool, Parameter(negative=())] = False,
    dry_run: Annotated[bool, Parameter(negative=())] = False,
    keep_all: Annotated[bool, Parameter(negative=())] = False,
    repair: Repair = False,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Do everything that a scene asks for: mesh, modes, motion, stress, pictures, an error budget.

    Parameters
    ----------
    out
        Folder for the results; out/SCENE by default.
    no_pictures
        Draw nothing.
    no_budget
        Don't estimate the errors of the results.
    explain
        Print first which stages will run, come from the cache or are skipped, why, and what each took last.
    dry_run
        Print that and do nothing else.
    keep_all
        Integrate modes that neither loads nor motion can excite, too.
    """
    from pipeline.cli.tables import given_up, print_plan, print_run
    from pipeline.core.errors import AccuracyError
    from pipeline.output.explain import forecast_run
    from pipeline.output.write import write_results

    pipeline = open_pipeline(scene, set_, no_cache, repair, keep_all)
    folder = out or Path("out") / pipeline.scene.name
    asked = explain or dry_run
    # Who waits at a terminal is told what it will cost; asking the cache takes time that nobody else need spend.
    plan = (
        forecast_run(pipeline, not no_pictures, not no_budget) if asked or (not json and sys.stdout.isatty()) else None
    )
    if plan and not json:
        print_plan(plan, steps=asked)
    if dry_run:
        if plan and json:
            print_json({"plan": plan.summary()})
        return
    summary = write_results(pipeline, folder, pictures=not no_pictures, budget=not no_budget)
    if json:
        print_json({"plan": plan.summary(), **summary} if plan else summary)
    else:
        print_run(summary, folder)
    left = summary["accuracy"]["rounds"][-1]["given_up"] if "accuracy" in summary else []
    if left:
        raise AccuracyError(
            f"accuracy: finer meshes and more modes hardly lower the error of {given_up(left)}; "
            f"all else is met, and what was computed is in {folder}/"
        )
