"""Loads and prescribed motions of a scene as signals, checked over the whole duration before anything is built."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.errors import InputError
from fmd.core.formula import parse_formula
from fmd.core.limits import loads as limits
from fmd.core.limits.scene import CLOSES
from fmd.dynamics.signals.activity import find_activity
from fmd.dynamics.signals.signal import Signal, constant, formula, linear_table, smooth_table
from fmd.scene.curves import TimeFunction
from fmd.scene.loads import JointDrive, MotionDrive

if TYPE_CHECKING:
    from fmd.scene.scene import Scene


def signal_of(given: TimeFunction, until: float = 0.0) -> Signal:
    """Make the signal of a scene's quantity over time, in SI units; a table may repeat up to a time [s].

    Of a formula of the motion it is 0; that is a `StateFunction`.
    """
    if given.state is not None:
        return constant(0.0)
    if given.constant is not None:
        return constant(given.constant)
    if given.formula is not None:
        return formula(parse_formula(given.formula), given.factor)
    times, values = np.array(given.times), given.factor * np.array(given.values)
    return (smooth_table if given.smooth else linear_table)(times, values, given.beyond or "hold", until)


def require_sound_drives(scene: Scene) -> None:
    """Check that every load is finite and every prescribed motion continuous over a scene's duration.

    Raises
    ------
    InputError
        A formula has no finite value at some time, or a motion's position or rate jumps; the message names the drive,
        the time and the remedy.
    """
    assert scene.simulation is not None
    for path, given, moves in _formulas(scene):
        signal = signal_of(given)
        if (time := _time_without_value(signal, scene.simulation.duration, 3 if moves else 1)) is not None:
            raise InputError(scene.file, path, given.formula, _describe_fault(signal, time, moves))
        if moves:
            _require_continuous(scene, path, given, signal)
    for path, given, _ in _formulas(scene, of_time=False):
        for part in given.state.variables if given.state else ():
            signal = constant(0.0) if isinstance(part, str) else formula(part)
            if (time := _time_without_value(signal, scene.simulation.duration, 1)) is not None:
                raise InputError(scene.file, path, given.formula, _describe_fault(signal, time, False))


def find_idle_drives(scene: Scene) -> list[str]:
    """List the forces and torques over time that are 0 up to the scene's end, by their drives' names."""
    assert scene.simulation is not None
    end, idle = scene.simulation.duration, []
    for name, drive in scene.drive.items():
        given = drive.load if isinstance(drive, JointDrive) else drive.size
        if given is not None and given.state is not None:
            continue
        if given is not None and given.constant is None:
            rests = bool(find_activity(signal_of(given, end), end).quiet.all())
        else:
            rests = isinstance(drive, JointDrive) and drive.rests_until(end)
        if rests:
            idle.append(name)
    return idle


def find_jumping_tables(scene: Scene) -> list[tuple[str, float]]:
    """List the tables that repeat and don't close, by their drives' names, with the jumps over the largest values."""
    return [
        (name, value.gap)
        for name, drive in scene.drive.items()
        for _, value in drive
        if isinstance(value, TimeFunction) and value.beyond == "repeat" and value.gap > CLOSES
    ]


def _formulas(scene: Scene, of_time: bool = True) -> Iterator[tuple[str, TimeFunction, bool]]:
    """Go through the formulas of all drives, of time or of the motion, with their paths; True for motions."""
    for name, drive in scene.drive.items():
        for key, given in drive:
            if isinstance(given, TimeFunction) and given.formula is not None and (given.state is None) is of_time:
                yield f"drive.{name}.{key}", given, isinstance(drive, MotionDrive)


def _time_without_value(signal: Signal, duration: float, n_derivatives: int) -> float | None:
    """Return a time at which a signal or a needed derivative isn't finite, None if there is none [s]."""
    inside = [
        at for time in signal.breakpoints for at in (np.nextafter(time, -np.inf), time, np.nextafter(time, np.inf))
    ]
    times = np.unique(
        [*np.linspace(0.0, duration, limits.DRIVE_SAMPLES), *(at for at in inside if 0.0 <= at <= duration)]
    )
    sizes = np.abs(signal.values(times)[:, :n_derivatives])
    if (bad := np.flatnonzero(~np.isfinite(sizes).all(axis=1))).size:
        return float(times[bad[0]])
    largest = sizes[:, 0]
    padded = np.r_[-1.0, largest, -1.0]
    tops = np.flatnonzero((padded[1:-1] > padded[:-2]) & (padded[1:-1] >= padded[2:]))
    for top in tops[np.argsort(-largest[tops])][: limits.PEAKS]:
        around = times[max(top - 1, 0)], times[min(top + 1, len(times) - 1)]
        if (pole := _find_pole(signal, float(times[top]), *map(float, around))) is not None:
            return pole
    return None


def _find_pole(signal: Signal, at: float, low: float, high: float) -> float | None:
    """Look for a pole about a local maximum between two other times, where values grow at every halving [s]."""
    sizes = []
    for _ in range(limits.POLE_HALVINGS):
        points = np.array([low, 0.5 * (low + at), at, 0.5 * (at + high), high])
        values = np.abs(signal.values(points[1:4])[:, 0])
        if not np.isfinite(values).all():
            return float(points[1 + np.argmin(np.isfinite(values))])
        k = int(values.argmax())
        low, at, high = (float(point) for point in points[k : k + 3])
        sizes.append(values[k])
        if values.min() >= limits.FLAT * values[k]:  # of a smooth function, seen from near
            return None
    return at if sizes[-1] > limits.GROWS * sizes[-11] else None


def _describe_fault(signal: Signal, time: float, moves: bool) -> str:
    """Say what is wrong with a signal at a time, and what would work."""
    values = signal.value(time)
    what = ("its value", "its rate", "its acceleration")[
        next((k for k, x in enumerate(values) if not np.isfinite(x)), 0)
    ]
    why = "has no real value (0/0, or a root or logarithm of a negative number)"
    if not math.isnan(values[0]):
        why = "grows without bound (a division by zero, or an overflow)"
    subject = f"{what} {why}" if moves else why
    return f"{subject} at t = {time:.6g} s; leave that time out, e.g. by 'a if t < c else b'"


def _require_continuous(scene: Scene, path: str, given: TimeFunction, signal: Signal) -> None:
    """Raise ``InputError`` if a motion's position or rate jumps: no impulse would pass to the other coordinates."""
    assert scene.simulation is not None
    course = signal.values(np.linspace(0.0, scene.simulation.duration, limits.DRIVE_SAMPLES))[:, :2]
    little = limits.JUMP * np.ptp(course, axis=0) + limits.JUMP_ROUND_OFF * np.abs(course).max(axis=0)
    switches = [(time, 0.0) for time in signal.breakpoints if 0.0 < time <= scene.simulation.duration]
    for time, aside in [*switches, *_kinks(signal, scene.simulation.duration)]:
        sides = (min(time - aside, np.nextafter(time, -np.inf)), max(time + aside, np.nextafter(time, np.inf)))
        before, after = (np.array(signal.value(side)) for side in sides)
        passing = (sides[1] - sides[0]) * np.maximum(np.abs(before[1:]), np.abs(after[1:]))  # without any jump
        if (
            np.abs(after - before)[:2] <= passing + np.maximum(little, limits.JUMP_ROUND_OFF * np.abs(after[:2]))
        ).all():
            continue
        (x, rate), (other_x, other_rate) = before[:2] / given.factor, after[:2] / given.factor
        mend = (
            f"jumps at t = {time:.6g} s, from {x:.6g} {given.unit} at {rate:.6g} {given.unit}/s to {other_x:.6g} "
            f"{given.unit} at {other_rate:.6g} {given.unit}/s; a prescribed motion must keep its position and its rate "
            "there: use a smooth formula, or a table of times and values"
        )
        raise InputError(scene.file, path, given.formula, mend)


def _kinks(signal: Signal, duration: float) -> list[tuple[float, float]]:
    """Find kinks of abs, min and max in a formula, the first of them if they are very many; each with its width [s]."""
    span = duration
    for _ in range(limits.SPANS):
        if kinks := find_activity(signal, span).kinks:
            return [(time, limits.KINK_WIDTH * span) for time in kinks]
        span *= limits.SHORTER_SPAN
    return []
