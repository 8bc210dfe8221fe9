"""Files of a run: the motion, the summary, and the pictures, films and exports that the scene lists."""

from pathlib import Path
from typing import Any

from fmd.accuracy.error_budget import ERROR_BUDGET, allowed_seconds, read_kept_errors, state_errors
from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.errors import InputError
from fmd.core.files import refusing, whole_file, write_json
from fmd.output.explain import remember_times
from fmd.output.output_kinds import ResponseKind, kind_of, outputs_of
from fmd.output.picture_files import Pictures
from fmd.output.summary import summarise_solved
from fmd.output.variable_errors import VariableErrors
from fmd.recovery.motion_file import write_motions
from fmd.stages.pipeline import Pipeline
from fmd.stages.run_checks import require_room


def write_results(
    solved: SolvedScene, folder: Path, pictures: bool, budget: bool = True, budget_seconds: float | None = None
) -> dict[str, Any]:
    """Compute the results that a scene asks for, write them into a folder and return the summary.

    The folder is made if it is missing; each file appears whole or not at all. Without pictures neither PyVista nor
    Matplotlib is loaded. The budget may take some seconds; three times those of the run by default, less for long runs.

    Raises
    ------
    InputError
        The folder can't be written, or this machine can't draw.
    AccuracyError
        A march diverged, or a result failed its check.
    """
    scene = solved.scene
    if scene.accuracy is not None and not budget:
        raise InputError("--no-budget", "", None, "can't be: the scene wants an accuracy, which the budget proves")
    if scene.moves:
        require_room(scene)
    with Pictures(outputs_of(scene, "pictures") if pictures else [], scene.file) as drawing:
        if budget and solved.is_settled:
            read_kept_errors(solved.run)
        drawing.prepare(solved.run if solved.is_settled else solved.given)
        if not solved.is_settled:
            drawing.require_ready()
        run = solved.run
        run.bodies  # noqa: B018 - the process that draws gets ready meanwhile
        drawing.require_ready()
        drawing.begin(run, still=True)
        responses = _compute_responses(run)
        run.while_timed = drawing.paused
        run.motions  # noqa: B018 - refuses or diverges before anything is written
        drawing.begin(run, still=False)
        with refusing("--out", folder):
            summary = _write(solved, folder, drawing, budget, budget_seconds)
            if responses:
                _add_responses(run, responses, folder, pictures, summary)
            write_json(folder / "summary.json", summary)
    remember_times(run)
    return summary


def _write(
    solved: SolvedScene, folder: Path, drawing: Pictures, budget: bool, budget_seconds: float | None
) -> dict[str, Any]:
    """Write all files of a run that has been integrated, but the summary, while its pictures are drawn."""
    run = solved.run
    asked = outputs_of(run.scene, "files")
    folder.mkdir(parents=True, exist_ok=True)
    seconds = allowed_seconds(run) if budget_seconds is None else budget_seconds
    if budget and ERROR_BUDGET.applies(run):
        state_errors(run, seconds)  # files state them
    drawing.begin_stated(run)
    files = [_write_motion(run, folder)]
    if asked:
        files += run.store.compute("files", lambda: [name for o in asked for name in kind_of(o).make(run, o, folder)])
    files += drawing.write(run, folder)
    return summarise_solved(solved, files, budget, seconds)


def _compute_responses(run: Pipeline) -> list[tuple[Any, ResponseKind, Any]]:
    """Compute the responses that a scene lists, before anything is integrated; each with its output and its type."""
    asked = [(output, kind) for output in run.scene.output if (kind := kind_of(output).response) is not None]
    if not asked:
        return []
    return run.store.compute("responses", lambda: [(one, kind, kind.compute(run, one)) for one, kind in asked])


def _add_responses(
    run: Pipeline, responses: list[tuple[Any, ResponseKind, Any]], folder: Path, pictures: bool, summary: dict[str, Any]
) -> None:
    """Write responses, and add their figures, files and warnings to the summary."""
    summary["responses"] = [
        {"type": output.type, **kind.write(run, output, found, folder, pictures)} for output, kind, found in responses
    ]
    for response in summary["responses"]:
        summary["files"] += response["files"]
        summary["warnings"] += [warning for warning in response["warnings"] if warning not in summary["warnings"]]


def _write_motion(run: Pipeline, folder: Path) -> str:
    with whole_file(folder / "motion.nc") as part:
        write_motions(run.motions, part, VariableErrors(run).of)
    return "motion.nc"
