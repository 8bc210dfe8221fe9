"""What a run will do before it does it: which stages will run, come from the cache or are skipped, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from pipeline.core.cache import stage_key
from pipeline.core.paths import source_digest
from pipeline.stages.store import name_of

if TYPE_CHECKING:
    from pipeline.stages.part import FlexiblePart
    from pipeline.stages.pipeline import Pipeline

Fate = Literal["run", "cached", "skipped", "open"]

# What each stage of a body reads of the others when it has to run. Whether it has to is asked of the cache, under the
# keys that the run itself uses.
_READS: dict[str, tuple[str, ...]] = {
    "mesh": (),
    "assembly": ("mesh",),
    "modes": ("mesh", "assembly"),
    "body": ("mesh", "assembly", "modes"),
    "stiffening": ("mesh", "assembly", "body"),
    "surface": ("mesh",),
    "stress": ("mesh", "surface", "body"),
    "element stress": ("mesh", "body"),
    "nodal stress": ("mesh", "body"),
    "inertia": ("mesh", "assembly", "body"),
    "error budget": ("mesh", "assembly", "modes", "body", "surface", "stress"),  # the rest is in stages of its own
}
# Properties of a part with the keys that it keeps its stages under; assembly never is.
_KEYS = {
    "mesh": "_mesh_key",
    "modes": "_modes_key",
    "surface": "_modes_key",
    "body": "body_key",
    "stress": "body_key",
    "nodal stress": "body_key",
    "inertia": "body_key",
    "stiffening": "_stiffening_key",
    "element stress": "_element_key",
}
# What each kind of output reads.
_DRAWS: dict[str, tuple[str, ...]] = {
    "chart": (),
    "mesh": ("mesh", "surface", "body"),
    "modes": ("modes", "surface", "body"),
    "mode sheet": ("modes", "surface", "body"),
    "stress": ("surface", "stress", "body"),
    "film": ("mesh", "surface", "stress", "body"),
}
_SAME = "same inputs and source as when it was kept"
_WRITES: dict[str, tuple[str, ...]] = {
    ".vtkhdf": ("mesh", "body", "nodal stress"),
    ".nc": ("modes", "body", "surface", "stress"),
}


@dataclass(frozen=True)
class Step:
    """What will become of a stage.

    Attributes
    ----------
    stage : str
        Its name.
    body : str
        Whose it is; empty if it is the whole scene's.
    fate : str
        ``"run"``, ``"cached"``, ``"skipped"``, or ``"open"`` where the result of another stage decides.
    why : str
        The reason.
    seconds : float, optional
        What that took the last time in this scene, all bodies together [s].
    """

    stage: str
    body: str
    fate: Fate
    why: str
    seconds: float | None


@dataclass(frozen=True)
class RunPlan:
    """What a run will do, stage by stage."""

    steps: tuple[Step, ...]

    @property
    def seconds(self) -> float:
        """What all that was timed before took the last time [s]."""
        return sum({step.stage: step.seconds or 0.0 for step in self.steps}.values())

    @property
    def forecast(self) -> str:
        """What will run and how long all will take, in one line."""
        to_do = {step.stage: step for step in self.steps if step.fate == "run"}
        known = [f"{name} {_about(step.seconds)}" for name, step in to_do.items() if step.seconds is not None]
        unknown = [name for name, step in to_do.items() if step.seconds is None]
        new = f"not timed yet: {', '.join(unknown)}"
        if not known:
            return new if unknown else "nothing to do"
        more = (" and more", f"; {new}") if unknown else ("", "")
        return f"about {_about(self.seconds)}{more[0]} ({', '.join(known)}{more[1]})"

    def summary(self) -> dict[str, Any]:
        """Plain numbers and texts."""
        return {"stages": [asdict(step) for step in self.steps], "seconds": self.seconds, "forecast": self.forecast}


def plan_of(run: Pipeline, pictures: bool, budget: bool) -> RunPlan:
    """Foretell what `write_results` will do; all it may compute is a spin that decides on a stage."""
    planner = _Planner(run)
    outputs = [output for output in run.scene.output if output.type != "export"]
    exports = [output for output in run.scene.output if output.type == "export"]
    for part in run.parts.values():
        planner.ask(part, ["body"])
    planner.stiffen()
    planner.note("motion", "run", "never kept" + ("" if planner.compiled else "; new kernels are compiled first"))
    for part in [part for part in run.parts.values() if part.has_mesh][:1]:
        planner.ask(part, ["modes", "surface", "stress"])
    for part in run.parts.values():
        planner.ask(part, ["element stress"] if part.shape.element else [])
    for export in exports:
        suffix = "." + export.file.rpartition(".")[2]
        part = run.parts[export.body]
        planner.ask(part, _WRITES.get(suffix, ("mesh",)))
        planner.ask(part, ["inertia"] if suffix == ".nc" and part.inboard.normal >= 0 else [])
    missing = [output for output in outputs if pictures and not planner.has_drawn(output)]
    for output in missing:
        body = getattr(output, "body", None)
        planner.ask(run.parts[body], _DRAWS[output.type]) if body else None
    planner.estimate(budget and all(part.has_mesh for part in run.parts.values()))
    planner.note("files", "run" if exports else "skipped", f"{len(exports)} in the scene's output")
    if missing:
        planner.note("pictures", "run", f"{len(missing)} of {len(outputs)} in the scene's output are to be drawn")
    elif outputs and pictures:
        planner.note("pictures", "cached", _SAME)
    else:
        why = "left out by --no-pictures" if outputs else "none in the scene's output"
        planner.note("pictures", "skipped", why)
    return planner.plan()


def remember(run: Pipeline) -> None:
    """Keep what each stage took in a run, and the keys it was kept under, for the next plan."""
    log, last = run.log, _last(run)
    for stage, seconds in log.seconds.items():
        fate = "run" if stage in log.run else "cached"
        last["seconds"].setdefault(fate, {})[_timed_as(stage, last["kernels"] == _kernels())] = seconds
    for part in run.parts.values():
        last["keys"] |= {(stage, part.name): _key_of(part, stage) for stage in _READS if stage != "element stress"}
    run.keeper.cache.save(_name(run), last | {"kernels": _kernels()})


def _last(run: Pipeline) -> dict[str, Any]:
    empty: dict[str, Any] = {"seconds": {}, "keys": {}, "kernels": ""}
    return run.keeper.cache.load(_name(run)) or empty


def _name(run: Pipeline) -> str:
    return stage_key("last", [run.scene.name, run.scene.file], ("pipeline/stages/explain.py",))


def _kernels() -> str:
    return source_digest("pipeline/dynamics", "pipeline/integrators")


def _timed_as(stage: str, compiled: bool) -> str:
    return stage if compiled or stage != "motion" else "motion and kernels"


def _key_of(part: FlexiblePart, stage: str) -> str:
    return str(getattr(part, _KEYS[stage])) if stage in _KEYS else ""


class _Planner:
    """Asks for stages as the run does, and notes instead of computing."""

    def __init__(self, run: Pipeline) -> None:
        self._run, self._last = run, _last(run)
        self._steps: dict[tuple[str, str], Step] = {}
        self.compiled = self._last["kernels"] == _kernels()

    def note(self, stage: str, fate: Fate, why: str, body: str = "") -> None:
        """Note what will become of a stage."""
        timed_as = _timed_as("stress" if stage == "element stress" else stage, self.compiled)
        seconds = self._last["seconds"].get(fate, {}).get(timed_as)
        self._steps[stage, body] = Step(stage, body, fate, why, seconds)

    def ask(self, part: FlexiblePart, stages: Sequence[str]) -> None:
        """Ask for stages of a body; one that has to run asks for others."""
        for stage in stages:
            if (stage, part.name) in self._steps:
                continue
            if stage == "element stress":  # its elements are found on the mesh, and are part of its key
                self.ask(part, ["mesh"])
            if stage == "element stress" and self._steps["mesh", part.name].fate == "run":
                self.note(stage, "run", "the mesh is made anew", part.name)
            else:
                kept_as = "stress" if stage == "element stress" else stage
                self.note(stage, *self._fate(kept_as, _key_of(part, stage), (stage, part.name)), part.name)
            if self._steps[stage, part.name].fate == "run":
                self.ask(part, _READS[stage])

    def has_drawn(self, output: Any) -> bool:
        """Whether an output's files are kept as they were drawn."""
        from pipeline.output.picture_files import picture_key

        return self._run.keeper.cache.holds(name_of("pictures", picture_key(self._run, output)))

    def _fate(self, stage: str, key: str, at: tuple[str, str]) -> tuple[Fate, str]:
        if not key:
            return "run", "never kept"
        if self._run.keeper.cache.folder is None:
            return "run", "nothing is kept: --no-cache"
        if self._run.keeper.cache.holds(name_of(stage, key)):
            return "cached", _SAME
        before = self._last["keys"].get(at)
        if before is None:
            return "run", "not kept yet"
        return "run", "no longer in the cache, or damaged" if before == key else "its inputs or the source have changed"

    def stiffen(self) -> None:
        """Ask for geometric stiffening where the spin calls for it, if that is known by now."""
        wanted, parts = self._run.scene.simulation.stiffening, self._run.parts
        known = all(self._steps["body", name].fate == "cached" for name in parts)
        for name, part in parts.items():
            if wanted == "on":
                self.ask(part, ["stiffening"])
            elif wanted == "off":
                self.note("stiffening", "skipped", "simulation.stiffening is off", name)
            elif not (known and (self.compiled or self._run.is_rotor)):
                self.note("stiffening", "open", "how fast the body will turn decides", name)
            elif self._run.spin[name].stiffened:
                self.ask(part, ["stiffening"])
            else:
                rate = self._run.spin[name].largest_rate
                self.note("stiffening", "skipped", f"turns at up to {rate:.3g} rad/s, which hardly matters", name)

    def estimate(self, wanted: bool) -> None:
        """Note the error budget and what it reads."""
        if not wanted:
            self.note("error budget", "skipped", "left out by --no-budget")
            return
        from pipeline.accuracy.error_budget import budget_key

        self.note("error budget", *self._fate("error budget", budget_key(self._run), ("error budget", "")))
        if self._steps["error budget", ""].fate == "run":
            for part in self._run.parts.values():
                self.ask(part, _READS["error budget"])

    def plan(self) -> RunPlan:
        """All stages in their order; what nothing has asked for is skipped."""
        for stage in _READS:
            for name in self._run.parts or [""]:
                if not {(stage, name), (stage, "")} & self._steps.keys():
                    why = "nothing that runs needs it" if self._run.parts else "no flexible body"
                    self.note(stage, "skipped", why, name)
        order = ["mesh", "assembly", "modes", "body", "stiffening", "motion", *_READS, "files", "pictures"]
        return RunPlan(tuple(sorted(self._steps.values(), key=lambda step: order.index(step.stage))))


def _about(seconds: float | None) -> str:
    """A time to two digits."""
    if seconds is None:
        return "?"
    if seconds < 1.0:
        return f"{seconds:.1f} s" if seconds >= 0.05 else "0 s"
    return f"{seconds:.2g} s" if seconds < 100 else f"{seconds / 60:.2g} min"
