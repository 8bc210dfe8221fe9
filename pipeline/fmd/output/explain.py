"""Forecast of a run: the stages that will run, come from the cache or be skipped, and the reasons."""

from dataclasses import asdict, replace
from typing import Any, Literal

from fmd.accuracy.error_budget import ERROR_BUDGET, read_kept_errors
from fmd.accuracy.solved_scene import SETTINGS, SolvedScene
from fmd.core.cache import Cache, stage_key
from fmd.core.data_classes import dataclass
from fmd.core.limits.memory import ALWAYS_FIT, SMALL_SYSTEM
from fmd.core.paths import KERNEL_SOURCES, source_digest
from fmd.output.output_kinds import kind_of, outputs_of
from fmd.output.picture_files import picture_key
from fmd.scene.histories import Quantities
from fmd.stages.part import PART_STAGES, FlexiblePart
from fmd.stages.pipeline import RUN_STAGES, Pipeline
from fmd.stages.run_checks import expected_bytes
from fmd.stages.runs import MACHINE_CODE
from fmd.stages.stage import Stage
from fmd.stages.store import StageStore

Fate = Literal["run", "cached", "skipped", "open"]

_OF_RUN: dict[str, Stage[Any]] = {**RUN_STAGES, ERROR_BUDGET.name: ERROR_BUDGET}
STAGES = (SETTINGS.name, *PART_STAGES, *_OF_RUN, "responses", "files", "pictures")
"""Names of all stages of a run, in the order of forecasts."""
_COUNTED = "{} in the scene's output"
_SAME = "same inputs and source as when it was kept"


@dataclass(frozen=True)
class Step:
    """Forecast of one stage."""

    stage: str
    body: str  # the body that it belongs to; empty if it belongs to the whole scene
    fate: Fate  # ``"run"``, ``"cached"``, ``"skipped"``, or ``"open"`` where the result of another stage decides
    why: str
    seconds: float | None  # time that this took the last time in this scene, all bodies together [s]


@dataclass(frozen=True)
class Forecast:
    """Forecast of a run, stage by stage, and of the memory that its results, and searches for modes, take [bytes]."""

    steps: tuple[Step, ...]
    memory: float = 0.0
    memory_of_modes: float = 0.0  # of the largest body whose modes will be sought

    @property
    def seconds(self) -> float:
        """Time that everything timed before took the last time [s]."""
        return sum({step.stage: step.seconds or 0.0 for step in self.steps}.values())

    @property
    def line(self) -> str:
        """Stages that will run and the time of all, and the memory of large results and of modes, in one line."""
        parts = {"results take": self.memory, "modes": self.memory_of_modes}
        large = [f"{what} about {size / 1e9:.2g} GB of memory" for what, size in parts.items() if size > ALWAYS_FIT]
        return "; ".join([self._line_of_time, *large])

    @property
    def _line_of_time(self) -> str:
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
        stages = [asdict(step) for step in self.steps]
        memory = {"memory_bytes": self.memory, "modes_memory_bytes": self.memory_of_modes}
        return {"stages": stages, "seconds": self.seconds, **memory, "forecast": self.line}


def forecast_run(solved: SolvedScene, pictures: bool, budget: bool) -> Forecast:
    """Forecast `write_results`, by what its results read; of a part in pieces the mesh is made and cut for that."""
    if not solved.is_settled:
        return _forecast_rounds(solved, pictures)
    run = solved.run
    if budget:
        read_kept_errors(run)  # pictures show them
    planner = _Planner(run)
    if solved.is_open:
        planner.note(SETTINGS.name, "cached", _SAME)
    else:
        planner.note(SETTINGS.name, "skipped", "the scene leaves nothing open")
    of_places = ("stress", "element stress", "spot stress", "contact stress")
    for name in ("strain", "modes", "surface", *of_places):
        planner.want(name)
    if budget or _looks_between_outputs(run):
        planner.want(Pipeline.fine_motion.name)
    drawn, files, responses = (outputs_of(run.scene, stage) for stage in ("pictures", "files", "responses"))
    missing = [output for output in drawn if pictures and not planner.has_drawn(output)]
    for output in (*files, *responses, *missing):
        for name, body in kind_of(output).reads(run, output):
            planner.want(name, body)
    if budget:
        planner.want(ERROR_BUDGET.name)
    else:
        planner.note(ERROR_BUDGET.name, "skipped", "left out by --no-budget")
    for stage, outputs in (("responses", responses), ("files", files)):
        planner.note(stage, "run" if outputs else "skipped", _COUNTED.format(len(outputs)))
    planner.note("pictures", *_fate_of_pictures(len(drawn), len(missing), pictures))
    planner.skip_others()
    return planner.forecast()


def _looks_between_outputs(run: Pipeline) -> bool:
    """Return true if a run asks what a flexible tip, histories and tables, or stress miss between output times."""
    tip = run.scene.simulation.tip.partition(".")[0]
    tables = any(isinstance(output, Quantities) for output in run.scene.output)
    return tip in run.wholes or tables or any(part.has_stress for part in run.wholes.values())


def _fate_of_pictures(n_drawn: int, n_missing: int, wanted: bool) -> tuple[Fate, str]:
    if n_missing:
        return "run", f"{n_missing} of {n_drawn} in the scene's output are to be drawn"
    if n_drawn and wanted:
        return "cached", _SAME
    return "skipped", "left out by --no-pictures" if n_drawn else _COUNTED.format(0)


def _forecast_rounds(solved: SolvedScene, pictures: bool) -> Forecast:
    """Forecast a run whose settings aren't known yet: they decide what else will run."""
    planner, scene = _Planner(solved.given), solved.scene
    rounds = "rounds of refinement until the error budget states the wanted accuracy"
    planner.note(SETTINGS.name, "run", rounds if scene.accuracy is not None else "finds the numbers of pieces")
    for stage in (*PART_STAGES, *RUN_STAGES, ERROR_BUDGET.name):
        for name in scene.flexible if stage in PART_STAGES else [""]:
            planner.note(stage, "open", "the settings that are found decide", name)
    for stage in ("responses", "files", "pictures"):
        count = len(outputs_of(scene, stage)) * (pictures or stage != "pictures")
        planner.note(stage, "run" if count else "skipped", _COUNTED.format(count))
    return planner.forecast()


def remember_times(run: Pipeline) -> None:
    """Keep the time that each stage took in a run, and the keys of the stages, for the next forecast."""
    log, last = run.log, _last(run)
    for stage, seconds in log.seconds.items():
        fate = "run" if stage in log.run else "cached"
        last["seconds"].setdefault(fate, {})[_timed_as(stage, last["kernels"] == _kernels())] = seconds
    last["keys"] |= {(stage.name, ""): stage.key(run) for stage in _OF_RUN.values()}
    for part in run.parts.values():
        stages = [stage for stage in PART_STAGES.values() if not stage.in_key]
        last["keys"] |= {(stage.name, part.name): stage.key(part) for stage in stages}
    run.store.cache.save(_name(run), last | {"kernels": _kernels()})


def _last(run: Pipeline) -> dict[str, Any]:
    empty: dict[str, Any] = {"seconds": {}, "keys": {}, "kernels": ""}
    kept = run.store.cache.load(_name(run), "dict")
    return kept if kept and kept.keys() == empty.keys() else empty  # another version's may hold something else


def _name(run: Pipeline) -> str:
    return stage_key("last", [run.scene.name, run.scene.file], ("fmd/output/explain.py",))


def _kernels() -> str:
    return source_digest(*KERNEL_SOURCES)


def _timed_as(stage: str, compiled: bool) -> str:
    return stage if compiled or stage != MACHINE_CODE else "new machine code"


class _Planner:
    """Goes through the stages as a run does, and notes them instead of computing."""

    def __init__(self, run: Pipeline) -> None:
        self._run, self._last = run, _last(run)
        self._steps: dict[tuple[str, str], Step] = {}
        self._twins: dict[str, str] = {}  # body that has the result under each key first
        self._compiled = self._last["kernels"] == _kernels()

    def note(self, stage: str, fate: Fate, why: str, body: str = "") -> None:
        """Note the fate of a stage."""
        seconds = self._last["seconds"].get(fate, {}).get(_timed_as(stage, self._compiled))
        self._steps[stage, body] = Step(stage, body, fate, why, seconds)

    def has_drawn(self, output: Any) -> bool:
        """Return True if the cache holds an output's files as they were drawn."""
        return self._run.store.cache.holds(picture_key(self._run, output))

    def want(self, name: str, body: str = "") -> None:
        """Note a stage of the scene, of a body or of all bodies, and what it reads if it has to run."""
        if name not in PART_STAGES:
            self._want_of_run(_OF_RUN[name])
            return
        for part in [self._run.parts[body]] if body else self._run.parts.values():
            self._want_of_part(PART_STAGES[name], part)

    def _want_of_run(self, stage: Stage[Any]) -> None:
        if (stage.name, "") in self._steps or not stage.applies(self._run):
            return
        more = "" if self._compiled or stage.name != MACHINE_CODE else "; the kernels are new"
        fate, why = self._fate(stage.key(self._run), (stage.name, ""))
        self.note(stage.name, fate, why + more)
        if fate == "run":
            for other in stage.reads:
                self.want(other)

    def _want_of_part(self, stage: Stage[Any], part: FlexiblePart) -> None:
        at = stage.name, part.name
        if at in self._steps or not stage.applies(part):
            return
        if stage.name == "mesh" and part.piece is not None:
            self.note("mesh", "cached", "cut from the whole part's mesh", part.name)
            return
        if stage.name == "stiffening" and (decided := self._without_stiffening(part.name)):
            self.note("stiffening", *decided, part.name)
            return
        for name in stage.in_key:
            self.want(name, part.name)
        anew = [other for other in stage.in_key if self._steps[other, part.name].fate == "run"]
        if anew:
            self.note(stage.name, "run", f"the {anew[0]} is made anew", part.name)
        elif (key := stage.key(part)) and (twin := self._twins.setdefault(key, part.name)) != part.name:
            self._steps[at] = replace(
                self._steps[stage.name, twin], body=part.name, fate="cached", why=f"that of {twin}"
            )
        else:
            self.note(stage.name, *self._fate(key, at), part.name)
        if self._steps[at].fate == "run":
            for name in stage.reads:
                self.want(name, part.name)

    def _without_stiffening(self, name: str) -> tuple[Fate, str] | None:
        """Return why a body isn't stiffened, or isn't known to be; ``None`` if it is."""
        wanted = self._run.scene.simulation.stiffening
        if wanted != "auto":
            return ("skipped", "simulation.stiffening is off") if wanted == "off" else None
        self.want(Pipeline.stiffening_loads.name)
        if self._steps[Pipeline.stiffening_loads.name, ""].fate != "cached":
            return "open", "the loads through the body will decide"
        spin = self._run.stiffening_loads[name]
        why = f"turns at up to {spin.largest_rate:.3g} rad/s, which hardly matters"
        return None if spin.stiffened else ("skipped", why)

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

    def skip_others(self) -> None:
        """Note that the stages that nothing has asked for are skipped."""
        why = "nothing that runs needs it" if self._run.parts else "no flexible body"
        for stage in STAGES:
            for name in (self._run.parts or [""]) if stage in PART_STAGES else [""]:
                if (stage, name) not in self._steps:
                    self.note(stage, "skipped", why, name)

    def forecast(self) -> Forecast:
        """Return all stages in their order."""
        steps = sorted(self._steps.values(), key=lambda step: STAGES.index(step.stage))
        results = expected_bytes(self._run.scene) if self._run.scene.moves else 0.0
        sought = [step.body for step in steps if step.stage == "modes" and step.fate == "run"]
        kept = {step.body for step in steps if step.stage == "mesh" and step.fate == "cached"}
        meshed = [name for name in sought if name in kept or self._run.parts[name].shape.shape != "cad"]
        largest = max((bytes_of_modes(self._run, name) for name in meshed), default=0.0)
        return Forecast(tuple(steps), results, largest)


def bytes_of_modes(run: Pipeline, name: str) -> float:
    """Predict the memory of a part's modes by its mesh [bytes]; 0 of few unknowns, and where elements aren't alike."""
    part = run.parts[name]
    if part.piece is None:  # a mesh that isn't kept leaves no trace; that of CAD is read
        store = StageStore(run.store.cache if part.shape.shape == "cad" else Cache(None))
        part = FlexiblePart(run.scene, name, store, part)
    space = part.space if part.has_mesh else None
    nodes = getattr(space, "element_nodes", None)  # which solids beside shells or beams have of each kind
    if space is None or nodes is None or 3 * len(space.x) < SMALL_SYSTEM:
        return 0.0
    from fmd.reduction.factor.factor import predict_bytes

    modes = part.shape.modes
    return predict_bytes(nodes, modes.count if modes.family == "any" else 4 * modes.count)


def _rounded(seconds: float | None) -> str:
    """Write a time with two digits."""
    if seconds is None:
        return "?"
    if seconds < 1.0:
        return f"{seconds:.1f} s" if seconds >= 0.05 else "0 s"
    return f"{seconds:.2g} s" if seconds < 100 else f"{seconds / 60:.2g} min"
