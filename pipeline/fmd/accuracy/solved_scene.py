"""The way from a scene to its results: stages of the scene with the settings that its accuracy takes."""

from collections.abc import Callable
from dataclasses import field
from functools import cached_property
from typing import Any

from fmd.core.cache import Cache
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.progress import Monitor, silent
from fmd.scene.scene import Scene
from fmd.stages.pipeline import Pipeline
from fmd.stages.stage import ALL_PACKAGES, ALL_SOURCES, Stage

Changes = dict[str, Any]
"""Values of a table by their keys."""


@dataclass(frozen=True)
class Settings:
    """Values of the settings that a scene leaves open."""

    # Changes of the flexible bodies' tables: pieces, meshes and modes.
    bodies: dict[str, Changes] = field(default_factory=dict)
    simulation: Changes = field(default_factory=dict)  # changes of the simulation's table: integrator and error
    # Rounds of refinement as ``summary.json`` has them; empty without a required accuracy.
    refinement: dict[str, Any] = field(default_factory=dict)
    unmet: str = ""  # what a required accuracy lacks; empty if it is met
    lasting: bool = True  # false if another machine, or more memory, may find other settings

    def apply(self, scene: Scene) -> Scene:
        """Return a scene with these settings."""
        bodies = {name: scene.body[name].model_copy(update=changes) for name, changes in self.bodies.items()}
        simulation = scene.simulation.model_copy(update=self.simulation)
        return scene.model_copy(update={"body": {**scene.body, **bodies}, "simulation_table": simulation})


def _choose(given: Pipeline, keep: Callable[[Pipeline], None] = lambda run: None) -> Settings:
    """Choose numbers of pieces, and refine for a required accuracy; ``keep`` takes the run that has these settings."""
    from fmd.accuracy.refinement import choose_piece_counts, meet_accuracy

    run = choose_piece_counts(given)
    found = None if given.scene.accuracy is None else meet_accuracy(run)
    run = run if found is None else found.run
    keep(run)
    before, after = given.scene, run.scene
    bodies = {name: _changes(body, after.body[name]) for name, body in before.flexible.items()}
    simulation = _changes(before.simulation, after.simulation)
    if found is None:
        return Settings(bodies, simulation)
    return Settings(bodies, simulation, found.summary(), found.unmet, not found.failed)


def _changes(before: Any, after: Any) -> Changes:
    return {key: getattr(after, key) for key in type(after).model_fields if getattr(after, key) != getattr(before, key)}


SETTINGS: Stage[Settings] = Stage(
    "accuracy",
    _choose,
    inputs=lambda run: run.inputs,
    sources=ALL_SOURCES,
    packages=ALL_PACKAGES,
    lasts=lambda settings: settings.lasting,
)
"""Stage of a scene as it is given: the settings that it is computed with."""


class SolvedScene:
    """A scene and the stages that its results come from, which run on first use.

    Arguments are those of `Pipeline`, and stages of a scene with the same flexible bodies, whose results of these are
    taken. ``given`` are the stages of the scene as it is written; results are those of `run`.
    """

    def __init__(
        self,
        scene: Scene,
        cache: Cache | None = None,
        monitor: Monitor = silent,
        keep_all: bool = False,
        like: Pipeline | None = None,
    ) -> None:
        self.scene = scene
        self.given = Pipeline(scene, cache, monitor, keep_all) if like is None else like.variant(scene, monitor)

    @property
    def is_open(self) -> bool:
        """True if the scene leaves settings to its accuracy, or to large deflections."""
        return self.scene.accuracy is not None or "auto" in self.scene.pieces.values()

    @property
    def is_settled(self) -> bool:
        """True if the settings of the stages are known without computing."""
        known = "run" in vars(self) or not self.is_open
        return known or self.given.store.cache.holds(SETTINGS.key(self.given))

    @cached_property
    def run(self) -> Pipeline:
        """Stages of the scene as it is computed: with numbers of pieces, and refined to the required accuracy.

        Raises
        ------
        InputError, AccuracyError
            As `choose_piece_counts` and `meet_accuracy`; or the scene wants an accuracy of no motion.
        """
        given = self.given
        if not self.is_open:
            return given
        if not self.scene.moves:
            mend = "is met by refining for the results of a motion; a scene without simulation has none: leave it out"
            raise InputError(self.scene.file, "accuracy", self.scene.accuracy, mend)
        made: list[Pipeline] = []
        settings = SETTINGS.of(given, lambda run: _choose(run, made.append))
        run = made[0] if made else given.variant(settings.apply(self.scene), given.store.monitor)
        for name, seconds in given.log.seconds.items():  # of rounds, but for what the last one has in its own log
            own = sum(run.log.seconds.values()) if made else 0.0
            run.log.add(name, max(seconds - own, 0.0), run.log.run if made else run.log.cached)
        return run

    @property
    def settings(self) -> Settings:
        """Values of the settings that the scene leaves open; raises as `run`."""
        self.run  # noqa: B018 - finds them
        return SETTINGS.of(self.given) if self.is_open else Settings()
