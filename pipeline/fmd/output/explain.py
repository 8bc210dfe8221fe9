"""Forecast of a run: the stages that will run, come from the cache or be skipped, and the reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from fmd.accuracy.error_budget import ERROR_BUDGET
from fmd.accuracy.solved_scene import SETTINGS, SolvedScene
from fmd.core.cache import stage_key
from fmd.core.paths import KERNEL_SOURCES, source_digest
from fmd.output.exports import EXPORTS
from fmd.output.picture_files import picture_key
from fmd.output.pictures import DRAWINGS
from fmd.scene.outputs import Export, is_drawn
from fmd.scene.pictures import MechanismView
from fmd.scene.stress_outputs import Envelope, Fatigue
from fmd.stages.divided_scene import part_of
from fmd.stages.part import PART_STAGES, FlexiblePart
from fmd.stages.pipeline import Pipeline

Fate = Literal["run", "cached", "skipped", "open"]

STAGES = (SETTINGS.name, *PART_STAGES, Pipeline.trajectories.name, ERROR_BUDGET.name, "files", "pictures")
"""Names of all stages of a run, in the order of forecasts."""
_SAME = "same inputs and source as when it was kept"


@dataclass(frozen=True)
class Step:
    """Forecast of one stage.

    Attributes
    ----------
    stage : str
        Its name.
    body : str
        The body that it belongs to; empty if it belongs to the whole scene.
    fate : str
        ``"run"``, ``"cached"``, ``"skipped"``, or ``"open"`` where the result of another stage decides.
    why : str
        The reason.
    seconds : float, optional
        Time that this took the last time in this scene, all bodies together [s].
    """

    stage: str
    body: str
    fate: Fate
    why: str
    seconds: float | None


@dataclass(frozen=True)
class Forecast:
    """Forecast of a run, stage by stage."""

    steps: tuple[Step, ...]

    @property
    def seconds(self) -> float:
        """Time that everything timed before took the last time [s]."""
        return sum({step.stage: step.seconds or 0.0 for step in self.steps}.values())

    @property
    def line(self) -> str:
        """Stages that will run and the time of all, in one line."""
        to_do = {step.stage: step for step in self.steps if step.fate == "run"}
        known = [f"{name} {_rounded(step.seconds)}" for name, step in to_do.items() if step.seconds is not None]
        unknown = [name for name, step in to_do.items() if step.seconds is None]
        new = f"not timed yet: {', '.join(unknown)}"
        if not known:
            return new if unknown else "nothing to do"
        more = (" and more", f"; {new}") if unknown else ("", "")
        return f"about {_rounded(self.seconds)}{more[0]} ({', '.join(known)}{more[1]})"

    def summary(self) -> dict[str, Any]:
        """Return the forecast as plain numbers and texts."""
        return {"stages": [asdict(step) for step in self.steps], "seconds": self.seconds, "forecast": self.line}


def forecast_run(solved: SolvedScene, pictures: bool, budget: bool) -> Forecast:
    """Forecast `write_results`; the only stage that this may compute is a spin that decides on another."""
    if not solved.is_settled:
        return _forecast_rounds(solved, pictures)
    run = solved.run
    planner = _Planner(run)
    if solved.is_open:
        planner.note(SETTINGS.name, "cached", _SAME)
    else:
        planner.note(SETTINGS.name, "skipped", "the scene leaves nothing open")
    outputs = [output for output in run.scene.output if is_drawn(output)]
    wanted = [output for output in run.scene.output if not is_drawn(output)]
    for part in run.parts.values():
        planner.want(part, ["body"])
    planner.want_stiffening()
    compiling = "" if planner.compiled else "; new kernels are compiled first"
    planner.note(Pipeline.trajectories.name, "run", f"never kept{compiling}")
    for part in run.parts.values():
        planner.want(part, ["deformation"])
    for part in [part for part in run.parts.values() if part.has_mesh]:
        planner.want(part, ["modes", "surface", "stress"])
    for part in run.parts.values():
        planner.want(part, ["element stress"] if part.shape.element else [])
    for export in (output for output in wanted if isinstance(output, Export)):
        if export.body is None:
            continue  # the whole mechanism, which the motion takes anyway
        suffix = "." + export.file.rpartition(".")[2]
        for part in run.pieces_of(export.body):
            planner.want(part, EXPORTS[suffix].reads if suffix in EXPORTS else ("modes", "body"))
            planner.want(part, ["inertia"] if suffix == ".nc" and part.joint.normal >= 0 else [])
    for field in (output for output in wanted if isinstance(output, Envelope | Fatigue)):
        for part in run.pieces_of(field.body):
            planner.want(part, DRAWINGS[field.type].reads)
    missing = [output for output in outputs if pictures and not planner.has_drawn(output)]
    for output in missing:
        reads, body = DRAWINGS[output.type].reads, getattr(output, "body", None)
        for own, part in run.parts.items():
            name = part_of(own) or own
            if isinstance(output, MechanismView):
                coloured = body in (None, name)
                shown = part.has_stress and (coloured or not output.alone)
                planner.want(part, [stage for stage in reads if coloured or stage != "stress"] if shown else [])
            elif name == body:
                planner.want(part, reads)
    planner.want_budget(budget and all(part.has_mesh for part in run.parts.values()))
    planner.note("files", "run" if wanted else "skipped", f"{len(wanted)} in the scene's output")
    if missing:
        planner.note("pictures", "run", f"{len(missing)} of {len(outputs)} in the scene's output are to be drawn")
    elif outputs and pictures:
        planner.note("pictures", "cached", _SAME)
    else:
        why = "left out by --no-pictures" if outputs else "none in the scene's output"
        planner.note("pictures", "skipped", why)
    planner.skip_others()
    return planner.forecast()


def _forecast_rounds(solved: SolvedScene, pictures: bool) -> Forecast:
    """Forecast a run whose settings aren't known yet: they decide what else will run."""
    planner, scene = _Planner(solved.given), solved.scene
    rounds = "rounds of refinement until the error budget states the wanted accuracy"
    planner.note(SETTINGS.name, "run", rounds if scene.accuracy is not None else "finds the numbers of pieces")
    for stage in (*PART_STAGES, ERROR_BUDGET.name):
        for name in scene.flexible if stage in PART_STAGES else [""]:
            planner.note(stage, "open", "the settings that are found decide", name)
    planner.note(Pipeline.trajectories.name, "run", "never kept")
    for stage, count in (
        ("files", sum(not is_drawn(output) for output in scene.output)),
        ("pictures", pictures * sum(map(is_drawn, scene.output))),
    ):
        planner.note(stage, "run" if count else "skipped", f"{count} in the scene's output")
    return planner.forecast()


def remember_times(run: Pipeline) -> None:
    """Keep the time that each stage took in a run, and the keys of the stages, for the next forecast."""
    log, last = run.log, _last(run)
    for stage, seconds in log.seconds.items():
        fate = "run" if stage in log.run else "cached"
        last["seconds"].setdefault(fate, {})[_timed_as(stage, last["kernels"] == _kernels())] = seconds
    for part in run.parts.values():
        stages = [stage for stage in PART_STAGES.values() if not stage.in_key]
        last["keys"] |= {(stage.name, part.name): stage.key(part) for stage in stages}
    run.store.cache.save(_name(run), last | {"kernels": _kernels()})


def _last(run: Pipeline) -> dict[str, Any]:
    empty: dict[str, Any] = {"seconds": {}, "keys": {}, "kernels": ""}
    return run.store.cache.load(_name(run)) or empty


def _name(run: Pipeline) -> str:
    return stage_key("last", [run.scene.name, run.scene.file], ("fmd/output/explain.py",))


def _kernels() -> str:
    return source_digest(*KERNEL_SOURCES)


def _timed_as(stage: str, compiled: bool) -> str:
    return stage if compiled or stage != Pipeline.trajectories.name else "motion and kernels"


class _Planner:
    """Goes through the stages as a run does, and notes them instead of computing."""

    def __init__(self, run: Pipeline) -> None:
        self._run, self._last = run, _last(run)
        self._steps: dict[tuple[str, str], Step] = {}
        self._twins: dict[str, str] = {}  # body that has the result under each key first
        self.compiled = self._last["kernels"] == _kernels()

    def note(self, stage: str, fate: Fate, why: str, body: str = "") -> None:
        """Note the fate of a stage."""
        seconds = self._last["seconds"].get(fate, {}).get(_timed_as(stage, self.compiled))
        self._steps[stage, body] = Step(stage, body, fate, why, seconds)

    def want(self, part: FlexiblePart, names: Sequence[str]) -> None:
        """Note stages of a body, and those that they read if they have to run."""
        for name in names:
            if (name, part.name) in self._steps:
                continue
            stage = PART_STAGES[name]
            if name == "mesh" and part.piece is not None:
                self.note(name, "cached", "cut from the whole part's mesh", part.name)
                continue
            self.want(part, stage.in_key)
            anew = [other for other in stage.in_key if self._steps[other, part.name].fate == "run"]
            if anew:
                self.note(name, "run", f"the {anew[0]} is made anew", part.name)
            elif (key := stage.key(part)) and (twin := self._twins.setdefault(key, part.name)) != part.name:
                same = self._steps[name, twin]
                self._steps[name, part.name] = replace(same, body=part.name, fate="cached", why=f"that of {twin}")
            else:
                self.note(name, *self._fate(key, (name, part.name)), part.name)
            if self._steps[name, part.name].fate == "run":
                self.want(part, stage.reads)

    def has_drawn(self, output: Any) -> bool:
        """Return True if the cache holds an output's files as they were drawn."""
        return self._run.store.cache.holds(picture_key(self._run, output))

    def _fate(self, key: str, at: tuple[str, str]) -> tuple[Fate, str]:
        if not key:
            return "run", "never kept"
        if self._run.store.cache.folder is None:
            return "run", "nothing is kept: --no-cache"
        if self._run.store.cache.holds(key):
            return "cached", _SAME
        before = self._last["keys"].get(at)
        if before is None:
            return "run", "not kept yet"
        return "run", "no longer in the cache, or damaged" if before == key else "its inputs or the source have changed"

    def want_stiffening(self) -> None:
        """Note geometric stiffening where the spin calls for it, if that is known by now."""
        wanted, parts = self._run.scene.simulation.stiffening, self._run.parts
        known = all(self._steps["body", name].fate == "cached" for name in parts)
        for name, part in parts.items():
            if wanted == "on":
                self.want(part, ["stiffening"])
            elif wanted == "off":
                self.note("stiffening", "skipped", "simulation.stiffening is off", name)
            elif not (known and self.compiled):
                self.note("stiffening", "open", "how fast the body will turn decides", name)
            elif self._run.spin[name].stiffened:
                self.want(part, ["stiffening"])
            else:
                rate = self._run.spin[name].largest_rate
                self.note("stiffening", "skipped", f"turns at up to {rate:.3g} rad/s, which hardly matters", name)

    def want_budget(self, wanted: bool) -> None:
        """Note the error budget and the stages that it reads."""
        if not wanted:
            self.note(ERROR_BUDGET.name, "skipped", "left out by --no-budget")
            return
        self.note(ERROR_BUDGET.name, *self._fate(ERROR_BUDGET.key(self._run), (ERROR_BUDGET.name, "")))
        if self._steps[ERROR_BUDGET.name, ""].fate == "run":
            for part in self._run.parts.values():
                self.want(part, ERROR_BUDGET.reads)

    def skip_others(self) -> None:
        """Note that the stages of bodies that nothing has asked for are skipped."""
        why = "nothing that runs needs it" if self._run.parts else "no flexible body"
        for stage in PART_STAGES:
            for name in self._run.parts or [""]:
                if (stage, name) not in self._steps:
                    self.note(stage, "skipped", why, name)

    def forecast(self) -> Forecast:
        """Return all stages in their order."""
        return Forecast(tuple(sorted(self._steps.values(), key=lambda step: STAGES.index(step.stage))))


def _rounded(seconds: float | None) -> str:
    """Write a time with two digits."""
    if seconds is None:
        return "?"
    if seconds < 1.0:
        return f"{seconds:.1f} s" if seconds >= 0.05 else "0 s"
    return f"{seconds:.2g} s" if seconds < 100 else f"{seconds / 60:.2g} min"
