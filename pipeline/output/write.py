"""Files of a run: the motion, the summary, and the pictures, films and exports that the scene lists."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pipeline.accuracy.refinement import meet_accuracy
from pipeline.core.cache import Cache, stage_key
from pipeline.core.errors import InputError
from pipeline.core.files import whole_file
from pipeline.core.paths import cache_folder
from pipeline.output.explain import remember_times
from pipeline.output.exports import write_export
from pipeline.output.picture_files import draw
from pipeline.output.summary import summarise
from pipeline.render.rendering_check import rendering_problem
from pipeline.stages.pipeline import Pipeline


def write_results(run: Pipeline, folder: Path, pictures: bool, budget: bool = True) -> dict[str, Any]:
    """Compute the results that a scene asks for, write them into a folder and return the summary.

    Parameters
    ----------
    run : Pipeline
        The scene's pipeline.
    folder : Path
        Made if it is missing; each file appears whole or not at all.
    pictures : bool
        Draw pictures; without, neither PyVista nor Matplotlib is loaded.
    budget : bool
        Estimate the errors of the results.

    Raises
    ------
    InputError
        The folder can't be written, or this machine can't draw.
    AccuracyError
        A march diverged, or a result failed its check.
    """
    exports = [output for output in run.scene.output if output.type == "export"]
    drawn = [output for output in run.scene.output if output.type != "export"] if pictures else []
    if drawn:
        _require_drawing(run.scene.file)
    refinement: dict[str, Any] = {}
    if run.scene.accuracy is not None:
        if not budget:
            raise InputError("--no-budget", "", None, "can't be: the scene wants an accuracy, which the budget proves")
        found = meet_accuracy(run)
        run, refinement = found.run, found.summary()
    run.motions  # noqa: B018 - refuses or diverges before anything is written
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = [_write_motion(run, folder)]
        if exports:
            files += run.store.compute(
                "files", lambda: [name for o in exports for name in write_export(run, o, folder)]
            )
        if drawn:
            files += [name for output in drawn for name in draw(run, output, folder)]
        summary = summarise(run, files, budget)
        if refinement:
            summary["accuracy"] = refinement
        with whole_file(folder / "summary.json") as part:
            part.write_text(json.dumps(summary, indent=1, allow_nan=False) + "\n")
    except OSError as error:
        raise InputError("--out", "", str(folder), f"can't be written: {error.strerror or error}") from error
    remember_times(run)
    return summary


def _require_drawing(file: str) -> None:
    """Refuse to draw where VTK would take the process down; a machine that has drawn once isn't checked again."""
    cache = Cache(cache_folder() / "stages")
    key = stage_key("drawing", None, ("pipeline/render/rendering_check.py",), ("pyvista", "vtk"))
    if cache.load(key):
        return
    problem = rendering_problem()
    if problem is not None:
        raise InputError(file, "output", None, f"this machine can't draw: {problem} (or run with --no-pictures)")
    cache.save(key, True)


def _write_motion(run: Pipeline, folder: Path) -> str:
    from pipeline.recovery.motion_file import motion_dataset

    with whole_file(folder / "motion.nc") as part:
        motion_dataset(run.motions).to_netcdf(part, engine="scipy")
    return "motion.nc"
