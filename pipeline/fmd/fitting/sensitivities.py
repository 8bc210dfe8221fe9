"""Derivatives of results by numbers of a scene."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.limits.fitting import BETWEEN_EXTRAPOLATIONS, JUMP
from fmd.core.limits.modes import SAME_FREQUENCY
from fmd.fitting.frozen_run import Beside, FrozenMotion, FrozenRun, signs_of_shapes
from fmd.fitting.parameters import Parameter, find_parameter
from fmd.fitting.tangents import CONTACT
from fmd.output.channels import ResultChannel, find_all_channels
from fmd.stages.part import FlexiblePart
from fmd.stages.pipeline import Pipeline


def frequency_change(run: Pipeline, minus: Pipeline, plus: Pipeline, body: str, mode: int) -> Array:
    """Return the change of a frequency [Hz] as stiffness and mass go from those of one variant to those of another.

    That is ``δω² = φᵀ (δK − ω² δM) φ + 2 φᵀ (K − ω² M) δφ`` for a mode with unit modal mass (Fox & Kapoor, AIAA J 6,
    1968); the second term is of modes that a joint holds, by its forces. Modes of one frequency turn into each other:
    their changes are the eigenvalues of this matrix for the whole group, in ascending order (Mills-Curran, AIAA J 26,
    1988). The variants have the run's nodes; modes are numbered from 0. Returned are the mode's change, the mean change
    of its group, and the same from the variants' own modes, as a check.
    """
    part, before, after = (each.wholes[body] for each in (run, minus, plus))
    if before.key("modes") == after.key("modes"):
        return np.zeros(3)
    omega, shapes = part.modes.omega, part.modes.shapes
    group = np.flatnonzero(np.abs(omega - omega[mode]) <= SAME_FREQUENCY * omega[mode])
    Phi = shapes[:, :, group].reshape(-1, len(group))
    stiffer = after.fe.stiffness_of(Phi) - before.fe.stiffness_of(Phi)
    heavier = Phi.T @ ((after.fe.M - before.fe.M) @ Phi)
    change = stiffer - omega[mode] ** 2 * heavier
    held = (part.fe.K @ Phi - omega[mode] ** 2 * (part.fe.M @ Phi)).T  # forces of what holds modes, as a joint
    moved = _align(part, after, Phi, group) - _align(part, before, Phi, group)
    change = change + 2.0 * held @ moved
    changes = np.linalg.eigvalsh(0.5 * (change + change.T)) / (2.0 * omega[mode] * 2.0 * np.pi)
    solved = (after.modes.frequencies_hz - before.modes.frequencies_hz)[group]
    return np.array([changes[int(np.flatnonzero(group == mode)[0])], changes.mean(), solved.mean()])


def _align(part: FlexiblePart, other: FlexiblePart, Phi: Array, group: IntArray) -> Array:
    """Return modes of a variant, turned within their group to be nearest to those of the scene itself."""
    theirs = other.modes.shapes[:, :, group].reshape(Phi.shape)
    u, _, v = np.linalg.svd(theirs.T @ (part.fe.M @ Phi))
    return np.asarray(theirs @ (u @ v))


UNSTATED = "elements' error changes with the dimension, most at curved edges; compare with a finer mesh.size"


@dataclass(frozen=True)
class Sensitivity:
    """Derivative of one result by one number of a scene."""

    channel: ResultChannel  # the result
    parameter: Parameter  # the number
    value: Array  # () or (n_times,): the result itself, in its SI unit
    slope: Array  # () or (n_times,): its derivative by the number, in SI units
    error: Array  # () or (n_times,): what the derivative may be off by, in SI units; NaN if that is `unstated`
    # True if the largest value is at another place, or long before or after, as soon as the number changes a little.
    jumps: bool = False
    # True if it is by the motion's tangent, which is marched beside it, not by a difference of motions.
    by_tangents: bool = False
    lacking: str = ""  # what of the run has no tangents otherwise
    unstated: str = ""  # why there is no error, if there is none

    @property
    def relative(self) -> float:
        """Per cent of the result per per cent of the number; of a history the ratio of root mean squares over time."""
        return self._share(self.slope)

    @property
    def relative_error(self) -> float:
        """Possible error of `relative`."""
        return abs(self._share(self.error))

    @property
    def change(self) -> float:
        """Change of the result in its unit as the number doubles, if it went on as it begins."""
        return self.parameter.value * mean_change(self.slope)

    def _share(self, slope: Array) -> float:
        size = mean_change(self.value)
        change = (abs(self.parameter.value) if self.value.ndim else self.parameter.value) * mean_change(slope)
        return change / size + 0.0 if size else (0.0 if not change else float(np.copysign(np.inf, change)))

    def row(self) -> dict[str, Any]:
        """Return the figures by name; a history's value, derivative and error are root mean squares over time."""
        size, slope, error = (mean_change(x) for x in (self.value, self.slope, self.error))
        share, off = self.relative, self.relative_error
        return {
            "of": self.channel.name,
            "to": self.parameter.key,
            "value": size,
            "unit": self.channel.unit,
            "history": bool(self.value.ndim),
            "number": self.parameter.value,
            "number_unit": self.parameter.unit,
            "derivative": slope,
            "derivative_error": None if self.unstated else error,
            "relative": share if np.isfinite(share) else None,
            "interval": [share - off, share + off] if np.isfinite(share) and not self.unstated else None,
            "jumps": self.jumps,
            "by_tangents": self.by_tangents,
            "lacking": self.lacking,
            "unstated": self.unstated,
        }


def jacobian(result: SolvedScene, of: Sequence[str], to: Sequence[str]) -> list[Sensitivity]:
    """Return the derivatives of results by numbers of a scene, the numbers of each result together.

    Results are those of the scene's first run, whose method and steps are frozen; a largest value is followed where and
    when it is largest. Derivatives are extrapolated from central differences of two lengths; the stated error is what
    the extrapolation changes, in contact also twice what half the steps do. Those of frequencies are Rayleigh
    quotients, also within groups of one frequency; the stated error is their difference from those of the frequencies
    solved anew.

    Parameters
    ----------
    result : SolvedScene
        What `fmd.load` or `fmd.solve` returns.
    of : sequence of str
        Names of results, as `fmd.output.channels.find_channels` lists them.
    to : sequence of str
        Keys of numbers, as for ``--set``, e.g. ``joint.elbow.spring``.

    Raises
    ------
    InputError
        There is no such result or number.
    """
    run = result.run
    parameters = [find_parameter(run.scene, key) for key in dict.fromkeys(to)]
    channels = find_all_channels(run, of)
    frozen, moves = FrozenRun(run), any(channel.moves for channel in channels)
    by_parameter, finer = [], FrozenRun(run, divided=2)
    with run.store.monitor("derivatives") as advance:
        motion, finer_motion = frozen.at({}, moves, parameters), None
        for parameter in parameters:
            rows = list(_differentiate(frozen, motion, channels, parameter))
            if run.scene.contact and any(row.by_tangents for row in rows):
                finer_motion = finer_motion or finer.at({}, moves, parameters)
                others = _differentiate(finer, finer_motion, channels, parameter)
                rows = [_with_error_by_steps(*pair) for pair in zip(rows, others, strict=True)]
            by_parameter.append(rows)
            advance(len(by_parameter) / len(parameters))
    return [row for rows in zip(*by_parameter, strict=True) for row in rows]


def _differentiate(
    frozen: FrozenRun, motion: FrozenMotion, channels: Sequence[ResultChannel], parameter: Parameter
) -> Iterator[Sensitivity]:
    """Yield the derivative of each result by one number."""
    moves = any(channel.moves for channel in channels)
    pairs = [frozen.beside(motion, parameter, share, moves) for share in (1.0, 0.5)]
    unknown = _find_round_off(frozen.run, pairs, pairs[0].step / abs(parameter.value)) if moves else 0.0
    takes_wider = moves and (pairs[0].drawn_back or pairs[0].lacking.startswith(CONTACT))
    wider = [frozen.beside(motion, parameter, 2.0), pairs[0]] if takes_wider else []
    for channel in channels:
        value = np.asarray(channel.read(frozen.run))
        if not np.isfinite(value).all():
            raise InputError("--of", channel.name, None, "is without end: this motion does no damage")
        slope, rough = _extrapolate(pairs, [change_of(channel, frozen.run, each.low, each.high) for each in pairs])
        if channel.part:
            slope, mean, solved = slope
            yield Sensitivity(channel, parameter, value, slope, np.abs(mean - solved))
        else:
            near, error = pairs[1], np.abs(slope - rough)
            if channel.moves and wider:
                other, widest = _extrapolate(wider, [change_of(channel, frozen.run, e.low, e.high) for e in wider])
                if near.drawn_back:
                    error = np.full(slope.shape, BETWEEN_EXTRAPOLATIONS * np.abs(slope - other).max())
                else:  # contact begins and ends at steps, so that two distances may agree by chance
                    error = error + np.abs(slope - widest).max()
            if channel.moves:
                error = error + unknown * np.abs(slope).max()
            by_stress, by_script = channel.unit == "Pa" or channel.shortest, ".mesh.parameter." in parameter.key
            if unstated := UNSTATED if by_stress and by_script else "":
                error = np.full(slope.shape, np.nan)
            jumps = _jumps(channel, frozen.run, near.low, near.high, share=near.step / abs(parameter.value))
            yield Sensitivity(channel, parameter, value, slope, error, jumps, near.by_tangents, near.lacking, unstated)


def _with_error_by_steps(row: Sensitivity, finer: Sensitivity) -> Sensitivity:
    """Return a derivative with the error of steps in which points press and part, of first order, by half the steps."""
    if not row.by_tangents:
        return row
    return replace(row, error=row.error + 2.0 * np.abs(row.slope - finer.slope).max())


def _extrapolate(pairs: Sequence[Beside], changes: Sequence[Array]) -> tuple[Array, Array]:
    """Return the derivative by changes over two steps, the longer one first, and that of the longer step alone."""
    rough, fine = (change / (2.0 * each.step) for change, each in zip(changes, pairs, strict=True))
    ratio = (pairs[0].step / pairs[1].step) ** 2
    return (ratio * fine - rough) / (ratio - 1.0), rough


def _find_round_off(run: Pipeline, pairs: Sequence[Beside], share: float) -> float:
    """Return which part of derivatives by a number may be round-off of bodies' modes that are solved anew beside it.

    Of what is smooth a second difference is a quarter of that over twice the distance. What squared frequencies, or a
    shape, have beside this is round-off; over the longer distance, a share of the number, it is as large in first ones.
    """
    largest = 0.0
    for name, own in run.bodies.items():
        if run.parts[name].key("modes") == pairs[0].low.parts[name].key("modes"):
            continue
        squares, shapes = np.zeros(own.omega.shape), np.zeros(own.shapes.shape)
        for weight, beside in zip((-0.25, 1.0), pairs, strict=True):
            for each in (beside.low, beside.high):
                if (signs := signs_of_shapes(each, run)) is None:
                    return largest
                squares += weight * ((each.bodies[name].omega / own.omega) ** 2 - 1.0)
                shapes += weight * (signs[name] * each.bodies[name].shapes - own.shapes)
        sizes = np.sqrt((shapes**2).sum(axis=(0, 1)) / (own.shapes**2).sum(axis=(0, 1)))
        largest = max(largest, float(max(np.abs(squares).max(), sizes.max())) / share)
    return largest


def change_of(channel: ResultChannel, run: Pipeline, minus: Pipeline, plus: Pipeline) -> Array:
    """Return the change of a result from one variant to another; that of a frequency is `frequency_change`'s."""
    if channel.part:
        return frequency_change(run, minus, plus, channel.part, channel.mode)
    return np.asarray(channel.read(plus) - channel.read(minus))


def _jumps(channel: ResultChannel, *variants: Pipeline, share: float) -> bool:
    """Return whether a largest value grows at another place or time by more than where it is followed."""
    if channel.largest is not None:
        return any(channel.largest(each) > float(channel.read(each)) * (1.0 + JUMP * share) for each in variants)
    if channel.shortest is not None:
        return any(channel.shortest(each) * (1.0 + JUMP * share) < float(channel.read(each)) for each in variants)
    return False


def mean_change(values: Array) -> float:
    """Return a number itself, or of a history the root mean square over time."""
    return float(values) if not values.ndim else float(np.sqrt(np.mean(np.square(values))))
