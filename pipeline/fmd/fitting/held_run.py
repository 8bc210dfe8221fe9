"""A scene's first run, marched again at other values of its numbers by the same method and the same steps."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.fitting.parameters import Parameter, change_parameters
from fmd.scene.variants import change_simulation
from fmd.stages.pipeline import Pipeline
from fmd.stages.plan import Plan, repeat_choice
from fmd.stages.runs import plan_held


class HeldRun:
    """A run whose method, steps and loads that stiffen stay as they are while numbers of its scene change.

    Parameters
    ----------
    run : Pipeline
        Stages of the scene as it is computed.
    times : ndarray, shape (n_times,), optional
        Output times [s]; the scene's own by default. They change no step.
    """

    def __init__(self, run: Pipeline, times: Array | None = None) -> None:
        self.run = run
        self._times = times

    @cached_property
    def plan(self) -> Plan:
        """The first run's plan, by the method and the step that an automatic choice ended with."""
        return repeat_choice(next(iter(self.run.plans.values())), self.run.motion.trajectory)

    @property
    def times(self) -> Array:
        """Output times [s], shape (n_times,)."""
        return self.run.output_times if self._times is None else self._times

    def at(self, values: Mapping[Parameter, float], moves: bool = True) -> Pipeline:
        """Return the stages of the scene at other values of its numbers [SI], with the held run as its motion.

        Bases of finite elements that these numbers change are computed anew.

        Parameters
        ----------
        moves : bool
            False where no motion is wanted: of frequencies alone.

        Raises
        ------
        InputError
            A body's mesh has other nodes at these values, so that results would jump.
        StabilityError
            The held step is too long at these values.
        """
        scene = self.run.scene
        if scene.moves:
            scene = change_simulation(scene, run=scene.simulation.run[:1])
        scene = change_parameters(scene, values)
        loads = self.run.stiffening_loads if moves else None
        other = self.run.variant(scene, stiffening_loads=loads)
        for name in self.run.wholes:
            self._require_like_mesh(other, name, values)
        if moves:
            plan = plan_held(self.plan, other)
            motion = other.motion_by(plan, plan.march(self.times))
            other.results[Pipeline.motions.name] = {next(iter(self.run.plans)): motion}
        return other

    def _require_like_mesh(self, other: Pipeline, name: str, values: Mapping[Parameter, float]) -> None:
        """Raise ``InputError`` unless a body's mesh has the same elements as that of the run, if it has a mesh."""
        mine, theirs = self.run.wholes[name], other.wholes[name]
        if not mine.has_mesh or mine.key("mesh") == theirs.key("mesh"):
            return
        if not np.array_equal(mine.mesh.cells, theirs.mesh.cells):
            keys = ", ".join(parameter.key for parameter in values)
            mend = f"changes the elements of {name}, so that results jump; a mesh of hexahedra by divisions keeps them"
            raise InputError(self.run.scene.file, keys, None, mend)
