"""A scene's first run, marched again at other values of its numbers by the same method and the same steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.fitting import DIFFERENCE, NEAR_DIFFERENCE, SAME_SHAPE
from fmd.fitting.neighbours import PartedMarch, goes_in_parts, march_in_parts, march_neighbours
from fmd.fitting.parameters import Parameter, change_parameters
from fmd.integrators.protocol import Trajectory
from fmd.scene.variants import change_simulation
from fmd.stages.pipeline import Pipeline
from fmd.stages.plan import Plan, repeat_choice
from fmd.stages.runs import plan_frozen


@dataclass(frozen=True)
class FrozenMotion:
    """A scene at some values of its numbers, with the frozen run as its motion.

    Attributes
    ----------
    run : Pipeline
        The scene's stages.
    values : dict of Parameter to float
        The numbers [SI].
    parts : PartedMarch, optional
        The run's parts, beside which others may be marched.
    """

    run: Pipeline
    values: Mapping[Parameter, float]
    parts: PartedMarch | None = None


class FrozenRun:
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

    def at(self, values: Mapping[Parameter, float], moves: bool = True) -> FrozenMotion:
        """Return the scene at some values of its numbers [SI], with the frozen run as its motion.

        Bases of finite elements that these numbers change are computed anew.

        Parameters
        ----------
        moves : bool
            False where no motion is needed: of frequencies alone.

        Raises
        ------
        InputError
            A body's mesh has other nodes at these values, so that results would jump.
        StabilityError
            The frozen step is too long at these values.
        """
        other = self._variant(values, moves)
        if not moves:
            return FrozenMotion(other, values)
        plan = plan_frozen(self.plan, other)
        parts = march_in_parts(plan, self.times) if goes_in_parts(plan) else None
        self._set_motion(other, plan, plan.march(self.times) if parts is None else parts.trajectory)
        return FrozenMotion(other, values, parts if parts is not None and parts.draws_back else None)

    def beside(
        self, motion: FrozenMotion, parameter: Parameter, share: float = 1.0, moves: bool = True
    ) -> tuple[Pipeline, Pipeline, float]:
        """Return the scene a little below and above one of its numbers, and by how much above [SI].

        Where neither the method nor the basis of a body stands against it, both motions are drawn back to that between
        them, so that their difference is the derivative of the steps.

        Parameters
        ----------
        share : float
            How far, of the usual.
        """
        middle = motion.values.get(parameter, parameter.value)

        def variants(step: float) -> list[Pipeline]:
            return [self._variant({**motion.values, parameter: middle + side * step}, moves) for side in (-1.0, 1.0)]

        step = share * NEAR_DIFFERENCE * abs(middle)
        low, high = variants(step)
        signs = [_signs_of_shapes(run, motion.run) for run in (low, high)] if motion.parts is not None else [None]
        if moves and None in signs:
            step = share * DIFFERENCE * abs(middle)
            low, high = variants(step)
        if moves:
            plans = [plan_frozen(self.plan, run) for run in (low, high)]
            known = [each for each in signs if each is not None]
            if motion.parts is not None and len(known) == len(plans):
                trajectories = march_neighbours(motion.parts, plans, known, self.times)
            else:
                trajectories = [plan.march(self.times) for plan in plans]
            for run, plan, trajectory in zip((low, high), plans, trajectories, strict=True):
                self._set_motion(run, plan, trajectory)
        return low, high, step

    def _variant(self, values: Mapping[Parameter, float], moves: bool) -> Pipeline:
        scene = self.run.scene
        if scene.moves:
            scene = change_simulation(scene, run=scene.simulation.run[:1])
        scene = change_parameters(scene, values)
        other = self.run.variant(scene, stiffening_loads=self.run.stiffening_loads if moves else None)
        require_like_meshes(self.run, other, values)
        return other

    def _set_motion(self, run: Pipeline, plan: Plan, trajectory: Trajectory) -> None:
        run.results[Pipeline.motions.name] = {next(iter(self.run.plans)): run.motion_by(plan, trajectory)}


def require_like_meshes(run: Pipeline, other: Pipeline, values: Mapping[Parameter, float]) -> None:
    """Raise ``InputError`` unless each body's mesh has the same elements as at other values of numbers."""
    for name, mine in run.wholes.items():
        theirs = other.wholes[name]
        if not mine.has_mesh or mine.key("mesh") == theirs.key("mesh"):
            continue
        if not np.array_equal(mine.mesh.cells, theirs.mesh.cells):
            keys = ", ".join(parameter.key for parameter in values)
            mend = f"changes the elements of {name}, so that results jump; a mesh of hexahedra by divisions keeps them"
            raise InputError(run.scene.file, keys, None, mend)


def _signs_of_shapes(run: Pipeline, other: Pipeline) -> dict[str, Array] | None:
    """Return by what to multiply modal coordinates of reduced bodies for those of another scene, 1 or -1 each.

    ``None`` if shapes differ by more than their sign and a little: they have turned into each other, or changed places.
    """
    signs = {}
    for name, body in run.bodies.items():
        mine, theirs = body.shapes, other.bodies[name].shapes
        if mine.shape != theirs.shape:
            return None
        signs[name] = np.where((mine * theirs).sum(axis=(0, 1)) < 0.0, -1.0, 1.0)
        apart, size = (np.sqrt((x**2).sum(axis=(0, 1))) for x in (signs[name] * mine - theirs, theirs))
        if (apart > SAME_SHAPE * size).any():
            return None
    return signs
