"""The computation of one point of a sweep, on this machine or on a cluster."""

from __future__ import annotations

import json
import threading

from fmd.accuracy.error_budget import allowed_seconds
from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.errors import AccuracyError, InputError
from fmd.output.result_figures import result_figures
from fmd.output.summary import summarise_solved
from fmd.scene.scene import Scene
from fmd.stages.pipeline import Pipeline
from fmd.sweep.points import point_key
from fmd.sweep.record import SUMMARY, Record, Wanted, interrupted_record

_alone = threading.Lock()
_last: list[Pipeline] = []
"""Stages of the last point that this process computed."""


def compute_point(key: str, scene: Scene, wanted: Wanted = SUMMARY) -> Record:
    """Run a scene without pictures; its record holds the summary with the results that are wanted, or the error.

    Gmsh keeps one model a process, so a worker with several threads computes one point after the other.
    """
    with _alone:
        try:
            if point_key(scene) != key:
                return interrupted_record(
                    "its worker has another version of this program, of a package or of the scene's files"
                )
        except InputError as error:  # a file that this machine doesn't have
            return interrupted_record(f"its worker: {error}")
        try:
            solved = SolvedScene(scene, like=_take_like(scene))
            solved.given.stands_alone = False  # other points run beside this one
            _last.append(solved.given)
            if wanted.budget and scene.moves:
                solved.run.motions  # noqa: B018 - what it takes is what its budget may take
            summary = summarise_solved(solved, (), wanted.budget, allowed_seconds(solved.run))
            if wanted.results:
                summary["results"] = result_figures(solved.run, wanted.results, wanted.histories)
            if wanted.histories and scene.moves:
                summary["times_s"] = solved.run.motion.times.tolist()
            unmet = solved.settings.unmet
            json.dumps(summary, allow_nan=False)
        except InputError as error:
            return interrupted_record(str(error)) if error.file == "--of" else Record("refused", str(error))
        except AccuracyError as error:
            return Record("failed", str(error))
        except Exception as error:  # a point is a row of the table, not the end of the sweep
            return interrupted_record(f"{type(error).__name__}: {error}")
        return Record("failed" if unmet else "ok", unmet, summary)


def _take_like(scene: Scene) -> Pipeline | None:
    """Return the stages of the last point if its flexible bodies are the same; they aren't kept any longer."""
    last = _last.pop() if _last else None
    alike = last is not None and last.scene.flexible == scene.flexible and not last.whole_energy
    return last if alike else None
