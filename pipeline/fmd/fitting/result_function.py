"""Results of a scene as a function of some of its numbers, with its derivatives, for optimisers of one's own.

Weighted sums of histories have theirs by many numbers at once, by the adjoint of the run's march.
"""

from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.arrays import Array, IntArray, require_finite, require_shape
from fmd.core.data_classes import dataclass
from fmd.core.limits.fitting import FEWEST_BY_ADJOINT, LEAST_READ_DIFFERENCE, READ_DIFFERENCE
from fmd.dynamics.compiled_system.closed_tangents import LinearisedAnewError
from fmd.fitting.frozen_run import FrozenMotion, FrozenRun
from fmd.fitting.parameters import Parameter, find_parameter
from fmd.fitting.sensitivities import change_of
from fmd.fitting.tangents import CONTACT, say_what_lacks_tangents
from fmd.integrators import (  # noqa: F401 - register how their steps are taken back
    central_difference_adjoint,
    exponential_adjoint,
    generalized_alpha_adjoint,
    runge_kutta_adjoint,
    subcycling_adjoint,
)
from fmd.integrators.adjoint import NotTakenBackError, pull_back
from fmd.integrators.protocol import Trajectory
from fmd.output.channels import ResultChannel, find_all_channels
from fmd.stages.pipeline import Pipeline


@dataclass
class ResultFunction:
    """Results of a scene as a function of some of its numbers: NumPy in, NumPy out.

    The first run's method and steps are frozen, and so are place and time of a largest value. What has been computed
    for the last numbers is kept, so a value, `jvp` and `vjp` at the same ones cost no more than one Jacobian.

    Attributes
    ----------
    names : dict of str to slice
        Where each result is in the function's value; histories take a place for each output time.
    lacking : str
        Why the last gradient, `vjp`, was by tangents or differences; nothing where it was by the adjoint.
    start : ndarray, shape (n_numbers,)
        The scene's own numbers, in SI units; 1 for a load by a formula or a table, of which it is a factor.

    Raises
    ------
    InputError
        There is no such result or number; derivatives are asked for where a number is 0.
    """

    result: SolvedScene  # what `fmd.load` or `fmd.solve` returns
    of: Sequence[str]  # names of results, as `fmd.output.channels.find_channels` lists them
    to: Sequence[str]  # keys of numbers, as for ``--set``
    _last: dict[bytes, FrozenMotion] = field(default_factory=dict, init=False, repr=False)
    _jacobians: dict[bytes, Array] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        run = self.result.run
        self._parameters = [find_parameter(run.scene, key) for key in dict.fromkeys(self.to)]
        self._channels = find_all_channels(run, self.of)
        self._moves = any(channel.moves for channel in self._channels)
        self._frozen = FrozenRun(run)
        self.lacking = ""
        self.start = np.array([parameter.value for parameter in self._parameters])

    @cached_property
    def names(self) -> dict[str, slice]:
        """Where each result is in the function's value."""
        sizes = [np.size(channel.read(self._frozen.run)) for channel in self._channels]
        ends = np.cumsum(sizes).tolist()
        pairs = zip(self._channels, sizes, ends, strict=True)
        return {channel.name: slice(end - size, end) for channel, size, end in pairs}

    def __call__(self, x: Array) -> Array:
        """Return the results, shape (n_results,), at numbers x, shape (n_numbers,), all in SI units."""
        return self._read(self._motion(x).run)

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives of the results by the numbers, shape (n_results, n_numbers)."""
        motion, key = self._motion(x), np.asarray(x, dtype=float).tobytes()
        if key not in self._jacobians:
            columns = list[Array]()
            with self.result.run.store.monitor("derivatives") as advance:
                for each in self._parameters:
                    columns.append(self._column(motion, each))
                    advance(len(columns) / len(self._parameters))
            self._jacobians = {key: np.column_stack(columns)}
        return self._jacobians[key]

    def jvp(self, x: Array, dx: Array) -> Array:
        """Return how the results change, (n_results,), as the numbers change by dx, (n_numbers,): ``J dx``."""
        dx = np.asarray(dx, dtype=float)
        require_shape("dx", dx, self.start.shape)
        return np.asarray(self.jacobian(x) @ dx)

    def vjp(self, x: Array, weights: Array) -> Array:
        """Return the gradient, (n_numbers,), of the results' weighted sum, weights (n_results,): ``Jᵀ weights``."""
        motion, key, weights = self._motion(x), np.asarray(x, dtype=float).tobytes(), np.asarray(weights, dtype=float)
        require_shape("weights", weights, (max(each.stop for each in self.names.values()),))
        if key in self._jacobians:
            self.lacking = self.lacking or "the Jacobian at these numbers was known"
            return np.asarray(weights @ self._jacobians[key])
        self.lacking = lacks_adjoint(self._frozen, motion, self._parameters, self._channels)
        if self.lacking:
            return np.asarray(weights @ self.jacobian(x))
        try:
            known = find_gradient(self._frozen, motion, self._parameters, self._channels, weights)
        except (LinearisedAnewError, NotTakenBackError) as error:
            self.lacking = str(error)
            return np.asarray(weights @ self.jacobian(x))
        if not known and motion.plan is not None:
            self.lacking = say_what_lacks_tangents(motion.plan)
        others = replace(motion, by=tuple(each for each in self._parameters if each not in known))
        found = (known[each] if each in known else weights @ self._column(others, each) for each in self._parameters)
        return np.array([*found])

    def _motion(self, x: Array) -> FrozenMotion:
        x = np.asarray(x, dtype=float)
        require_shape("x", x, self.start.shape)
        require_finite("x", x)
        key = x.tobytes()
        if key not in self._last:
            pairs = zip(self._parameters, x.tolist(), strict=True)
            values = {parameter: value for parameter, value in pairs if value != parameter.value}
            self._last = {key: self._frozen.at(values, self._moves, self._parameters)}
        return self._last[key]

    def _column(self, motion: FrozenMotion, parameter: Parameter) -> Array:
        both = self._frozen.beside(motion, parameter, moves=self._moves)
        changes = [change_of(channel, motion.run, both.low, both.high) for channel in self._channels]
        own = [each[:1] if channel.part else each for channel, each in zip(self._channels, changes, strict=True)]
        return np.concatenate([np.atleast_1d(each) for each in own]) / (2.0 * both.step)

    def _read(self, run: Pipeline) -> Array:
        return np.concatenate([np.atleast_1d(channel.read(run)) for channel in self._channels])


class HistorySum:
    """Sum of histories with weights (n_channels, n_times) at the output times, as a function of the motion."""

    def __init__(
        self, frozen: FrozenRun, motion: FrozenMotion, channels: Sequence[ResultChannel], weights: Array
    ) -> None:
        self._frozen, self._motion, self._channels, self._weights = frozen, motion, channels, weights
        self._own = motion.run.motion.trajectory

    def is_of_each_time(self) -> bool:
        """Return whether histories depend at each output time on the motion there alone."""
        rng, q, v = np.random.default_rng(0), self._own.q.copy(), self._own.v.copy()
        for moved in (q, v):
            moved[1::2] += READ_DIFFERENCE * rng.normal(size=moved[1::2].shape)
        still, found = (self._read(each)[:, ::2] for each in (self._own, replace(self._own, q=q, v=v)))
        return np.array_equal(still, found)

    def by_motion(self, name: str, places: IntArray) -> Array:
        """Return derivatives by some positions, ``q``, or rates, ``v``, at each output time, (n_times, n_places)."""
        own = getattr(self._own, name)
        found = np.zeros((len(own), len(places)))
        for column, place in enumerate(places):
            step = max(READ_DIFFERENCE * np.abs(own[:, place]).max(), LEAST_READ_DIFFERENCE)
            unit = step * np.eye(1, own.shape[1], place)
            low, high = (self._read(replace(self._own, **{name: own + side * unit})) for side in (-1.0, 1.0))
            found[:, column] = (self._weights * (high - low)).sum(axis=0) / (2.0 * step)
        return found

    def by_number(self, parameter: Parameter) -> float:
        """Return the derivative by a number, times its size, where the motion stays as it is."""
        both = self._frozen.hold_motion(self._motion, parameter)
        low, high = (self._histories(run) for run in (both.low, both.high))
        size = abs(self._motion.values.get(parameter, parameter.value))
        return float((self._weights * (high - low)).sum() * size / (2.0 * both.step))

    def _read(self, trajectory: Trajectory) -> Array:
        """Return the histories of a motion, (n_channels, n_times)."""
        return self._histories(self._frozen.with_motion(self._motion, trajectory))

    def _histories(self, run: Pipeline) -> Array:
        return np.array([channel.read(run) for channel in self._channels])


def find_gradient(
    frozen: FrozenRun,
    motion: FrozenMotion,
    parameters: Sequence[Parameter],
    channels: Sequence[ResultChannel],
    weights: Array,
) -> dict[Parameter, float]:
    """Find derivatives [1/SI] of a weighted sum of histories by many numbers, by the adjoint of the march.

    Weights (n_channels · n_times,) are of the histories' values, one after the other, of which nothing `lacks_adjoint`.
    Numbers that turn a body's shapes into others are left out.
    """
    total, plan = HistorySum(frozen, motion, channels, weights.reshape(len(channels), -1)), motion.plan
    pairs = ((each, frozen.direction(motion, each)) for each in parameters)
    found = {each: (direction, total.by_number(each)) for each, direction in pairs if direction is not None}
    if not found or plan is None:
        return {}
    (system, q0, v0), part = plan.marched, plan.excited
    positions, rates = (np.arange(each.size) for each in plan.start)
    if part is not None and plan.excited_system is not None:
        positions, rates = positions[part.positions], rates[part.rates]
    by_q, by_v = total.by_motion("q", positions), total.by_motion("v", rates)
    directions = [direction for direction, _ in found.values()]
    along = pull_back(plan.integrator, system, q0, v0, frozen.times, by_q, by_v, directions)
    frozen.marches += 1
    sizes = [abs(motion.values.get(key, key.value)) for key in found]
    changes = (x + own for x, (_, own) in zip(along, found.values(), strict=True))
    return {key: float(change) / size for key, change, size in zip(found, changes, sizes, strict=True)}


def lacks_adjoint(
    frozen: FrozenRun, motion: FrozenMotion, parameters: Sequence[Parameter], channels: Sequence[ResultChannel]
) -> str:
    """Return why a gradient of histories by numbers is not by the adjoint of the march, but by tangents, or nothing."""
    plan, count = motion.plan, len(parameters)
    if plan is None or any(channel.part or not channel.moves for channel in channels):
        return "results that are no histories"
    if count < FEWEST_BY_ADJOINT:
        return f"{count} numbers: tangents are as quick for less than {FEWEST_BY_ADJOINT}"
    system = plan.marched[0]
    if not (system.has_tangents and plan.integrator.carries_tangent(system, [system])):
        return say_what_lacks_tangents(plan)
    if plan.mechanism.contacts:
        return CONTACT
    if plan.mechanism.held or plan.mechanism.states:
        return "states of controllers and of filters"
    if any(np.ndim(channel.read(motion.run)) == 0 for channel in channels):
        return "results that are no histories"
    own = HistorySum(frozen, motion, channels, np.zeros((len(channels), len(frozen.times))))
    return "" if own.is_of_each_time() else "results that depend on several times at once"
