"""The computation of points of a sweep, on this machine or on a cluster."""

import json
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import groupby

from fmd.accuracy.error_budget import allowed_seconds
from fmd.accuracy.solved_scene import SolvedScene
from fmd.accuracy.time_limit import FAULTS
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.memory import FINE_MARCHES_AT_ONCE
from fmd.output.frequencies import mode_warnings
from fmd.output.result_figures import result_figures
from fmd.output.stress_warnings import stress_warnings
from fmd.output.summary import model_warnings, run_warnings, summarise_solved
from fmd.scene.result_names import is_of_parts, takes_motion
from fmd.scene.scene import Scene
from fmd.stages.pipeline import Pipeline
from fmd.stages.variants import share_fine_marches, share_growth, share_loads, share_marches
from fmd.sweep.points import point_key
from fmd.sweep.record import SUMMARY, Record, Wanted, interrupted_record

_alone = threading.Lock()
_last: list[Pipeline] = []
"""Stages of the last point that this process computed."""


def compute_point(key: str, scene: Scene, wanted: Wanted = SUMMARY) -> Record:
    """Run a scene without pictures; its record holds the summary with the results that are wanted, or the error."""
    ((_, record),) = compute_points({key: scene}, wanted)
    return record


def compute_points(scenes: Mapping[str, Scene], wanted: Wanted = SUMMARY) -> Iterator[tuple[str, Record]]:
    """Run some scenes, and yield key and record of each as it is done; what they can share is found for all at once.

    Gmsh keeps one model a process, so a worker with several threads computes one point after the other.
    """
    with _alone:
        for flexible, alike in groupby(scenes.items(), lambda pair: pair[1].flexible):
            points = dict(alike)
            if flexible and not (_last and _last[0].scene.flexible == flexible):
                first = next(iter(points))  # whose bodies the others take
                yield from _compute_together({first: points.pop(first)}, wanted)
            yield from _compute_together(points, wanted)


def _compute_together(scenes: Mapping[str, Scene], wanted: Wanted) -> Iterator[tuple[str, Record]]:
    """Run scenes with the same flexible bodies, as `compute_points` does."""
    solved: dict[str, SolvedScene] = {}
    for key, scene in scenes.items():
        if fault := _find_difference(key, scene):
            yield key, interrupted_record(fault)
            continue
        try:
            solved[key] = SolvedScene(scene, like=_take_like(scene))
        except Exception as error:
            yield key, _record_of(error)
            continue
        solved[key].given.stands_alone = False  # other points run beside this one
        _last.append(solved[key].given)
    moving = [point.given for point in solved.values() if not point.is_open and point.scene.moves]
    if len(moving) > 1 and (wanted.summary or any(map(takes_motion, wanted.results))):
        with suppress(*FAULTS):  # what is wrong with a point is in its own record
            share_loads(moving)
            share_growth(moving)
            share_marches(moving)
    keys = [*solved]
    for first in range(0, len(keys), FINE_MARCHES_AT_ONCE):
        some = keys[first : first + FINE_MARCHES_AT_ONCE]
        if wanted.summary and len(moving) > 1:
            with suppress(*FAULTS):
                share_fine_marches([solved[key].given for key in some if solved[key].given in moving])
        for key in some:
            yield key, _compute(solved.pop(key), wanted)


def _find_difference(key: str, scene: Scene) -> str:
    """Say how this process's version of a scene or its files differs from the one that the key is of; else nothing."""
    try:
        if point_key(scene) != key:
            return "its worker has another version of this program, of a package or of the scene's files"
    except InputError as error:  # a file that this machine doesn't have
        return f"its worker: {error}"
    return ""


def _compute(solved: SolvedScene, wanted: Wanted) -> Record:
    try:
        if wanted.budget and solved.scene.moves:
            solved.run.motions  # noqa: B018 - what it takes is what its budget may take
        if wanted.summary:
            summary = summarise_solved(solved, (), wanted.budget, allowed_seconds(solved.run))
        else:
            summary = {"scene": solved.scene.name, "warnings": _warn(solved.run, wanted.results)}
        if wanted.results:
            summary["results"] = result_figures(solved.run, wanted.results, wanted.histories)
        if wanted.histories and any(map(takes_motion, wanted.results)):
            summary["times_s"] = solved.run.motion.times.tolist()
        unmet = solved.settings.unmet
        json.dumps(summary, allow_nan=False)
    except Exception as error:
        return _record_of(error)
    return Record("failed" if unmet else "ok", unmet, summary)


def _warn(run: Pipeline, results: Sequence[str]) -> list[dict[str, str]]:
    """Return the warnings about what some results are made of."""
    if not any(map(takes_motion, results)):
        return model_warnings(run) if run.scene.moves and not all(map(is_of_parts, results)) else mode_warnings(run)
    named = {name.partition(".")[0] for name in results if {"stress", "life"} & {*name.split(".")}}
    stressed = {*run.wholes} if named & {"stress", "life"} else named  # without a name it is the only one's
    worst = {
        name: run.stress_of(name).worst() for name, part in run.wholes.items() if name in stressed and part.has_stress
    }
    return [*run_warnings(run), *(stress_warnings(run, worst) if stressed else ())]


def _record_of(error: Exception) -> Record:
    """Return the record of a point that ended by an error: a row of the table, not the end of the sweep."""
    if isinstance(error, InputError) and error.file != "--of":
        return Record("refused", str(error))
    if isinstance(error, AccuracyError):
        return Record("failed", str(error))
    return interrupted_record(str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}")


def _take_like(scene: Scene) -> Pipeline | None:
    """Return the stages of the last point if its flexible bodies are the same; they aren't kept any longer."""
    last = _last.pop() if _last else None
    alike = last is not None and last.scene.flexible == scene.flexible and not last.whole_energy
    return last if alike else None
