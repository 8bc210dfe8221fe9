"""A scene's first run, marched again at other values of its numbers by the same method and the same steps."""

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.limits.fitting import DIFFERENCE, DRAWN_DIFFERENCE, NEAR_DIFFERENCE, SAME_SHAPE
from fmd.dynamics.compiled_system.closed_tangents import LinearisedAnewError
from fmd.dynamics.compiled_system.shared import lift_system
from fmd.dynamics.compiled_system.tangents import Direction
from fmd.dynamics.compiler.program import LANES
from fmd.fitting.neighbours import PartedMarch, find_all_turns, goes_in_parts, march_in_parts, march_neighbours
from fmd.fitting.parameters import Parameter, change_parameters
from fmd.fitting.tangents import Side, Tangent, changes_in_line, find_direction, march_tangents, say_what_lacks_tangents
from fmd.integrators.protocol import Trajectory
from fmd.scene.variants import with_first_run
from fmd.stages.pipeline import Pipeline
from fmd.stages.plan import Plan, repeat_choice
from fmd.stages.runs import plan_frozen


class Change(NamedTuple):
    """Parts of a run that a number changes beside inputs of its equations."""

    solves: bool  # what modes of a body depend on
    lifts: bool  # only what lifted equations take as inputs
    prevents: bool  # which constants are 0, of which lifted equations have no inputs


@dataclass(frozen=True)
class Beside:
    """A scene a little below and above one of its numbers."""

    low: Pipeline
    high: Pipeline
    step: float  # how far below and above [SI]
    plans: tuple[Plan, ...] = ()  # the frozen run at both; none where no motion is needed
    # True if their motions are the scene's own less and more its tangent, so that their difference is exact.
    by_tangents: bool = False
    lacking: str = ""  # what of the run has no tangent where motions are differences
    drawn_back: bool = False  # true if they are drawn back to the scene's own after each part


@dataclass(frozen=True)
class FrozenMotion:
    """A scene at some values of its numbers, with the frozen run as its motion."""

    run: Pipeline
    values: Mapping[Parameter, float]  # the numbers [SI]
    plan: Plan | None = None  # the run; none where no motion is needed
    by: tuple[Parameter, ...] = ()  # numbers that it is differentiated by, whose tangents are marched together
    # Derivatives of the motion by numbers, times their sizes, as far as they have been asked for; ``None`` where there
    # is no tangent.
    tangents: dict[Parameter, Tangent | None] = field(default_factory=dict)
    # Why tangents that have been marched by some numbers aren't those of the motion.
    lacking: dict[Parameter, str] = field(default_factory=dict)
    # The scene beside it, by a number and the share of it: of the last eight numbers, which march together.
    variants: dict[tuple[Parameter, float], Beside] = field(default_factory=dict)
    parts: list[PartedMarch] = field(default_factory=list)  # the run's parts, if they have been needed


class FrozenRun:
    """A run whose method, steps and loads that stiffen stay as they are while numbers of its scene change.

    Output times (n_times,) [s], by default the scene's own, change no step. ``marches`` counts the motions that have
    been computed; eight tangents count as one. A fixed step may be divided into some.
    """

    def __init__(self, run: Pipeline, times: Array | None = None, divided: int = 1) -> None:
        self.run, self._divided = run, divided
        self.marches = 0
        self._times = times
        self._changes: dict[str, Change] = {}  # by the numbers' keys

    @cached_property
    def plan(self) -> Plan:
        """The first run's plan, by the method and the step that an automatic choice ended with, exact enough."""
        plan = repeat_choice(next(iter(self.run.plans.values())), self.run.motion.trajectory)
        method: Any = plan.integrator.differentiable
        return replace(
            plan, integrator=replace(method, step=method.step / self._divided) if self._divided > 1 else method
        )

    @cached_property
    def _lifted(self) -> Plan:
        """The plan by lifted equations."""
        system = lift_system(self.plan.system)
        return replace(self.plan, mechanism=system.mechanism, system=system)

    @property
    def times(self) -> Array:
        """Output times [s], shape (n_times,)."""
        return self.run.output_times if self._times is None else self._times

    def at(
        self, values: Mapping[Parameter, float], moves: bool = True, by: Sequence[Parameter] | None = None
    ) -> FrozenMotion:
        """Return the scene at some values of its numbers [SI], with the frozen run as its motion.

        Bases of finite elements that these numbers change are computed anew. Frequencies alone need no motion. It is
        differentiated by the numbers of ``by``, or of all values.

        Raises
        ------
        InputError
            A body's mesh has other nodes at these values, so that results would jump.
        StabilityError
            The frozen step is too long at these values.
        """
        by = tuple(values) if by is None else tuple(by)
        changes = (
            [self._change(each, values.get(each, each.value)) for each in dict.fromkeys((*values, *by))]
            if moves
            else []
        )
        lifted = any(each.lifts for each in changes) and not any(each.prevents for each in changes)
        other = self._variant(values, moves, lifted)
        if not moves:
            return FrozenMotion(other, values, None, by)
        plan = self._plan(other)
        self._set_motion(other, plan, self._march(plan))
        return FrozenMotion(other, values, plan, by)

    def beside(self, motion: FrozenMotion, parameter: Parameter, share: float = 1.0, moves: bool = True) -> Beside:
        """Return the scene a little below and above one of its numbers, by ``share`` of the usual.

        Where the method carries tangents, and the number doesn't turn shapes into others, both motions are the scene's
        own with its tangent. Else, where neither the method nor the basis of a body stands against it, they are drawn
        back to that between them, so that their difference is the derivative of the steps, too.

        Raises
        ------
        InputError
            The number is 0.
        """
        if not moves:
            return self._variants(motion, parameter, share * NEAR_DIFFERENCE, moves)
        tangent = self._tangent(motion, parameter)
        if tangent is not None:
            return self._move_along(motion, parameter, tangent, share)
        parts, reach = self._parts(motion), self._reach(motion, parameter, DRAWN_DIFFERENCE)
        found = self._variants(motion, parameter, share * reach)
        signs = [signs_of_shapes(run, motion.run) for run in (found.low, found.high)] if parts is not None else []
        known = [each for each in signs if each is not None]
        drawn_back = parts is not None and len(known) == len(found.plans)
        if parts is not None and drawn_back:
            trajectories = march_neighbours(parts, found.plans, known, self.times)
            self.marches += 2
        else:
            found = self._variants(motion, parameter, share * DIFFERENCE)
            trajectories = [self._march(plan) for plan in found.plans]
        assert motion.plan is not None
        lacking = motion.lacking.get(parameter) or say_what_lacks_tangents(motion.plan)
        return replace(self._with_motions(found, trajectories), lacking=lacking, drawn_back=drawn_back)

    def _tangent(self, motion: FrozenMotion, parameter: Parameter) -> Tangent | None:
        """Return a motion's derivative by a number, times its size, if it is to be had; those by others go with it."""
        if parameter not in motion.tangents:
            assert motion.plan is not None
            wanted = [each for each in dict.fromkeys((parameter, *motion.by)) if each not in motion.tangents][:LANES]
            directions = {each: self.direction(motion, each) for each in wanted}
            known = {each: direction for each, direction in directions.items() if direction is not None}
            found = list[Tangent]()
            try:
                with self.run.store.monitor(f"{len(known)} tangents") as advance:
                    found = march_tangents(motion.plan, list(known.values()), self.times, advance)
            except LinearisedAnewError as error:
                motion.lacking.update(dict.fromkeys(known, str(error)))
                known = {}
            self.marches += -(-len(known) // LANES)
            motion.tangents.update(dict.fromkeys(wanted) | dict(zip(known, found, strict=True)))
        return motion.tangents[parameter]

    def direction(self, motion: FrozenMotion, parameter: Parameter) -> Direction | None:
        """Return how the equations change with a number, times its size: by two variants, by four if not in a line."""
        assert motion.plan is not None
        reach = self._reach(motion, parameter)
        far = self._variants(motion, parameter, reach)
        weight = 0.5 / reach
        found = find_direction(motion.plan, self._sides(motion, far, weight))
        if found is None or changes_in_line(motion.plan, found, *far.plans):
            return found
        near = self._variants(motion, parameter, 0.5 * reach)
        sides = self._sides(motion, far, -weight / 3.0) + self._sides(motion, near, 8.0 * weight / 3.0)
        return find_direction(motion.plan, sides)

    def _reach(self, motion: FrozenMotion, parameter: Parameter, near: float = NEAR_DIFFERENCE) -> float:
        """Return how far below and above a number its variants are, as a share of it.

        It is ``near``, or farther where bodies' modes are solved anew, whose round-off is divided by it, as long as
        they stay alike.
        """
        if not self._change(parameter, self._middle(motion, parameter)).solves:
            return near
        far = self._variants(motion, parameter, DIFFERENCE)
        alike = all(signs_of_shapes(run, motion.run) is not None for run in (far.low, far.high))
        return DIFFERENCE if alike else near

    def _change(self, parameter: Parameter, value: float) -> Change:
        """Return what a number changes of a run."""
        if parameter.key not in self._changes:
            own = self._variant({parameter: value}, moves=True)
            other = self._variant({parameter: (1.0 + DIFFERENCE) * value}, moves=True)
            solves = any(part.key("modes") != own.wholes[name].key("modes") for name, part in other.wholes.items())
            lifts, prevents = False, False
            if not solves and own.system.compiled.digest != other.system.compiled.digest:
                mine, its = (lift_system(run.system).compiled for run in (own, other))
                lifts, prevents = mine.digest == its.digest, mine.numbers.size != its.numbers.size
            self._changes[parameter.key] = Change(solves, lifts, prevents)
        return self._changes[parameter.key]

    def _sides(self, motion: FrozenMotion, beside: Beside, weight: float) -> list[Side]:
        pairs = zip((beside.low, beside.high), beside.plans, (-weight, weight), strict=True)
        return [Side(plan, own, signs_of_shapes(run, motion.run)) for run, plan, own in pairs]

    def _move_along(self, motion: FrozenMotion, parameter: Parameter, tangent: Tangent, share: float) -> Beside:
        """Return variants whose motions are the scene's own less and more a part of its tangent."""
        part = share * self._reach(motion, parameter)
        found = self._variants(motion, parameter, part)
        own, mechanism = motion.run.motion.trajectory, motion.run.mechanism
        turns = [find_all_turns(mechanism, signs_of_shapes(run, motion.run) or {}) for run in (found.low, found.high)]
        pairs = zip((-part, part), turns, strict=True)
        moved = [tangent.move(own, side, mechanism, turn) for side, turn in pairs]
        return replace(self._with_motions(found, moved), by_tangents=True)

    def _variants(self, motion: FrozenMotion, parameter: Parameter, share: float, moves: bool = True) -> Beside:
        """Return the scene's stages a share of a number below and above its value."""
        if (parameter, share) not in motion.variants:
            middle = self._middle(motion, parameter)
            numbers = dict.fromkeys(number for number, _ in motion.variants)
            if parameter not in numbers and len(numbers) == LANES:
                for old in [key for key in motion.variants if key[0] == next(iter(numbers))]:
                    del motion.variants[old]
            step = share * abs(middle)
            low, high = (
                self._variant({**motion.values, parameter: middle + side * step}, moves, motion.run.lifted)
                for side in (-1.0, 1.0)
            )
            plans = (self._plan(low), self._plan(high)) if moves else ()
            motion.variants[parameter, share] = Beside(low, high, step, plans)
        return motion.variants[parameter, share]

    def _middle(self, motion: FrozenMotion, parameter: Parameter) -> float:
        middle = motion.values.get(parameter, parameter.value)
        if not middle:
            mend = "is 0, of which there is no per cent; take a small value, such as 1e-3 of the usual one"
            raise InputError(self.run.scene.file, parameter.key, middle, mend)
        return middle

    def _parts(self, motion: FrozenMotion) -> PartedMarch | None:
        """Return the run's parts, beside which others may be marched; none where the method stands against it."""
        if motion.plan is None or not goes_in_parts(motion.plan):
            return None
        if not motion.parts:
            self.marches += 1
            motion.parts.append(march_in_parts(motion.plan, self.times))
        return motion.parts[0] if motion.parts[0].draws_back else None

    def _with_motions(self, found: Beside, trajectories: Sequence[Trajectory]) -> Beside:
        for run, plan, trajectory in zip((found.low, found.high), found.plans, trajectories, strict=True):
            self._set_motion(run, plan, trajectory)
        return found

    def hold_motion(self, motion: FrozenMotion, parameter: Parameter) -> Beside:
        """Return the scene below and above a number, with its own motion at both."""
        own = motion.run.motion.trajectory
        return self._move_along(
            motion, parameter, Tangent(0.0 * own.q, 0.0 * own.v, 0.0 * np.nan_to_num(own.contacts)), 1.0
        )

    def with_motion(self, motion: FrozenMotion, trajectory: Trajectory) -> Pipeline:
        """Return the scene's stages at the numbers of a motion, by another trajectory of the same plan."""
        assert motion.plan is not None
        other = self._variant(motion.values, True, motion.run.lifted)
        self._set_motion(other, motion.plan, trajectory)
        return other

    def _plan(self, run: Pipeline) -> Plan:
        return plan_frozen(self._lifted if run.lifted else self.plan, run)

    def _march(self, plan: Plan) -> Trajectory:
        self.marches += 1
        with self.run.store.monitor("motion") as advance:
            return plan.march(self.times, advance)

    def _variant(self, values: Mapping[Parameter, float], moves: bool, lifted: bool = False) -> Pipeline:
        scene = change_parameters(with_first_run(self.run.scene), values)
        other = self.run.variant(scene, stiffening_loads=self.run.stiffening_loads if moves else None)
        other.lifted = lifted
        require_like_meshes(self.run, other, values)
        return other

    def _set_motion(self, run: Pipeline, plan: Plan, trajectory: Trajectory) -> None:
        run.results[Pipeline.motions.name] = {next(iter(self.run.plans)): run.motion_by(plan, trajectory)}
        run.at_instants = run.at_vibrations = run  # there is no more of the motion than this


def require_like_meshes(run: Pipeline, other: Pipeline, values: Mapping[Parameter, float]) -> None:
    """Raise ``InputError`` unless each body's mesh has the same elements as at other values of numbers."""
    for name, mine in run.wholes.items():
        theirs = other.wholes[name]
        if not mine.has_mesh or mine.key("mesh") == theirs.key("mesh"):
            continue
        if [own.cells.tobytes() for own in mine.mesh.members] != [own.cells.tobytes() for own in theirs.mesh.members]:
            keys = ", ".join(parameter.key for parameter in values)
            mend = f"changes the elements of {name}, so that results jump; fixed divisions or sizes keep them"
            raise InputError(run.scene.file, keys, None, mend)


def signs_of_shapes(run: Pipeline, other: Pipeline) -> dict[str, Array] | None:
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
