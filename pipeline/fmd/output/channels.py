"""Results of a run by their names: numbers, histories as in files of histories, and formulas of the motion."""

from collections.abc import Callable, Sequence

import numpy as np

from fmd.accuracy.quantities import find_counterparts
from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.fitting import SAME_MODE
from fmd.core.limits.round_off import SUMMED
from fmd.fem.sections import NUMBERS_ALONE
from fmd.output.histories import formula_history, history_variables, number_columns
from fmd.output.responses import compute_scene_response, response_unit
from fmd.output.stress_fields import find_fatigue, lives_at
from fmd.recovery.motion_file import Variable
from fmd.recovery.stress import von_mises
from fmd.scene.histories import Quantities
from fmd.scene.reading import suggest_name
from fmd.scene.result_names import (
    BY,
    find_fatigue_output,
    listed_response,
    read_formula,
    require_deflecting_tip,
    require_quantity,
    with_body,
)
from fmd.scene.rigid_bodies import Undeformable
from fmd.stages.pipeline import Pipeline

_SIZE = ".size"


@dataclass(frozen=True)
class ResultChannel:
    """A result of a run, which variants of its scene have, too."""

    name: str
    unit: str  # SI unit
    read: Callable[[Pipeline], Array]  # takes a run's stages to the result, a number or a history (n_times,)
    moves: bool = True  # true if it takes a motion
    part: str = ""  # flexible body of a frequency; an empty name of another result
    mode: int = 0  # number of the frequency, from 0
    # Finds a run's largest value, wherever and whenever it is; ``read`` follows it where this run has it.
    largest: Callable[[Pipeline], float] | None = None
    shortest: Callable[[Pipeline], float] | None = None  # finds a run's shortest life, likewise
    errors_of: str | Variable = ""  # what the error budget knows it by


def find_all_channels(run: Pipeline, names: Sequence[str]) -> list[ResultChannel]:
    """Find the results of several names, each name once, as `find_channels` does."""
    return [channel for name in dict.fromkeys(names) for channel in find_channels(run, name)]


def find_channels(run: Pipeline, name: str, origin: str = "--of") -> list[ResultChannel]:
    """Find the results of a name: one, or a vector's components.

    Names are ``tip`` (the largest deflection of the tip), ``BODY.stress`` (the largest von Mises stress of a flexible
    body), ``BODY.life`` (repeats of the motion to failure, by the scene's output of type fatigue),
    ``BODY.frequency.N``, of which the name of a scene's only flexible body may be left out, ``critical_speed.N``, the
    rate of rotation at which it meets a frequency for the N-th time, ``mass`` (of all bodies), ``BODY.mass``, ``OUTPUT
    by INPUT`` (the largest magnitude of a frequency response that the scene lists), a column of a file of histories
    without its unit, e.g. ``forearm.wrist.position.y``, ``elbow.position``, ``shoulder.force.x``,
    ``shoulder.force.size`` or, for all components of a vector but those that are round-off, ``shoulder.force``, or a
    formula of the motion with a name, ``error = forearm.wrist.y - 0.3``. Messages name the option that it comes from,
    ``origin``.

    Raises
    ------
    InputError
        The run has no such result.
    """
    if "=" in name:
        return [_formula(run, name, origin)]
    if BY in name:
        return [_response(run, name, origin)]
    parts = with_body(run.scene, name)
    name = ".".join(parts)
    if len(parts) == 3 and parts[0] in run.wholes and parts[1] == "frequency":
        return [_frequency(run, name, parts[0], parts[2], origin)]
    if parts[0] == "critical_speed":
        return [_critical_speed(run, name, parts[1:], origin)]
    if name == "mass":
        bodies = [*run.scene.body]
        return [ResultChannel(name, "kg", lambda other: np.sum([_mass(other, body) for body in bodies]), moves=False)]
    if len(parts) == 2 and parts[0] in run.scene.body and parts[1] == "mass":
        read, known = (lambda other: np.asarray(_mass(other, parts[0]))), f"{parts[0]}, mass"
        return [ResultChannel(name, "kg", read, moves=False, errors_of=known)]
    run.scene.simulation  # noqa: B018 - refuses a scene without motion
    if name == "tip":
        return [_tip(run, origin)]
    if len(parts) == 2 and parts[0] in run.wholes and parts[1] == "stress":
        return [_stress(run, parts[0], origin)]
    if len(parts) == 2 and parts[0] in run.wholes and parts[1] == "life":
        return [_life(run, parts[0], origin)]
    return _histories(run, name, origin)


def _tip(run: Pipeline, origin: str) -> ResultChannel:
    require_deflecting_tip(run.scene, origin)
    frame = int(run.motion.tip_size.argmax())
    if not run.motion.tip_size[frame] > 0.0:
        raise InputError(origin, "tip", run.motion.tip, "doesn't deflect in this motion; its '.position.x' works")
    return ResultChannel(
        "tip",
        "m",
        lambda other: other.motion.tip_size[frame],
        largest=lambda other: float(other.motion.tip_size.max()),
        errors_of="tip, largest deflection",
    )


def _stress(run: Pipeline, body: str, origin: str) -> ResultChannel:
    if not (part := run.wholes[body]).has_stress:
        mend = f"{body} {NUMBERS_ALONE}" if part.has_mesh else f"{body} has no stress: it has no mesh"
        raise InputError(origin, f"{body}.stress", None, mend)
    time, node, value = run.stress_of(body, run.motion).worst()
    if not value > 0.0:
        raise InputError(origin, f"{body}.stress", None, f"{body} has no stress in this motion")
    frame = int(np.flatnonzero(run.motion.times == time)[0])

    def read(other: Pipeline) -> Array:
        stress = other.stress_of(body, other.motion)
        return np.asarray(von_mises((stress.modal[node] @ stress.q[frame])[None])[0])

    return ResultChannel(
        f"{body}.stress",
        "Pa",
        read,
        largest=lambda other: other.stress_of(body).worst()[2],
        errors_of=f"{body}, largest von Mises stress",
    )


def _frequency(run: Pipeline, name: str, body: str, number: str, origin: str) -> ResultChannel:
    count = len(run.wholes[body].modes.omega)
    if not number.isdecimal() or not 1 <= int(number) <= count:
        raise InputError(origin, name, None, f"{body} has the modes 1 to {count}")
    return _of_mode(name, body, int(number) - 1)


def _of_mode(name: str, body: str, mode: int) -> ResultChannel:
    read, known = (lambda other: other.wholes[body].modes.frequencies_hz[mode]), f"{body}, frequency {mode + 1}"
    return ResultChannel(name, "Hz", read, False, body, mode, errors_of=known)


def _critical_speed(run: Pipeline, name: str, number: list[str], origin: str) -> ResultChannel:
    """Return a critical speed, as a Campbell diagram has it; of other runs the one close by, or that of this number."""
    from fmd.output.campbell import find_critical_speed_near, find_critical_speeds

    if len(number) != 1 or not number[0].isdecimal() or not int(number[0]):
        raise InputError(origin, name, None, "needs its number, from 1, e.g. critical_speed.1")

    def find(other: Pipeline) -> float:
        found, highest = find_critical_speeds(other, int(number[0]))
        if len(found) < int(number[0]):
            mend = f"the rotation meets {len(found)} frequencies up to {highest:.4g} rad/s, see 'fmd campbell'"
            raise InputError(origin, name, None, mend)
        return found[-1]

    rate = find(run)

    def read(other: Pipeline) -> Array:
        return np.asarray(rate if other is run else find_critical_speed_near(other, rate) or find(other))

    return ResultChannel(name, "rad/s", read, moves=False)


def follow_mode(channel: ResultChannel, run: Pipeline, other: Pipeline) -> ResultChannel:
    """Return the frequency of another design's mode that is most like a run's, by the modal assurance criterion.

    The other design has the run's elements; results that are no frequency are returned as they are.

    Raises
    ------
    AccuracyError
        None of the other's modes is like it.
    """
    if not channel.part or run.wholes[channel.part].key("modes") == other.wholes[channel.part].key("modes"):
        return channel
    mine, theirs = run.wholes[channel.part], other.wholes[channel.part]
    places, modes = theirs.fe.x, theirs.modes
    numbers, alike = find_counterparts(places, mine.modes.shapes, places, theirs.fe.m, modes.shapes, modes.omega)
    if alike[channel.mode] < SAME_MODE:
        raise AccuracyError(
            f"{channel.name} is lost: no mode there is like it (modal assurance criterion {alike[channel.mode]:.2g}); "
            f"more modes by body.{channel.part}.modes.count, or narrower bounds, keep it"
        )
    return _of_mode(channel.name, channel.part, int(numbers[channel.mode]))


def _mass(run: Pipeline, body: str) -> float:
    """Return the mass of a body [kg]."""
    table = run.scene.body[body]
    if isinstance(table, Undeformable):
        return table.mass
    part = run.wholes[body]
    return part.mass if part.has_mesh else part.body.integrals.mass


def _life(run: Pipeline, body: str, origin: str) -> ResultChannel:
    output = find_fatigue_output(run.scene, body, origin)
    place = find_fatigue(run, output).worst(1)

    def shortest(other: Pipeline) -> float:
        damage = float(find_fatigue(other, output).damage.max())
        return 1.0 / damage if damage > 0.0 else np.inf

    return ResultChannel(f"{body}.life", "", lambda other: lives_at(other, output, place)[0], shortest=shortest)


def _histories(run: Pipeline, name: str, origin: str) -> list[ResultChannel]:
    quantities = Quantities.model_validate({"file": "", **require_quantity(run.scene, name, origin)})

    def columns(other: Pipeline) -> dict[str, tuple[Variable, Array]]:
        variables = history_variables(other, quantities, other.motion)
        return {column: (variable, values) for variable, column, values in number_columns(variables, with_sizes=True)}

    there = columns(run)

    def reader(column: str) -> Callable[[Pipeline], Array]:
        return lambda other: (there if other is run else columns(other))[column][1]

    of_vector = [column for column in there if column.startswith(f"{name}.") and not column.endswith(_SIZE)]
    chosen = [name] if name in there else of_vector
    if not chosen:
        raise InputError(origin, name, None, f"no such result; {suggest_name(name, there, 'there are')}")
    size = max(float(np.abs(there[column][1]).max()) for column in chosen)
    kept = [column for column in chosen if column == name or np.abs(there[column][1]).max() > SUMMED * size]
    return [
        ResultChannel(column, there[column][0].units, reader(column), errors_of=there[column][0]) for column in kept
    ]


def _formula(run: Pipeline, given: str, origin: str) -> ResultChannel:
    """Return a formula of the motion in SI units as a history."""
    name, text = read_formula(run.scene, given, origin)
    return ResultChannel(name, "", lambda other: formula_history(other, text, other.motion))


def _response(run: Pipeline, name: str, origin: str) -> ResultChannel:
    """Return the largest magnitude of a frequency response that the scene lists."""
    listed, k = listed_response(run.scene, name, origin)
    here = compute_scene_response(run, listed)

    def read(other: Pipeline) -> Array:
        found = here if other is run else compute_scene_response(other, listed)
        return np.asarray(np.abs(found.values[:, k, 0]).max())

    return ResultChannel(name, response_unit(here.outputs[k][1], here.inputs[0][1]), read, moves=False)
