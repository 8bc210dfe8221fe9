"""Teeth of a scene's gears as force elements of its mechanism."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError, as_input_error
from fmd.core.limits.contact import SKEWED_GEARS
from fmd.dynamics.closures import Coupler
from fmd.dynamics.elements import Attachment, GearTeeth
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.scene.gears import find_pair
from fmd.stages.mechanism import place_joints

if TYPE_CHECKING:
    from fmd.stability.tangent import OperatingPoint
    from fmd.stages.pipeline import Pipeline


from collections.abc import Sequence

from scipy.interpolate import CubicSpline

from fmd.contact.gear_pair import ToothFlexibility, press_gears
from fmd.core.involute import GearPair
from fmd.core.limits import contact as limits
from fmd.dynamics.elements import MeshEnergy
from fmd.dynamics.state_functions import StateCurve


def tabulate_energy(pair: GearPair, flexibilities: Sequence[ToothFlexibility], width: float, load: float) -> MeshEnergy:
    """Tabulate the elastic energy of two gears' teeth by their approach and the place of a pair.

    Forces at the nodes are a sum of products, by singular values, up to ``OVERLOAD`` times the load along the line of
    action [N]. The factors are cubic splines of the place, and parabolas between nodes of the approach, so that the
    energy has pieces of cubics in both.
    """
    begin, pitch = pair.path[0], pair.pinion.base_pitch
    places = begin + np.arange(limits.PLACES_OF_PITCH) / limits.PLACES_OF_PITCH * pitch

    def press(approaches: Array, at: Array) -> Array:
        return press_gears(pair, flexibilities, width, approaches, at)

    reach = load / (width * limits.USUAL_MESH_STIFFNESS)
    for _ in range(2):  # forces rise a little faster than the approach
        reach *= (
            limits.OVERLOAD
            * load
            / float(press(np.array([0.0, reach]), places[:: limits.PLACES_OF_PITCH // 8])[1].min())
        )
    approaches = reach * np.linspace(0.0, 1.0, limits.APPROACHES + 1) ** 2
    forces = press(approaches, places)
    U, sizes, V = np.linalg.svd(forces, full_matrices=False)
    kept = range(int((sizes > limits.LEFT_OUT_FORCE * sizes[0]).sum()))
    yielded = np.array([np.interp(load, column, approaches) for column in forces.T])
    stiffest = float((np.diff(forces, axis=0) / np.diff(approaches)[:, None]).max())
    of_approach = tuple(_integrate(approaches, sizes[k] * U[:, k]) for k in kept)
    of_place = tuple(_repeat(places, V[k], pitch) for k in kept)
    between = 0.5 * (approaches[1:] + approaches[:-1])
    between = np.concatenate([[0.0], between[between < yielded.min()]])
    halfway = places[::4] + 0.5 * pitch / limits.PLACES_OF_PITCH
    table = sum(
        np.outer(a.slope.values(between), b.values(halfway)) for a, b in zip(of_approach, of_place, strict=True)
    )
    error = float(np.abs(press(between, halfway) - table).max()) / load
    return MeshEnergy(of_approach, of_place, stiffest, float((load / yielded).mean()), reach, error)


def _integrate(x: Array, y: Array) -> StateCurve:
    """Return the integral of parabolas through points, of which the first is 0 with no slope; straight beyond the last.

    Between points they have the area of a cubic spline.
    """
    h, spline = np.diff(x), CubicSpline(x, y)
    areas = np.diff(spline.antiderivative()(x))
    areas[0] = y[1] * h[0] / 3.0
    values = np.concatenate([[0.0], np.cumsum(areas)])
    start = np.concatenate([[0.0], y[1:-1]])
    mean = areas / h
    square = (3.0 * mean - 2.0 * start - y[1:]) / h
    cubic = (start + y[1:] - 2.0 * mean) / h**2
    beyond = [values[-1], y[-1], 0.5 * float(spline(x[-1], 1)), 0.0]
    return _curve(x, np.vstack([np.stack([values[:-1], start, square, cubic], axis=1), beyond]))


def _repeat(x: Array, y: Array, period: float) -> StateCurve:
    """Return the cubic spline through points that repeats."""
    spline = CubicSpline([*x, x[0] + period], [*y, y[0]], bc_type="periodic")
    return _curve(x, spline.c[::-1].T, period)


def _curve(knots: Array, cubics: Array, period: float = 0.0) -> StateCurve:
    a, b, c, d = cubics.T.tolist()
    return StateCurve(tuple(knots.tolist()), tuple(zip(a, b, c, d, strict=True)), period)


def add_gear_teeth(run: Pipeline, mechanism: Mechanism) -> Mechanism:
    """Give a mechanism the teeth of its scene's gears, which touch at the start.

    Raises
    ------
    InputError
        Hinges aren't parallel and on the gears' axes, or more pairs touch than teeth are meshed for.
    """
    q, v = place_joints(run.divided_scene, mechanism)
    motion = Kinematics(mechanism, np.zeros(1), q[None], v[None])
    teeth = [_make_teeth(run, name, mechanism, motion) for name in run.scene.gear_mesh]
    return replace(mechanism, elements=[*mechanism.elements, *teeth])


def couple_gears(run: Pipeline, mechanism: Mechanism) -> Mechanism:
    """Let the gears of a scene turn together as rigid ones, by the numbers of their teeth.

    Of gears in a ring, or that prescribed motions turn at both ends, the last pair stays free: its teeth yield.
    """
    motion = Kinematics(mechanism, np.zeros(1), *(own[None] for own in place_joints(run.divided_scene, mechanism)))
    couplers = list[Coupler]()
    trains = {link.name: link.name if link.n_rates else "" for link in mechanism.links}  # "": its motion is known
    for name, own in run.scene.gear_mesh.items():
        pair = own.pinion, own.wheel
        train, other = (trains[body] for body in pair)
        if train != other:
            axes, _, _ = _find_axes(run, name, mechanism, motion)
            gears: list[Any] = [run.scene.body[body] for body in pair]
            pinion, wheel = (float(gear.tooth.teeth) for gear in gears)
            factors = pinion, wheel * float(np.sign(axes[0] @ axes[1]))
            angles = [motion.along_joint(mechanism.number_of(body))[0][0] for body in pair]
            couplers.append(Coupler(name, pair, factors, float(np.dot(factors, angles))))
            trains = {body: min(train, other) if at in (train, other) else at for body, at in trains.items()}
    return replace(mechanism, closures=[*mechanism.closures, *couplers])


def _make_teeth(run: Pipeline, name: str, mechanism: Mechanism, motion: Kinematics) -> GearTeeth:
    given = run.scene.gear_mesh[name]
    names = given.pinion, given.wheel
    axes, middles, x_axis = _find_axes(run, name, mechanism, motion)
    axis, apart = axes[0], middles[1] - middles[0]
    along, distance = apart / np.linalg.norm(apart), float(np.linalg.norm(apart))
    with as_input_error(run.scene.file, f"gear_mesh.{name}"):
        pinion, _, pair = find_pair(*names, distance, run.scene.body)
        load = given.torque / pair.pinion.base_radius
        energy = tabulate_energy(pair, [run.wholes[each].tooth_flexibility for each in names], pinion.width, load)
    senses = 1.0, float(np.sign(axes[1] @ axis))
    radii = pair.pinion.base_radius, pair.wheel.base_radius
    numbers = [mechanism.number_of(each) for each in names]
    angles = [float(motion.along_joint(number)[0][0]) for number in numbers]
    tooth = float(np.arctan2(x_axis @ np.cross(axis, along), x_axis @ along)) - angles[0]
    places = pair.place(tooth), pair.place(-tooth)
    links = [mechanism.links[number] for number in numbers]
    off = [float((at - motion.frames[k].origin[0]) @ axis) for k, at in zip(numbers, middles, strict=True)]
    joints = [run.scene.joint[link.joint_name].child.partition(".")[2] for link in links]
    ends = [Attachment(link.name, link.markers[marker]) for link, marker in zip(links, joints, strict=True)]
    rest = sum(sense * radius * angle for sense, radius, angle in zip(senses, radii, angles, strict=True))
    backlash = max(pair.backlash, 0.0) * np.cos(pair.alpha)
    return GearTeeth(
        name,
        (ends[0], ends[1]),
        radii,
        pair.alpha,
        axis,
        along,
        senses,
        (off[0], off[1]),
        rest,
        places,
        backlash,
        energy,
        given.damping,
    )


def _find_axes(
    run: Pipeline, name: str, mechanism: Mechanism, motion: Kinematics
) -> tuple[list[Array], list[Array], Array]:
    """Return the hinges' axes and the gears' middles in space, and the direction of the pinion's middle tooth."""
    axes, centres, teeth = list[Array](), list[Array](), list[Array]()
    for body in (run.scene.gear_mesh[name].pinion, run.scene.gear_mesh[name].wheel):
        number = mechanism.number_of(body)
        link, frame = mechanism.links[number], motion.frames[number]
        R, bore = frame.rotation[0], run.parts[body].body.origin
        axes.append(R @ link.axis / np.linalg.norm(link.axis))
        centres.append(frame.origin[0] - R[:, 2] * bore[2])
        teeth.append(R[:, 0])
        gear: Any = run.scene.body[body]
        off = np.linalg.norm(np.cross(axes[-1], R[:, 2])) + np.hypot(*bore[:2]) / gear.tooth.tip_radius
        if off > SKEWED_GEARS:
            _refuse(run, name, f"joint.{link.joint_name} isn't along the axis of {body}, which is the z axis there")
    apart = centres[1] - centres[0]
    distance = np.linalg.norm(apart)
    if np.linalg.norm(np.cross(axes[0], axes[1])) > SKEWED_GEARS or abs(apart @ axes[0]) > SKEWED_GEARS * distance:
        _refuse(run, name, "the gears' axes aren't parallel, with the middles of both beside one another")
    return axes, centres, teeth[0]


def require_pressed_teeth(run: Pipeline, mechanism: Mechanism, state: OperatingPoint, about: str) -> None:
    """Raise ``InputError`` where no flanks of two gears press: linearised there, teeth have no stiffness."""
    motion = Kinematics(mechanism, np.full(1, state.time), state.q[None], state.v[None])
    for own in mechanism.elements:
        if isinstance(own, GearTeeth) and own.is_apart(motion.strain(own)[0]).all():
            problem = (
                f"no flank is pressed at the operating point ({about}): a linear model would leave the teeth out; "
                "--about equilibrium with a load, or a time at which flanks are pressed, has them"
            )
            _refuse(run, own.name, problem)


def _refuse(run: Pipeline, name: str, problem: str) -> None:
    raise InputError(run.scene.file, f"gear_mesh.{name}", None, problem)
