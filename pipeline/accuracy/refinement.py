"""A wanted accuracy, met by looking at the error budget and refining what it is made of."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pipeline.accuracy.error_budget import ERROR_BUDGET, Budget
from pipeline.accuracy.error_estimates import SAFETY, SOURCES, Row
from pipeline.core.errors import AccuracyError
from pipeline.scene.imported_bodies import MatrixPart
from pipeline.scene.runs import AutoRun
from pipeline.scene.scene import Scene
from pipeline.scene.variants import (
    change_modes,
    coarsen_meshes,
    refine_meshes,
    replace_error,
    replace_order,
    replace_runs,
)
from pipeline.stages.pipeline import Pipeline

_MOST_ROUNDS = 6
_MOST_ELEMENTS = 20_000
_SHARE = 0.5  # of the wanted accuracy that a source may take
_STALLED = 0.75  # of what is stated is left after each of two rounds, or more: refining doesn't help
_GENTLEST, _BOLDEST = 1.25, 1.7  # refinement of a mesh in one round, each way
_MESH_POWER = 1 / 3  # between the orders of stress and of all else on quadratic elements
_MORE_MODES = 1.6
_TIME_SHARE = 0.05  # of the wanted accuracy, for time integration at the start: it costs the least
_LEAST_ERROR = 1e-10


@dataclass(frozen=True)
class Round:
    """Settings and error budget of one round of refinement.

    Attributes
    ----------
    settings : dict
        Mesh and modes of each flexible body, and the wanted error of the time integration.
    worst : Row
        Quantity with the largest stated error.
    shares : dict of str to float
        Largest share of each source in the stated error of any quantity.
    given_up : tuple of Row
        Quantities that refining hardly improves, and that the others are not refined for.
    """

    settings: dict[str, Any]
    worst: Row
    shares: dict[str, float] = field(default_factory=dict)
    given_up: tuple[Row, ...] = ()

    def summary(self) -> dict[str, Any]:
        """Return the round as plain numbers and texts."""
        found = {"quantity": self.worst.name, "stated": self.worst.total, "dominant": self.worst.dominant}
        given_up = [{"quantity": row.name, "stated": row.total, "dominant": row.dominant} for row in self.given_up]
        return self.settings | {"worst": found, "refined_for": self.shares, "given_up": given_up}


def meet_accuracy(run: Pipeline) -> tuple[Pipeline, tuple[Round, ...]]:
    """Find the first of a row of ever finer runs whose budget states the scene's wanted accuracy or better.

    The first has half of the scene's elements each way, quadratic ones, its modes with the static responses to inertia
    loads, and the automatic integrator. The scene's number of modes is where that of the basis starts; of the
    frequencies only as many count. A quantity whose error two rounds hardly lower is given up: stress at an edge that
    is held has no limit, what a load acts on rings in vibrations beyond any basis. It is reported, not refined for.

    Raises
    ------
    AccuracyError
        It is not met within some rounds, or not on a mesh that can be afforded; the message has the best that was
        measured.
    """
    wanted = run.scene.accuracy
    assert wanted is not None
    scene = _start(run.scene, wanted)
    rounds: list[Round] = []
    stated: list[dict[str, float]] = []
    here = run
    for left in reversed(range(_MOST_ROUNDS)):
        here = here.variant(scene, here.store.monitor)
        rows = _counting(ERROR_BUDGET.of(here), run.scene)
        stated.append({row.name: row.total for row in rows})
        stalled = {name for name in stated[-1] if _is_stalled([past[name] for past in stated], wanted, left)}
        stalled |= {row.name for row in rounds[-1].given_up if row.total > wanted} if rounds else set()
        hopeful = [row for row in rows if row.name not in stalled] or rows
        worst = max(hopeful, key=lambda row: row.total)
        given_up = tuple(row for row in rows if row.name in stalled and row.total > wanted)
        this = Round(_settings(scene), worst, _shares(hopeful), given_up)
        rounds.append(this)
        if worst.total <= wanted:
            return here, tuple(rounds)
        scene = _refined(scene, this.shares, wanted)
        if any(len(part.mesh.cells) > _MOST_ELEMENTS for part in here.parts.values()):
            break
    best = min(rounds, key=lambda each: each.worst.total)
    raise AccuracyError(
        f"{run.scene.file}: accuracy = {wanted:.2%}: not met in {len(rounds)} rounds; the best states "
        f"{best.worst.total:.2%} for '{best.worst.name}', most of it {best.worst.dominant}, with {best.settings}"
    )


def _start(scene: Scene, wanted: float) -> Scene:
    scene = replace_error(replace_runs(scene, AutoRun(integrator="auto")), max(_TIME_SHARE * wanted, _LEAST_ERROR))
    scene = change_modes(scene, lambda body: {"enrich": "ritz" if body.modes.enrich == "ritz" else "inertia"})
    return replace_order(coarsen_meshes(scene) or scene, 2)


def _counting(budget: Budget, scene: Scene) -> list[Row]:
    """Return the rows that count: not those of modes that only serve the basis."""
    asked = {f"{name}, frequency": body.modes.count for name, body in scene.flexible.items()}

    def counts(name: str) -> bool:
        label, _, number = name.rpartition(" ")
        return label not in asked or int(number) <= asked[label]

    return [row for row in budget.rows if counts(row.name)]


def _is_stalled(stated: list[float], wanted: float, left: int) -> bool:
    """True if the stated error, round by round, stays above the wanted one through the rounds left."""
    if len(stated) < 3 or stated[-1] <= wanted:
        return False
    rate: float = (stated[-1] / stated[-3]) ** 0.5
    return rate > _STALLED and stated[-1] * rate**left > wanted


def _shares(rows: list[Row]) -> dict[str, float]:
    """Return the largest share of each source in the stated errors."""
    return {
        source: SAFETY * max(part if isinstance(part := row.parts[source], float) else 0.0 for row in rows)
        for source in SOURCES
    }


def _refined(scene: Scene, shares: dict[str, float], wanted: float) -> Scene:
    """Return the next scene, refined in each source that takes more than its share."""
    too_much = {source: share / (_SHARE * wanted) for source, share in shares.items()}
    mesh = max(too_much["discretisation"], too_much["recovery"]) ** _MESH_POWER
    if mesh > 1:
        scene = refine_meshes(scene, min(max(mesh, _GENTLEST), _BOLDEST)) or scene
    if too_much["truncation"] > 1:
        scene = change_modes(
            scene,
            lambda body: (
                {"enrich": "ritz"}
                if body.modes.enrich == "inertia"
                else {"count": int(_MORE_MODES * body.modes.count) + 1}
            ),
        )
    if too_much["time"] > 1:
        scene = replace_error(scene, max(scene.simulation.error / (2 * too_much["time"]), _LEAST_ERROR))
    return scene


def _settings(scene: Scene) -> dict[str, Any]:
    bodies = {
        name: {
            "mesh": None if isinstance(body, MatrixPart) else body.mesh.model_dump(mode="json", exclude_none=True),
            "modes": body.modes.count,
            "enrich": body.modes.enrich,
        }
        for name, body in scene.flexible.items()
    }
    return {"bodies": bodies, "integrator": "auto", "integration_error": scene.simulation.error}
