"""A target accuracy, met by refining what the error budget is made of, and numbers of pieces that a scene leaves."""

import math
from dataclasses import field
from typing import Any

from fmd.accuracy.deflection import find_deflection_error
from fmd.accuracy.error_budget import ERROR_BUDGET
from fmd.accuracy.error_estimates import NUMERICAL, Row, percent
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits import errors as limits
from fmd.core.limits.mesh import FEWEST_PIECES, MOST_PIECES_TRIED
from fmd.scene.imported_bodies import MatrixPart
from fmd.scene.reduced_bodies import ReducedPart
from fmd.scene.runs import AutoRun
from fmd.scene.scene import Scene
from fmd.scene.variants import change_modes, change_simulation, coarsen_meshes, refine_meshes, replace_order, set_pieces
from fmd.stages.pipeline import Pipeline

_FAILED = "a round that failed"


@dataclass(frozen=True)
class Round:
    """Settings and error budget of one round of refinement."""

    settings: dict[str, Any]  # mesh and modes of each flexible body, and the required error of the time integration
    worst: Row  # quantity with the largest stated error
    # Largest share of each source in the stated error of any quantity.
    shares: dict[str, float] = field(default_factory=dict)
    given_up: tuple[Row, ...] = ()  # quantities that refining hardly improves, and that the others are not refined for

    def summary(self) -> dict[str, Any]:
        """Return the round as plain numbers and texts."""
        found = {"quantity": self.worst.name, "stated": self.worst.numerical, "dominant": self.worst.dominant}
        given_up = [{"quantity": row.name, "stated": row.numerical, "dominant": row.dominant} for row in self.given_up]
        return self.settings | {"worst": found, "refined_for": self.shares, "given_up": given_up}


@dataclass(frozen=True)
class Refinement:
    """Rounds of refinement for a required accuracy, and the run that states the smallest errors."""

    run: Pipeline  # the run of the last round if the accuracy is met, else that of the best one
    rounds: tuple[Round, ...]
    chosen: int  # number of the run's round, from 0
    ended_by: str = ""  # cap that ended the rounds before the accuracy was met; empty if it is met

    @property
    def failed(self) -> bool:
        """True if a round that couldn't be computed ended the rounds."""
        return self.ended_by.startswith(_FAILED)

    @property
    def met(self) -> bool:
        """True if every quantity is stated within the required accuracy."""
        return not (self.ended_by or self.rounds[self.chosen].given_up)

    @property
    def unmet(self) -> str:
        """Reason why the required accuracy isn't met, and what ended the rounds; empty if it is met."""
        best, required, reasons = self.rounds[self.chosen], self.run.scene.accuracy, []
        if self.ended_by:
            assert required is not None
            reasons.append(
                f"{percent(required)} % was not met: refining ended at {self.ended_by}; the best, round "
                f"{self.chosen + 1}, states {percent(best.worst.numerical)} % for '{best.worst.name}', most of it from "
                f"{best.worst.dominant}"
            )
        if best.given_up:
            named = "; ".join(
                f"'{row.name}', stated {percent(row.numerical)} %, most from {row.dominant}" for row in best.given_up
            )
            rest = "" if self.ended_by else "; all else is met"
            reasons.append(f"finer meshes and more modes hardly lower the error of {named}{rest}")
        return f"accuracy: {'; '.join(reasons)}" if reasons else ""

    def summary(self) -> dict[str, Any]:
        """Return the refinement as plain numbers and texts."""
        rounds = [each.summary() for each in self.rounds]
        required = {"wanted": self.run.scene.accuracy, "met": self.met}
        return required | {"ended_by": self.ended_by, "chosen_round": self.chosen + 1, "rounds": rounds}


def meet_accuracy(run: Pipeline) -> Refinement:
    """Find the first of a row of ever finer runs whose budget states the scene's required accuracy or better.

    The first has half of the scene's elements each way, quadratic ones, its modes with the static responses to inertia
    loads, and the automatic integrator. The scene's number of modes is where that of the basis starts; of the
    frequencies only as many count. A quantity whose error two rounds hardly lower is given up: stress at an edge that
    is held has no limit, what a load acts on rings in vibrations beyond any basis. It is reported, not refined for.
    The model's own errors don't count, for no refinement lowers them: the run warns of them.
    If the accuracy isn't met within some rounds, or on a mesh that can be afforded, the best run counts.

    Raises
    ------
    AccuracyError, InputError
        The first round can't be computed.
    """
    required = run.scene.accuracy
    assert required is not None
    scene = _start(run.scene, required)
    rounds: list[Round] = []
    stated: list[dict[str, float]] = []
    best, chosen = run, 0
    here = run
    ended_by = f"{limits.MOST_ROUNDS} rounds"
    for left in reversed(range(limits.MOST_ROUNDS)):
        here = here.variant(scene, here.store.monitor)
        try:
            budget = ERROR_BUDGET.of(here)
        except (AccuracyError, InputError) as error:
            if not rounds:
                raise
            ended_by = f"{_FAILED}: {error}"
            break
        rows = budget.results(run.scene)
        stated.append({row.name: row.numerical for row in rows})
        stalled = {name for name in stated[-1] if _is_stalled([past[name] for past in stated], required, left)}
        stalled |= {row.name for row in rounds[-1].given_up if row.numerical > required} if rounds else set()
        hopeful = [row for row in rows if row.name not in stalled] or rows
        worst = max(hopeful, key=lambda row: row.numerical)
        given_up = tuple(row for row in rows if row.name in stalled and row.numerical > required)
        this = Round(_settings(scene), worst, _shares(hopeful), given_up)
        if worst.numerical <= min((each.worst.numerical for each in rounds), default=math.inf):
            best, chosen = here, len(rounds)
        rounds.append(this)
        if worst.numerical <= required:
            return Refinement(here, tuple(rounds), len(rounds) - 1)
        scene = _refined(scene, this.shares, required)
        if any(part.has_mesh and part.mesh.n_cells > limits.MOST_ELEMENTS for part in here.parts.values()):
            ended_by = f"{limits.MOST_ELEMENTS} elements"
            break
    return Refinement(best, tuple(rounds), chosen, ended_by)


def _start(scene: Scene, required: float) -> Scene:
    error = max(limits.TIME_SHARE * required, limits.LEAST_ERROR)
    scene = change_simulation(scene, run=(AutoRun(integrator="auto"),), error=error)
    scene = change_modes(scene, lambda body: {"enrich": "ritz" if body.modes.enrich == "ritz" else "inertia"})
    return replace_order(coarsen_meshes(scene) or scene, 2)


def _is_stalled(stated: list[float], required: float, left: int) -> bool:
    """True if the stated error, round by round, stays above the required one through the rounds left."""
    if len(stated) < 3 or stated[-1] <= required:
        return False
    rate: float = (stated[-1] / stated[-3]) ** 0.5
    return rate > limits.STALLED_ERROR and stated[-1] * rate**left > required


def _shares(rows: list[Row]) -> dict[str, float]:
    return {
        source: limits.SAFETY * max(part if isinstance(part := row.parts[source], float) else 0.0 for row in rows)
        for source in NUMERICAL
    }


def _refined(scene: Scene, shares: dict[str, float], required: float) -> Scene:
    too_much = {source: share / (limits.SHARE * required) for source, share in shares.items()}
    mesh = max(too_much["discretisation"], too_much["recovery"]) ** limits.MESH_POWER
    if mesh > 1:
        scene = refine_meshes(scene, min(max(mesh, limits.GENTLEST), limits.BOLDEST)) or scene
    if too_much["truncation"] > 1:
        scene = change_modes(
            scene,
            lambda body: (
                {"enrich": "ritz"}
                if body.modes.enrich == "inertia"
                else {"count": int(limits.MORE_MODES * body.modes.count) + 1}
            ),
        )
    if too_much["time"] > 1:
        scene = change_simulation(scene, error=max(scene.simulation.error / (2 * too_much["time"]), limits.LEAST_ERROR))
    return scene


def _settings(scene: Scene) -> dict[str, Any]:
    meshless = MatrixPart | ReducedPart
    bodies = {
        name: {
            "mesh": None if isinstance(body, meshless) else body.mesh.model_dump(mode="json", exclude_none=True),
            "modes": body.modes.count,
            "enrich": body.modes.enrich,
        }
        for name, body in scene.flexible.items()
    }
    return {"bodies": bodies, "integrator": "auto", "integration_error": scene.simulation.error}


def choose_piece_counts(run: Pipeline) -> Pipeline:
    """Return the run with a number of pieces for each body that leaves it open, or the run itself if none does.

    A body starts with two pieces. While the error of its deflection is above what the scene wants, half of its
    accuracy or 1 % without one, it gets twice as many; so it does where there is no motion with so few.

    Raises
    ------
    InputError
        The mesh is too coarse for the pieces that it takes.
    AccuracyError
        There is no motion, however many pieces.
    """
    counts = {name: FEWEST_PIECES for name, count in run.scene.pieces.items() if count == "auto"}
    if not counts:
        return run
    accuracy = run.scene.accuracy
    required = limits.TOO_LARGE if accuracy is None else accuracy / limits.SAFETY
    while True:
        chosen = run.variant(set_pieces(run.scene, counts), run.store.monitor)
        try:
            errors = {name: find_deflection_error(chosen, name) for name in counts}
        except AccuracyError:
            if max(counts.values()) >= MOST_PIECES_TRIED:
                raise
            errors = dict.fromkeys(counts, 1.0)
        more = {
            name: 2 * counts[name]
            for name, error in errors.items()
            if error > required and counts[name] < MOST_PIECES_TRIED
        }
        if not more:
            return chosen
        try:
            counts |= more
            run.variant(set_pieces(run.scene, counts)).parts  # noqa: B018 - can the meshes be cut so often?
        except InputError as error:
            worst = max(errors, key=lambda name: errors[name])
            problem = f"{counts[worst] // 2} pieces leave an error of {100 * errors[worst]:.2g} % by large deflection"
            raise InputError(run.scene.file, f"body.{worst}.pieces", "auto", f"{problem}; for more, {error}") from error
