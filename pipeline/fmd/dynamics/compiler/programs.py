"""Functions of a mechanism that can be compiled: their arguments, and how their outputs are traced.

All have the C signature ``void name(const double *…, double *…)`` with these arguments; the last, which are no state,
are filled:

- ``inputs`` (3 n_signals + n_numbers,): value, rate and acceleration of each varying signal at the state's time, and
  springs, rests and dampers of joints, and held values;
- ``q`` (n_positions,) and ``v`` (n,): positions and rates in the mechanism's order;
- ``step`` (1,): length of a leapfrog step, which takes ``q``, ``v`` and ``a`` on in their places, and in lanes eight
  states with eight ``inputs``, (…, 8) each;
- ``push`` (n_bodies, 6): force and moment by contact on each body's frame, in its axes, and ``modal`` (n,): such forces
  on modes, in the order of rates;
- ``a`` (n,): accelerations, and ``r`` (n,): the residual ``M̂ a − Q̂``;
- ``dinputs`` (3 n_signals + n_numbers, 8), ``dq`` (n_positions, 8), ``dv`` and ``da`` (n, 8): eight directions, and
  ``dr`` (n, 8): the residual's derivatives; ``M̂ da`` by ``inertia``;
- ``da`` (n, 8) as an output, of ``acceleration_tangents``: derivatives of the accelerations along eight directions at
  multipliers ``f`` (n_rows,), which ``pulled_residual`` has, too; of ``changed_tangents`` also by ``dr`` (n, 8), what
  the residual changes by beside, of ``pushed_tangents`` by ``dpush`` (n_bodies, 6, 8) and ``dmodal`` (n, 8), too;
- ``inputs_adjoint``, ``q_adjoint``, ``v_adjoint`` and ``a_adjoint``, of the shapes of the state: derivatives of
  ``weights · a`` of the accelerations ``a`` at multipliers ``f``, with ``x`` (n,) for ``M̂⁻¹ weights``, or of weighted
  constraints: of residuals with ``g`` (n_rows,) and their rates with ``rates``, or of their accelerations with ``w``;
- ``along_inputs``, ``along_q``, ``along_v`` and ``along_a``, of the shapes of the state and of ``a``: one direction, by
  whose slope of the residual ``dr`` are the derivatives along eight others, and by ``dalong_q`` (n_positions, 8) and
  ``dalong_v`` (n, 8), how it changes along these itself;
- ``f`` (n, 8): eight generalised forces, and ``x`` (n, 8): ``M̂⁻¹ f``, or ``M̂_SS⁻¹ f_S`` of the fast coordinates and
  zeros for the slow ones, or ``M̂_LL⁻¹ f_L`` and zeros for the fast ones;
- of a mechanism with loops (see `closures`) ``f`` (n_rows, 8): eight sets of multipliers, ``x`` and ``s`` (n_rows, 8):
  ``M̂⁻¹ Jᵀ f`` and ``J M̂⁻¹ Jᵀ f``, ``w`` (n_rows,): accelerations of the residuals by the tree's, which are ``a`` then,
  ``g`` and ``rates`` (n_rows,): residuals and their rates, ``dg``, ``drates`` and ``dw`` (n_rows, 8): their derivatives
  along eight directions and those of their accelerations, and
  ``wrenches`` (n_joints, 2, 6): force and moment in space on both places of each joint by multipliers ``f`` (n_rows,);
- ``motions`` (n_bodies, 6): accelerations of the bodies' frames in space by ``a`` and multipliers ``f`` (n_rows,), and
  ``loads`` (n_bodies, 2, 6): force and moment of each body's joint on its parent and on the body, see `joint_loads`;
- ``moved`` (n_positions,): how positions change. With the slow ones, and with the slow rates by their accelerations,
  the fast rows of the residual change by ``drift`` (n,), and by ``by_inputs`` (3 n_signals, n), ``by_positions`` and
  ``by_rates`` (n,) along each input, all fast positions and all fast rates;
- ``steps`` (6,): the fast step, the major cycle, the number of steps in it, through how many of them loads vary, which
  step of ``ahead`` the first one is, and the sum of the squares of the rates at the end;
  ``inverse_mass`` (n,): 1 over the masses of the fast coordinates, ``ahead`` (any, 3 n_signals, 8): inputs at eight
  fast steps after another, and ``begin`` (n,): accelerations at the cycle's begin;
- ``maps`` (17, any), ``memory`` (2 n,), forces of two cycles, and ``square`` (1,), of rates: see `carried_cycle`;
- ``K`` and ``C`` (n, n), ``X``, ``A`` and ``B`` (n_blocks, n, 8), ``frozen``, ``middle``, ``constant``,
  ``from_middle``, ``rate`` and ``last`` (n,) of ``middle`` and ``middle_step``: see `middle`;
- ``clock`` (2,), ``constant``, ``slope``, ``load`` (n,), ``K`` and ``C`` (n_fast, n_fast): see
  `frozen.trace_fast_step`;
- ``origins`` (n_bodies, 3), ``rotations`` (n_bodies, 3, 3) and ``spins`` (n_bodies, 3): the bodies' frames and angular
  velocities in space;
- ``felt`` (n_touching, most): force and moment at markers that touching bodies' points feel, in their bodies' axes;
- ``energies`` (2,): kinetic and potential (strain, springs, weight) [J];
- ``momenta`` (6,): linear [N s], and angular about the origin [N m s];
- ``x`` and ``rates`` (n_laws,), ``vectors`` (n_laws, 3): elongations that force laws with short pieces depend on, their
  rates, and for springs the vectors from place to place in space;
- ``measured`` (n_measured,): what sampled controllers measure, controller by controller.

Arrays must not overlap. Functions keep no state, so threads may call them at once.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from fmd.dynamics.compiler.adjoints import trace_acceleration_adjoint, trace_rows_adjoint, trace_slope_adjoint
from fmd.dynamics.compiler.algebra import times
from fmd.dynamics.compiler.carried_cycle import trace_carried_cycle
from fmd.dynamics.compiler.closures import ConstrainedForces, MultiplierForces, trace_reactions, trace_rows
from fmd.dynamics.compiler.coordinates import Coordinates, RestingCoordinates
from fmd.dynamics.compiler.cycle import trace_cycle
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.felt_forces import trace_felt_forces
from fmd.dynamics.compiler.forces import ActingForces, GivenForces, PushedForces, trace_effort, trace_elongations
from fmd.dynamics.compiler.frames import MovingFrame, trace_frames
from fmd.dynamics.compiler.frozen import trace_drift, trace_fast_step, trace_single
from fmd.dynamics.compiler.graph import Scalar, Vector, combine
from fmd.dynamics.compiler.middle import trace_middle, trace_middle_step
from fmd.dynamics.compiler.program import Output, Program
from fmd.dynamics.compiler.quantities import trace_kinetic_energy, trace_momenta, trace_potential_energy
from fmd.dynamics.compiler.recursion import BodyValues, trace_accelerations
from fmd.dynamics.compiler.residual import trace_joint_loads, trace_motion, trace_residual
from fmd.dynamics.compiler.tangents import (
    direction_inputs,
    flatten,
    trace_acceleration_tangents,
    trace_tangents,
    unflatten,
)
from fmd.dynamics.mechanism import Mechanism

Trace = Callable[..., list[Output]]
"""Traces a function's outputs for the frames of a mechanism, some also for a number of steps or a pattern."""

_STATE = ("inputs", "q", "v")


class Definition(NamedTuple):
    """Arguments of a function, and the trace of what it fills."""

    arguments: tuple[str, ...]
    trace: Trace
    lanes: tuple[str, ...] = ()
    in_place: bool = False
    seldom: bool = False


def trace_program(name: str, inputs: Coordinates, frames: list[MovingFrame]) -> Program:
    """Trace one of `DEFINITIONS`; behind a name stands a number, as of steps in ``cycle10``."""
    stem = name.rstrip("0123456789")
    arguments, trace, lanes, in_place, seldom = DEFINITIONS[stem]
    numbers = [int(name[len(stem) :])] if name != stem else []
    return Program(name, inputs.graph, arguments, tuple(trace(inputs, frames, *numbers)), lanes, in_place, seldom)


def _accelerations(inputs: Coordinates, frames: list[MovingFrame], forces: type[ActingForces]) -> list[Output]:
    return _in_order_of_rates(inputs.mechanism, "a", trace_accelerations(frames, forces(inputs, frames)))


def _changed_tangents(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    numbers = range(len(frames))
    beside = [BodyValues(inputs.inputs_of_joint(k, "dr"), inputs.inputs_of_modes(k, "dr")) for k in numbers]
    return _with_tangents(inputs, frames, beside)


def _with_tangents(inputs: Coordinates, frames: list[MovingFrame], beside: list[BodyValues]) -> list[Output]:
    values, slopes = trace_acceleration_tangents(inputs, frames, _acting(inputs, frames), beside)
    return [*_in_order_of_rates(inputs.mechanism, "a", values), *_in_order_of_rates(inputs.mechanism, "da", slopes)]


def _acceleration_adjoint(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    x, found = trace_acceleration_adjoint(inputs, frames, _acting(inputs, frames))
    return [*_in_order_of_rates(inputs.mechanism, "x", x), *found]


def _residuals_adjoint(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    rows = trace_rows(inputs, frames)
    both = {"g": [row.residual for row in rows], "rates": [row.rate(inputs) for row in rows]}
    return trace_rows_adjoint(inputs, both, _STATE)


def _closing_adjoint(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    return trace_rows_adjoint(inputs, {"w": _row_accelerations(inputs, frames)}, (*_STATE, "a"))


def _pulled_residual(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    return _in_order_of_rates(inputs.mechanism, "r", trace_residual(inputs, frames, _acting(inputs, frames)))


def _acting(inputs: Coordinates, frames: list[MovingFrame]) -> ActingForces:
    """Return all that acts on a mechanism, with given forces of contacts and multipliers of its constraints."""
    rows = trace_rows(inputs, frames)
    return ConstrainedForces(inputs, frames, rows) if rows else PushedForces(inputs, frames)


def trace_leap(inputs: Coordinates) -> list[Output]:
    """Trace accelerations half a step after the rates, and rates and positions a step later."""
    leaping = inputs.leaping
    frames = trace_frames(leaping)
    new = trace_accelerations(frames, ActingForces(leaping, frames))
    h, rates, positions = leaping.step, [], []
    for number, a in enumerate(new):
        inputs.graph.mark()
        v = [rate + x * h for rate, x in zip(inputs.joint_rates(number), a.joint, strict=True)]
        rates.append(BodyValues(v, combine([(1.0, inputs.modal_rates(number)), (h, a.modes)])))
        joint = zip(inputs.joint_positions(number), v, strict=True)
        modes = combine([(1.0, inputs.modal_positions(number)), (h, rates[-1].modes)])
        positions.append(BodyValues([q + rate * h for q, rate in joint], modes))
    return [
        output
        for argument, values in (("a", new), ("v", rates), ("q", positions))
        for output in _in_order_of_rates(inputs.mechanism, argument, values)
    ]


def _residual(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    return _in_order_of_rates(inputs.mechanism, "r", trace_residual(inputs, frames))


def _by(*arguments: str) -> Callable[..., list[Output]]:
    """Return the program of the residual's slopes by some arguments."""
    return partial(_slopes, arguments=arguments)


def _slopes(inputs: Coordinates, frames: list[MovingFrame], arguments: tuple[str, ...]) -> list[Output]:
    slopes = trace_tangents(inputs, trace_residual(inputs, frames), arguments)
    return _in_order_of_rates(inputs.mechanism, "dr", slopes)


def _inertia(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    """Derivatives of the residual along accelerations, on which no forces depend but those of inertia."""
    unloaded = trace_residual(inputs, frames, GivenForces(inputs, "f", range(inputs.mechanism.n)))
    return _in_order_of_rates(inputs.mechanism, "dr", trace_tangents(inputs, unloaded, ("a",)))


def _second_slopes(
    inputs: Coordinates, frames: list[MovingFrame], of: tuple[str, ...], by: tuple[str, ...]
) -> list[Output]:
    """Derivatives of the residual's slope along one direction, by some arguments and by that direction's motion."""
    graph, residual = inputs.graph, trace_residual(inputs, frames, _acting(inputs, frames) if "f" in of else None)
    first = differentiate(graph, flatten(residual), direction_inputs(graph, of, "along_"))
    seeds = direction_inputs(graph, (*by, "along_q", "along_v"))
    second = unflatten(differentiate(graph, first, seeds), residual)
    return _in_order_of_rates(inputs.mechanism, "dr", second)


def _responses(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    return [*_accelerations(inputs, frames, ActingForces), *_solution(inputs, 0)]


def _solution(inputs: Coordinates, first: int, end: int | None = None) -> list[Output]:
    """Accelerations at rest by given forces, with all rates frozen but some."""
    free = range(first, inputs.mechanism.n if end is None else end)
    resting = RestingCoordinates(inputs.graph, inputs.mechanism)
    values = trace_accelerations(trace_frames(resting), GivenForces(resting, "f", free))
    return _in_order_of_rates(inputs.mechanism, "x", values)


def _constrained(inputs: Coordinates, frames: list[MovingFrame], forces: type[ActingForces]) -> list[Output]:
    rows, acting = trace_rows(inputs, frames), forces(inputs, frames)
    motion = trace_accelerations(frames, acting)
    w = [row.acceleration(inputs, acting.ground, motion) + row.bias for row in rows]
    return [*_in_order_of_rates(inputs.mechanism, "a", motion), *_in_row("w", 0, w), *_multipliers(inputs, frames)]


def _multipliers(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    resting = RestingCoordinates(inputs.graph, inputs.mechanism)
    at_rest = trace_frames(resting)
    rows = trace_rows(resting, at_rest)
    forces = MultiplierForces(resting, rows)
    motion = trace_accelerations(at_rest, forces)
    s = [row.acceleration(resting, forces.ground, motion) for row in rows]
    return [*_in_order_of_rates(inputs.mechanism, "x", motion), *_in_row("s", 0, s)]


def _residuals(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    rows = trace_rows(inputs, frames)
    rates = [row.rate(inputs) for row in rows]
    return [*_in_row("g", 0, [row.residual for row in rows]), *_in_row("rates", 0, rates)]


def _residual_tangents(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    rows = trace_rows(inputs, frames)
    both = [row.residual for row in rows], [row.rate(inputs) for row in rows]
    seeds = direction_inputs(inputs.graph, ("inputs", "q", "v"))
    named = zip(("dg", "drates"), both, strict=True)
    return [x for name, values in named for x in _in_row(name, 0, differentiate(inputs.graph, values, seeds))]


def _closing_tangents(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    seeds = direction_inputs(inputs.graph, ("inputs", "q", "v", "a"))
    return _in_row("dw", 0, differentiate(inputs.graph, _row_accelerations(inputs, frames), seeds))


def _row_accelerations(inputs: Coordinates, frames: list[MovingFrame]) -> list[Scalar]:
    """Accelerations of the constraints' residuals by those of the coordinates, the argument ``a``."""
    acting, numbers = ActingForces(inputs, frames), range(len(frames))
    own = [(inputs.inputs_of_joint(k, "a"), inputs.inputs_of_modes(k, "a")) for k in numbers]
    motion = [BodyValues(*a, x) for a, x in zip(own, trace_motion(inputs, frames, acting), strict=True)]
    return [row.acceleration(inputs, acting.ground, motion) + row.bias for row in trace_rows(inputs, frames)]


def _reactions(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    both = [x for sides in trace_reactions(inputs, frames, "f") for wrench in sides for x in wrench]
    return _in_row("wrenches", 0, both)


def _joint_loads(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    outputs = []
    for number, (motion, on_parent, on_body) in enumerate(trace_joint_loads(inputs, frames)):
        outputs += _in_row("motions", number, motion)
        outputs += _in_row("loads", number, on_parent + on_body)
    return outputs


def _frames(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    outputs = []
    for frame in frames:
        origin, R = frame.world
        outputs += _in_row("origins", frame.number, origin)
        outputs += _in_row("rotations", frame.number, [x for row in R for x in row])
        outputs += _in_row("spins", frame.number, times(R, frame.spin))
    return outputs


def _energies(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    return _in_row("energies", 0, [trace_kinetic_energy(inputs, frames), trace_potential_energy(inputs, frames)])


def _momenta(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    linear, angular = trace_momenta(inputs, frames)
    return _in_row("momenta", 0, linear + angular)


def _elongations(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    names = ("x", "rates", "vectors")
    both = zip(names, trace_elongations(inputs, frames), strict=True)
    return [output for name, values in both for output in _in_row(name, 0, values)]


def _measured(inputs: Coordinates, frames: list[MovingFrame]) -> list[Output]:
    functions = [function for controller in inputs.mechanism.controllers for function in controller.measured]
    return _in_row("measured", 0, [trace_effort(inputs, frames, function) for function in functions])


def _in_order_of_rates(mechanism: Mechanism, argument: str, values: list[BodyValues]) -> list[Output]:
    outputs = []
    for number, body in enumerate(values):
        first = int(mechanism.layout.rate[number])
        outputs += [Output(value, (argument, (first + k,))) for k, value in enumerate(body.joint)]
        if body.modes.size:
            modes = tuple(int(k) for k in mechanism.modes_of(number))
            outputs.append(Output(body.modes, (argument, modes)))
    return outputs


def _in_row(argument: str, row: int, values: Sequence[Scalar | Vector]) -> list[Output]:
    return [Output(value, (argument, (len(values) * row + k,))) for k, value in enumerate(values)]


_LEAP = ("inputs", "step", "q", "v", "a")
_PUSH = ("push", "modal")
_MOTION = ("a", "moved", "drift", "by_inputs")
_FROZEN = ("constant", "slope", "load", "K")
_MIDDLE = ("clock", "A", "B", "constant", "from_middle", "rate", "last")
_CYCLE = ("inputs", "steps", "inverse_mass", "ahead", "q", "v", "a", "begin")
_CARRIED = ("inputs", "maps", "q", "v", "a", "memory", "begin", "square")
_DIRECTIONS = ("dinputs", "dq", "dv", "da", "dr")
_ALONG = _DIRECTIONS[:3]
_DPUSH = ("dpush", "dmodal")
_BESIDE = (*_ALONG, "dr")
_ADJOINT = tuple(f"{name}_adjoint" for name in _STATE)
_SLOPE = (*_STATE, "a", *(f"along_{name}" for name in (*_STATE, "a")))
_CHANGES = ("dg", "drates")
_CLOSED = ("g", "rates")
_FURTHER = (*_DIRECTIONS[:4], "dalong_q", "dalong_v", "dr")
_PULLED = (*_DIRECTIONS[:4], "dw")

DEFINITIONS = {
    "accelerations": Definition((*_STATE, "a"), partial(_accelerations, forces=ActingForces)),
    "acceleration_tangents": Definition(
        (*_STATE, "f", *_ALONG, "a", "da"), partial(_with_tangents, beside=[]), _DIRECTIONS[:4]
    ),
    "acceleration_adjoint": Definition((*_STATE, "a", "f", "weights", "x", *_ADJOINT), _acceleration_adjoint),
    "residuals_adjoint": Definition((*_STATE, *_CLOSED, *_ADJOINT), _residuals_adjoint),
    "closing_adjoint": Definition((*_STATE, "a", "w", *_ADJOINT, "a_adjoint"), _closing_adjoint),
    "changed_tangents": Definition((*_STATE, "f", *_BESIDE, "a", "da"), _changed_tangents, (*_BESIDE, "da")),
    "pushed_tangents": Definition(
        (*_STATE, "f", *_PUSH, *_BESIDE, *_DPUSH, "a", "da"), _changed_tangents, (*_BESIDE, *_DPUSH, "da")
    ),
    "pushed": Definition((*_STATE, *_PUSH, "a"), partial(_accelerations, forces=PushedForces)),
    "leap": Definition(_LEAP, lambda inputs, _: trace_leap(inputs), in_place=True),
    "leap_in_lanes": Definition(
        _LEAP, lambda inputs, _: trace_leap(inputs), lanes=("inputs", "q", "v", "a"), in_place=True
    ),
    "residual": Definition((*_STATE, "a", "r"), _residual, seldom=True),
    "tangents": Definition((*_STATE, "a", *_DIRECTIONS), _by("inputs", "q", "v", "a"), lanes=_DIRECTIONS, seldom=True),
    "second_slopes": Definition(
        (*_SLOPE, *_FURTHER), partial(_second_slopes, of=(*_STATE, "a"), by=(*_STATE, "a")), lanes=_FURTHER
    ),
    "closed_slopes": Definition(
        (*_STATE, "a", "f", *(f"along_{name}" for name in ("q", "v", "a", "f")), *_ALONG, *_FURTHER[-3:]),
        partial(_second_slopes, of=("q", "v", "a", "f"), by=_STATE),
        lanes=(*_ALONG, *_FURTHER[-3:]),
    ),
    "slope_adjoint": Definition(
        (*_SLOPE, "x", *(f"{name}_adjoint" for name in _SLOPE)), partial(trace_slope_adjoint, of=_SLOPE)
    ),
    "inertia": Definition(("inputs", "q", "da", "dr"), _inertia, lanes=("da", "dr"), seldom=True),
    "stiffness": Definition((*_STATE, "a", "dq", "dr"), _by("q"), lanes=("dq", "dr")),
    "damping": Definition((*_STATE, "dv", "dr"), _by("v"), lanes=("dv", "dr")),
    "drift": Definition(
        (*_STATE, *_MOTION), lambda inputs, frames: trace_drift(inputs, trace_residual(inputs, frames))
    ),
    "freeze_single": Definition(
        (*_STATE, *_MOTION, "by_positions", "by_rates"),
        lambda inputs, frames: trace_single(inputs, trace_residual(inputs, frames)),
    ),
    "cycle": Definition(_CYCLE, lambda inputs, frames, count: trace_cycle(inputs, frames, False, count), in_place=True),
    "carried_cycle": Definition(_CARRIED, lambda inputs, _: trace_carried_cycle(inputs), in_place=True),
    "damped_cycle": Definition(_CYCLE, lambda inputs, frames: trace_cycle(inputs, frames, True, 0), in_place=True),
    "fast_step": Definition(
        ("clock", *_FROZEN, "C", "q", "v", "a"), lambda inputs, _: trace_fast_step(inputs, damped=True), in_place=True
    ),
    "undamped_fast_step": Definition(
        ("clock", *_FROZEN, "q", "v", "a"), lambda inputs, _: trace_fast_step(inputs, damped=False), in_place=True
    ),
    "responses": Definition((*_STATE, "f", "a", "x"), _responses, lanes=("f", "x")),
    "middle": Definition(
        ("K", "C", "X", "frozen", "middle", "A", "B", "constant"),
        lambda inputs, _, pattern: trace_middle(inputs, pattern),
    ),
    "middle_step": Definition(_MIDDLE, lambda inputs, _, pattern: trace_middle_step(inputs, pattern), in_place=True),
    "solve": Definition(("inputs", "q", "f", "x"), lambda inputs, _: _solution(inputs, 0), lanes=("f", "x")),
    "solve_fast": Definition(
        ("inputs", "q", "f", "x"), lambda inputs, _: _solution(inputs, inputs.mechanism.n_slow), lanes=("f", "x")
    ),
    "solve_slow": Definition(
        ("inputs", "q", "f", "x"), lambda inputs, _: _solution(inputs, 0, inputs.mechanism.n_slow), lanes=("f", "x")
    ),
    "closed": Definition(
        (*_STATE, "f", "a", "w", "x", "s"), partial(_constrained, forces=ActingForces), lanes=("f", "x", "s")
    ),
    "pushed_closed": Definition(
        (*_STATE, "f", *_PUSH, "a", "w", "x", "s"), partial(_constrained, forces=PushedForces), lanes=("f", "x", "s")
    ),
    "multipliers": Definition(("inputs", "q", "f", "x", "s"), _multipliers, lanes=("f", "x", "s")),
    "residuals": Definition((*_STATE, "g", "rates"), _residuals),
    "pulled_residual": Definition((*_STATE, "f", "a", "r"), _pulled_residual),
    "pushed_residual": Definition((*_STATE, "f", *_PUSH, "a", "r"), _pulled_residual),
    "closing": Definition((*_STATE, "a", "w"), lambda *of: _in_row("w", 0, _row_accelerations(*of))),
    "residual_tangents": Definition((*_STATE, *_ALONG, *_CHANGES), _residual_tangents, lanes=(*_ALONG, *_CHANGES)),
    "closing_tangents": Definition((*_STATE, "a", *_PULLED), _closing_tangents, lanes=_PULLED),
    "reactions": Definition((*_STATE, "f", "wrenches"), _reactions),
    "joint_loads": Definition((*_STATE, "a", "f", *_PUSH, "motions", "loads"), _joint_loads),
    "frames": Definition((*_STATE, "origins", "rotations", "spins"), _frames),
    "felt": Definition((*_STATE, "felt"), lambda inputs, frames: _in_row("felt", 0, trace_felt_forces(inputs, frames))),
    "energies": Definition((*_STATE, "energies"), _energies, seldom=True),
    "momenta": Definition((*_STATE, "momenta"), _momenta, seldom=True),
    "measured": Definition((*_STATE, "measured"), _measured),
    "elongations": Definition((*_STATE, "x", "rates", "vectors"), _elongations),
}
"""Functions of a mechanism by their names."""
