"""From a scene's springs, bushings and bearings, and joints' stops and friction, to force elements and laws."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError, as_input_error
from fmd.core.formula import parse_formula
from fmd.core.rotations import rotation_by
from fmd.dynamics.closures import Place
from fmd.dynamics.elements import Attachment, Element, PointSpring, SixAxisSpring, SpeedDependentBearing
from fmd.dynamics.force_laws import ForceCurve, ForceLaw, Stop, smooth_curve, straight_curve
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.state_functions import StateCurve
from fmd.scene.curves import ForceByElongation
from fmd.scene.force_elements import AngleStop, Bearing, BearingTable, Bushing, LengthStop, Spring
from fmd.scene.joints.joint import JointTable
from fmd.scene.scene import Scene
from fmd.stages.state_functions import make_curve

Locate = Callable[[str], tuple[Place, Array]]
"""Returns a marker or a place on the ground by its name, and its axes in those of its body."""


def joint_laws(joint: JointTable) -> tuple[ForceLaw, ...]:
    """Return the force laws along a joint's coordinates, beside the spring and damper of one with a single axis."""
    if joint.kind.unit:
        (along,) = joint.along
        if not (along.stop or along.friction):
            return ()
        return (ForceLaw(stops=_stops(along.stop), friction=along.friction, friction_rate=along.friction_rate),)
    return tuple(ForceLaw(ForceCurve((-at.spring * at.rest, at.spring)), at.damper) for at in joint.along)


def add_elements(
    scene: Scene, mechanism: Mechanism, locate: Locate, place_joints: Callable[[Scene, Mechanism], tuple[Array, Array]]
) -> Mechanism:
    """Give a mechanism the springs, bushings and bearings of its scene.

    Those whose rest isn't given are unstrained at the start, with the bodies undeformed.

    Raises
    ------
    InputError
        A matrix of a bushing isn't symmetric or has a negative eigenvalue, or a formula has no value at the start.
    """
    springs = [(name, spring, _spring(name, spring, locate)) for name, spring in scene.spring.items()]
    bushings = [(name, table, _bushing(scene, name, table, locate)) for name, table in scene.bushing.items()]
    bearings = [_bearing(scene, name, table, locate) for name, table in scene.bearing.items()]
    if not (springs or bushings or bearings):
        return mechanism
    q, _ = place_joints(scene, mechanism)
    motion = Kinematics(mechanism, np.zeros(1), q[None], np.zeros((1, mechanism.n)))

    def strain(element: Element) -> Array:
        return np.asarray(motion.strain(element)[0][0])

    elements: list[Element] = []
    for name, given, spring in springs:
        rest = float(strain(spring)[0]) if given.length == "start" else spring.rest
        stops = tuple(replace(stop, at=stop.at - rest) for stop in spring.law.stops)  # given by the length
        resting = replace(spring, rest=rest, law=replace(spring.law, stops=stops))
        if not np.isfinite(resting.law.forces(strain(resting), np.zeros(1))).all():
            formula = given.force.formula if given.force else None
            raise InputError(scene.file, f"spring.{name}.force.formula", formula, "has no finite value at the start")
        elements.append(resting)
    for _, table, bushing in bushings:
        elements.append(_relaxed(bushing, strain(bushing), table.position == "start", table.turn == "start"))
    elements += [_relaxed(bearing, strain(bearing), True, False) for bearing in bearings]
    return replace(mechanism, elements=elements)


def _spring(name: str, given: Spring, locate: Locate) -> PointSpring:
    curve = ForceCurve((0.0, given.stiffness)) if given.force is None else _curve(given.force)
    rest = 0.0 if given.length == "start" else float(given.length)
    law = ForceLaw(curve, given.damper, _stops(given.stop), given.friction, given.friction_rate)
    return PointSpring(name, _ends(given.between, locate), law, rest)


def _bushing(scene: Scene, name: str, given: Bushing, locate: Locate) -> SixAxisSpring:
    first, second = _ends(given.between, locate)
    first = replace(first, axes=first.axes @ rotation_by(given.rotation))
    if given.turn != "start":
        second = replace(second, axes=second.axes @ rotation_by(given.turn).T)
    K, C = (_matrix(*pair) for pair in ((given.stiffness, given.stiffness_matrix), (given.damper, given.damper_matrix)))
    position = np.zeros(3) if given.position == "start" else np.array(given.position, dtype=float)
    with as_input_error(scene.file, f"bushing.{name}"):
        return SixAxisSpring(name, (first, second), K, C, position)


def _bearing(scene: Scene, name: str, given: Bearing, locate: Locate) -> SixAxisSpring:
    """Make the bushing of a bearing, whose z axis is the shaft's; its rotations are free."""
    for key in given.whirl_tables:
        mend = (
            "is known to fmd campbell and fmd unbalance of a rotor in bearings alone; a table over 'speed' works here"
        )
        raise InputError(scene.file, f"bearing.{name}.{key}.over", "whirl", mend)
    first, second = _ends(given.between, locate)
    axis = np.array(given.axis, dtype=float)
    ends = replace(first, axes=first.axes @ _turned_to(axis / np.linalg.norm(axis))), second
    (radial, k), (damper, c) = (
        _with_largest(scene, f"bearing.{name}.{key}", curve) for key, curve in bearing_curves(given).items()
    )
    K = np.diag([k, k, given.axial, 0.0, 0.0, 0.0])
    C = np.diag([c, c, given.axial_damper, 0.0, 0.0, 0.0])
    if given.tables:
        return SpeedDependentBearing(name, ends, K, C, radial=radial, damper=damper)
    return SixAxisSpring(name, ends, K, C)


def bearing_curves(given: Bearing) -> dict[str, StateCurve]:
    """Return a bearing's coefficients across its axis as curves, by their keys; of one number a constant one."""
    numbers = {"radial": given.radial, "radial_damper": given.radial_damper}
    return {
        key: make_curve(value) if isinstance(value, BearingTable) else StateCurve((0.0,), ((value, 0.0, 0.0, 0.0),))
        for key, value in numbers.items()
    }


def _with_largest(scene: Scene, key: str, curve: StateCurve) -> tuple[StateCurve, float]:
    """Return a curve with its largest value; raises ``InputError`` if it goes below 0 between its arguments."""
    places = np.interp(
        np.linspace(0, len(curve.knots) - 1, 20 * len(curve.knots)), range(len(curve.knots)), curve.knots
    )
    values = curve.values(places)
    if values.min() < 0.0:
        raise InputError(scene.file, f"{key}.between", "smooth", "the curve goes below 0; 'straight' works")
    return curve, float(values.max())


def _relaxed(bushing: SixAxisSpring, strain: Array, position: bool, turn: bool) -> SixAxisSpring:
    """Move the rest of a bushing to where it is, by its position, by its turn, or by both."""
    first, second = bushing.ends
    if turn and bushing.twists:
        second = replace(second, axes=second.axes @ rotation_by(strain[3:]).T)
    moved = bushing.position + strain[:3] if position else bushing.position
    return replace(bushing, position=moved, ends=(first, second))


def _ends(between: tuple[str, str], locate: Locate) -> tuple[Attachment, Attachment]:
    (first, of_first), (second, of_second) = (locate(place) for place in between)
    return Attachment(first.body, first.marker, of_first), Attachment(second.body, second.marker, of_second)


def _stops(given: LengthStop | AngleStop | None) -> tuple[Stop, ...]:
    if given is None:
        return ()
    sides = ((given.low, -1.0), (given.high, 1.0))
    return tuple(Stop(at, side, given.stiffness, given.damper, given.width) for at, side in sides if at is not None)


def _curve(given: ForceByElongation) -> ForceCurve:
    if given.formula is not None:
        return ForceCurve(formula=parse_formula(given.formula, "x"), factor=given.factor)
    assert given.elongations is not None  # the scene's own check
    assert given.values is not None
    values = [given.factor * value for value in given.values]
    return (smooth_curve if given.smooth else straight_curve)(given.elongations, values)


def _matrix(diagonal: Sequence[float] | None, full: Sequence[Sequence[float]] | None) -> Array:
    if full is not None:
        return np.array(full, dtype=float)
    return np.zeros((6, 6)) if diagonal is None else np.diag(np.array(diagonal, dtype=float))


def _turned_to(axis: Array) -> Array:
    """Rotation whose third column is a unit vector."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(other, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)
