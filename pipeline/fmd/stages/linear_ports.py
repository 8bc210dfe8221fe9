"""Names of a linear model's inputs and outputs, as a user writes them, and what they mean in a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.recovery.stress import STRESS_TENSOR
from fmd.responses.ports import Direction, GroundPort, JointPort, LoadPort, MarkerPort, ModalPort, MotionPort, Port
from fmd.scene.loads import Drive, MarkerLoad, MotionDrive, PointForce, PointTorque, find_motion
from fmd.scene.reading import suggest_name

if TYPE_CHECKING:
    from fmd.dynamics.mechanism import Mechanism
    from fmd.scene.scene import Scene
    from fmd.stages.pipeline import Pipeline

_DIRECTIONS: dict[str, tuple[Direction, bool]] = {
    "x": ((1.0, 0.0, 0.0), False),
    "y": ((0.0, 1.0, 0.0), False),
    "z": ((0.0, 0.0, 1.0), False),
    "rx": ((1.0, 0.0, 0.0), True),
    "ry": ((0.0, 1.0, 0.0), True),
    "rz": ((0.0, 0.0, 1.0), True),
}
_ORDERS = {"velocity": 1, "acceleration": 2}


@dataclass(frozen=True)
class NamedInput:
    """An input of a scene."""

    port: Callable[[Mechanism], Port]  # makes the port of the scene's mechanism
    drive: Drive | None = None  # load of size 0 whose static response the body there has to take


def find_input(scene: Scene, name: str) -> NamedInput:
    """Find an input by its name.

    Raises
    ------
    InputError
        There is none; the message has those that there are.
    """
    first, _, rest = name.partition(".")
    if first == "ground" and rest in "xyz" and rest:
        direction, _ = _DIRECTIONS[rest]
        return NamedInput(lambda mechanism: GroundPort(name, "m/s^2", direction))
    if first == "drive":
        return _find_drive(scene, name, rest)
    if first in scene.joint and rest in ("torque", "force"):
        return _find_joint_input(scene, name, first, rest)
    if (found := _find_marker(scene, name)) is not None and found[2] == 0:
        place, way, _ = found
        return _marker_input(name, place, way)
    raise InputError("--in", "", name, f"no such input; {suggest_name(name, _input_names(scene), 'the inputs')}")


def find_output(run: Pipeline, mechanism: Mechanism, name: str) -> Port:
    """Find an output by its name.

    Raises
    ------
    InputError
        There is none, or it isn't linear; the message says what would work.
    """
    scene = run.scene
    first, _, rest = name.partition(".")
    if first in scene.joint and rest in ("position", "rate", "acceleration"):
        return _joint_output(scene, mechanism, name, first, rest)
    place, _, component = name.rpartition(".")
    elements = [f"{body}.{element}" for body, part in run.parts.items() for element in part.elements]
    if place in elements and component in STRESS_TENSOR:
        body, _, element = place.partition(".")
        part = run.parts[body]
        row = part.element_stress[list(part.elements).index(element), STRESS_TENSOR.index(component)]
        return ModalPort(name, "Pa", mechanism.number_of(body), row)
    if place in elements and component in ("von Mises", "principal 1", "principal 2", "principal 3"):
        mend = (
            f"isn't linear in the motion, so it has no transfer function; a component has: {', '.join(STRESS_TENSOR)}"
        )
        raise InputError("--out", "", name, mend)
    if (found := _find_marker(scene, name)) is not None:
        place, way, order = found
        unit = ("rad" if _DIRECTIONS[way][1] else "m") + ("", "/s", "/s^2")[order]
        return _marker_port(mechanism, name, place, way, unit, order)
    names = _output_names(scene, elements)
    raise InputError("--out", "", name, f"no such output; {suggest_name(name, names, 'the outputs')}")


def _find_marker(scene: Scene, name: str) -> tuple[str, str, int] | None:
    """Return marker, direction and order of derivative of a name; the body may be left out where one has the marker."""
    place, _, way = name.rpartition(".")
    order = 0
    if way in _ORDERS:
        order = _ORDERS[way]
        place, _, way = place.rpartition(".")
    markers = _markers(scene)
    if "." not in place:
        alike = [marker for marker in markers if marker.partition(".")[2] == place]
        place = alike[0] if len(alike) == 1 else place
    return (place, way, order) if place in markers and way in _DIRECTIONS else None


def _markers(scene: Scene) -> list[str]:
    return [f"{name}.{marker}" for name, body in scene.body.items() for marker in body.marker]


def _marker_input(name: str, place: str, way: str) -> NamedInput:
    direction, turns = _DIRECTIONS[way]
    settings: dict[str, Any] = {"marker": place, "direction": direction}
    drive: Drive
    if turns:
        drive = PointTorque.model_validate({"type": "point torque", "torque": "0 N m", **settings})
    else:
        drive = PointForce.model_validate({"type": "point force", "force": "0 N", **settings})
    return NamedInput(lambda mechanism: _marker_port(mechanism, name, place, way, drive.unit, 0), drive)


def _marker_port(mechanism: Mechanism, name: str, place: str, way: str, unit: str, order: int) -> MarkerPort:
    body, _, marker = place.partition(".")
    number = mechanism.find_marker(mechanism.number_of(body), marker)
    shapes = mechanism.links[number].markers[marker]
    return MarkerPort(name, unit, number, shapes, *_DIRECTIONS[way], order=order)


def _find_joint_input(scene: Scene, name: str, joint: str, kind: str) -> NamedInput:
    given = scene.joint[joint]
    needed = "force" if given.kind.unit == "m" else "torque"
    if not given.kind.unit or joint in scene.closing:
        problem = f"is a {given.type} joint{' that closes a loop' if joint in scene.closing else ''}"
        raise InputError("--in", "", name, f"{problem}; a torque or force acts along a revolute or prismatic one")
    if kind != needed:
        raise InputError("--in", "", name, f"is a {given.type} joint: '{joint}.{needed}' works")
    if driver := find_motion(scene.drive, joint):
        raise InputError("--in", "", name, f"moves as prescribed: 'drive.{driver[0]}' is its motion as an input")
    body, unit = given.child.partition(".")[0], "N" if kind == "force" else "N m"
    return NamedInput(lambda mechanism: JointPort(name, unit, mechanism.number_of(body)))


def _find_drive(scene: Scene, name: str, rest: str) -> NamedInput:
    key, _, suffix = rest.partition(".")
    if key not in scene.drive or suffix not in ("", "acceleration"):
        names = [f"drive.{other}" for other in scene.drive]
        raise InputError("--in", "", name, f"no such input; {suggest_name(name, names, 'the drives')}")
    drive = scene.drive[key]
    if isinstance(drive, MarkerLoad):
        points = [other for other, load in scene.drive.items() if isinstance(load, MarkerLoad)]
        return NamedInput(lambda mechanism: LoadPort(name, drive.unit, points.index(key)))
    body, unit = scene.joint[drive.joint].child.partition(".")[0], drive.input_unit
    if isinstance(drive, MotionDrive):
        return NamedInput(lambda mechanism: MotionPort(f"drive.{key}.acceleration", unit, mechanism.number_of(body)))
    return NamedInput(lambda mechanism: JointPort(name, unit, mechanism.number_of(body)))


def _joint_output(scene: Scene, mechanism: Mechanism, name: str, joint: str, kind: str) -> JointPort:
    given = scene.joint[joint]
    if not given.kind.unit or joint in scene.closing:
        raise InputError("--out", "", name, f"is a {given.type} joint without one position; a marker's motion works")
    order = ("position", "rate", "acceleration").index(kind)
    number = mechanism.number_of(given.child.partition(".")[0])
    unit = given.kind.unit + ("", "/s", "/s^2")[order]
    return JointPort(name, unit, number, order=order)


def _input_names(scene: Scene) -> Iterator[str]:
    for marker in _markers(scene):
        yield f"{marker}.{'|'.join(_DIRECTIONS)}"
    for name, joint in scene.joint.items():
        if joint.kind.unit and name not in scene.closing:
            yield f"{name}.{'force' if joint.kind.unit == 'm' else 'torque'}"
    yield from (f"drive.{name}" for name in scene.drive)
    yield "ground.x|y|z"


def _output_names(scene: Scene, elements: list[str]) -> Iterator[str]:
    for marker in _markers(scene):
        yield f"{marker}.{'|'.join(_DIRECTIONS)}[.velocity|.acceleration]"
    for name, joint in scene.joint.items():
        if joint.kind.unit and name not in scene.closing:
            yield f"{name}.position|rate|acceleration"
    yield from (f"{element}.{'|'.join(STRESS_TENSOR)}" for element in elements)
