"""Text of a scene for a robot from a URDF or MJCF file, with what of the file it can't hold."""

import json
from collections.abc import Collection, Iterable, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np

from fmd.cli.cad_scenes import make_name
from fmd.cli.mjcf_robot import read_mjcf
from fmd.cli.robot import Pose, Robot, RobotJoint, RobotLink, Shape
from fmd.cli.robot_shapes import ShapeWriter, write_lengths, write_turn
from fmd.cli.urdf_robot import read_urdf
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.scene import (
    LIGHT_LINK,
    LIGHT_RADIUS,
    LONGEST_NAME,
    SKEW_INERTIA,
    STOP_ANGLE,
    STOP_LENGTH,
    STOP_LOADS,
)

_KINDS = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "floating": "free",
    "planar": "planar",
    "ball": "spherical",
    "spherical": "spherical",  # of Bullet
}
READERS = {".urdf": read_urdf, ".xml": read_mjcf, ".mjcf": read_mjcf}
"""How a robot's file is read, by its suffix."""
_ALUMINIUM = {"E": "70 GPa", "nu": 0.33}


def write_robot_scene(file: Path, target: Path, flexible: Sequence[str] = ()) -> tuple[str, list[str]]:
    """Return the text of a scene for the robot in a file, and what of the file isn't in it.

    The link that nothing carries stands on the ground. Links without mass on fixed joints are markers of the link that
    they are on. The frame of a body is its link's, turned to the principal axes of its inertia where the file gives
    products of inertia.

    Parameters
    ----------
    file : Path
        URDF, or MJCF with the suffix ``.xml`` or ``.mjcf``.
    target : Path
        Where the scene will lie, which its files are relative to.
    flexible : sequence of str
        Links that become flexible bars, by the box of their collision or visual geometry.

    Raises
    ------
    InputError
        The file is no such file, or a link that is to be flexible isn't there, or has no box.
    """
    writer = _Writer(READERS[file.suffix.lower()](file), file, target, flexible)
    return writer.text(), writer.notes


def write_assembly_scene(file: Path, target: Path) -> tuple[str, list[str]]:
    """Return the text of a scene for an assembly in a CAD file, and what it suggests and leaves out.

    Files of the parts are written to a folder beside the scene; raises as `fmd.cli.cad_assembly.read_assembly`.
    """
    from fmd.cli.cad_assembly import read_assembly

    writer = _Writer(read_assembly(file, target.parent / f"{target.stem}-parts"), file, target, ())
    return writer.text(), writer.notes


class _Writer:
    """Tables of a scene for a robot, gathered link by link."""

    def __init__(self, robot: Robot, file: Path, target: Path, flexible: Sequence[str]) -> None:
        self.robot, self.file, self.target = robot, file, target
        self.notes = list(robot.notes)
        self.motors: dict[str, list[str]] = {}  # joints by limits
        self.shapes = ShapeWriter(file.resolve(), target)
        for name in flexible:
            if name not in robot.links or name == robot.root:
                names = ", ".join(link for link in robot.links if link != robot.root)
                raise InputError("--flexible", "", name, f"is no moving link of {file.name}; there are {names}")
        self.flexible = set(flexible)
        self.parents = {joint.child: joint for joint in robot.joints.values()}
        self.frames = {name: self._frame(name) for name in robot.links if self._carrier(name) == name}
        self.names, self.joint_names = _make_names(robot.links, "link"), _make_names(robot.joints, "joint")
        on_others = [name for name in robot.links if name not in self.frames]
        self.marker_names = _make_names(on_others, "frame", {"origin", *self.joint_names.values()})
        self.markers: dict[str, dict[str, Pose]] = {name: {} for name in self.frames}

    def _carrier(self, name: str) -> str:
        """Return the link whose body has a link's frame: itself, or what a link without mass is fixed to."""
        joint = self.parents.get(name)
        if joint is not None and joint.kind == "fixed" and self.robot.links[name].mass == 0.0:
            return self._carrier(joint.parent)
        return name

    def _within(self, name: str) -> Pose:
        """Return a link's pose in the link that carries its frame."""
        if self._carrier(name) == name:
            return Pose()
        joint = self.parents[name]
        return self._within(joint.parent).then(joint.pose)

    def _frame(self, name: str) -> Pose:
        """Return the pose of a body's frame in its link's: the ground's, a bar's, or by its inertia's axes."""
        link = self.robot.links[name]
        if name == self.robot.root:
            return Pose()
        if name in self.flexible:
            return _frame_of_bar(self._box_of(link))
        skew = np.abs(link.inertia - np.diag(np.diag(link.inertia))).max(initial=0.0)
        if skew <= SKEW_INERTIA * np.trace(link.inertia):
            return Pose()
        _, axes = np.linalg.eigh(link.inertia)
        return Pose(axes=axes * np.sign(np.linalg.det(axes)))

    def _box_of(self, link: RobotLink) -> Shape:
        boxes = [shape for shape in (*link.collisions, *link.visuals) if shape.kind == "box"]
        if not boxes:
            kinds = ", ".join(sorted({shape.kind for shape in (*link.collisions, *link.visuals)})) or "none"
            mend = f"has no box to make a flexible bar of (its shapes: {kinds}); its mesh can be a body's, by hand"
            raise InputError("--flexible", "", link.name, mend)
        return boxes[0]

    def _in_body(self, link: str, pose: Pose) -> Pose:
        """Return a pose of a link's frame in the frame of the body that has it."""
        frame = self.frames[self._carrier(link)]
        inside = self._within(link).then(pose)
        return Pose(frame.axes.T @ (inside.at - frame.at), frame.axes.T @ inside.axes)

    def text(self) -> str:
        """Return the scene's text."""
        robot, root = self.robot, self.robot.root
        if set(self.frames) == {root}:
            raise InputError(str(self.file), "joint", None, "carries no link that has mass or moves: it is no robot")
        if robot.links[root].mass:
            self.notes.append(f"{root} stands on the ground: its mass of {robot.links[root].mass:g} kg has no effect")
        joints = [
            self._joint(joint, root) for joint in robot.joints.values() if self._carrier(joint.child) == joint.child
        ]
        for name, marker in self.marker_names.items():
            if self._carrier(name) != root:
                self.markers[self._carrier(name)][marker] = self._in_body(name, Pose())
        ground = [] if root not in self.markers else self._ground(root)
        bodies = [
            *self._base(robot.links[root]),
            *(self._body(robot.links[name]) for name in self.frames if name != root),
        ]
        tip = self._tip(root)
        motors = [f"{limits} of {', '.join(joints)}" for limits, joints in self.motors.items()]
        if motors:
            self.notes.append(f"limits of motors (docs/control.md has motors): {'; '.join(motors)}")
        self.notes += self.shapes.list_notes()
        notes = [f"# - {note}" for note in self.notes]
        head = [
            f"# Made of {self.file.name}. It falls under its weight; docs/control.md has drives and controllers.",
            *(["# What the file has and this scene hasn't:", *notes] if notes else []),
            f"title = {json.dumps(robot.name)}",
        ]
        end = [
            "[simulation]",
            'duration = "1 s"',
            'output_step = "10 ms"',
            f'tip = "{tip}"',
            _write({"gravity": [f"{x:g} m/s^2" for x in robot.gravity]}),
            "# Once motors or springs hold it; else its weight acts at once, and all modes of flexible links ring:",
            '# start = "equilibrium"',
            "",
            "[[simulation.run]]",
            'integrator = "auto"',
            "",
            "[[output]]",
            'type = "film"',
            'file = "motion.mp4"',
            "frames = 50",
            "rate = 25.0",
            "",
            "[[output]]",
            'type = "history"',
            'file = "joints.png"',
            'quantities = ["joint_position"]',
        ]
        return "\n\n".join(["\n".join(head), *bodies, *ground, *joints, "\n".join(end)]) + "\n"

    def _tip(self, root: str) -> str:
        """Return the marker at the end of the longest chain of joints."""

        def depth(name: str) -> int:
            return 1 + depth(self.parents[name].parent) if name in self.parents else 0

        far = max((name for name in self.robot.links if self._carrier(name) != root), key=depth)
        body = self.names[self._carrier(far)]
        return f"{body}.{self.marker_names.get(far, 'origin')}"

    def _ground(self, root: str) -> list[str]:
        tables = []
        for name, pose in self.markers[root].items():
            tables.append(f"[ground.{name}]\n{_write({'at': write_lengths(pose.at), **_turn(pose)})}")
        return tables

    def _base(self, link: RobotLink) -> list[str]:
        """Return a body that stands on the ground as the link that nothing carries, to be drawn, if it has shapes."""
        visuals = self._visuals(link)
        if not visuals:
            return []
        name = self.names[link.name]
        joint = next(
            text for text in (name, f"{name}-stands", f"{name}-on-ground") if text not in self.joint_names.values()
        )
        table = {
            "shape": "rigid",
            **self._inertia(link),
            "marker": {"origin": {"at": write_lengths(np.zeros(3))}},
        }
        held = {"type": "fixed", "parent": "ground", "child": f"{name}.origin"}
        return [f"[body.{name}]\n{_write(table)}", *visuals, f"[joint.{joint}]\n{_write(held)}"]

    def _visuals(self, link: RobotLink) -> list[str]:
        shapes = self.shapes.draw(link, lambda shape: self._in_body(link.name, shape.pose))
        return [f"[[body.{self.names[link.name]}.visual]]\n{_write(shape)}" for shape in shapes]

    def _body(self, link: RobotLink) -> str:
        name, frame = self.names[link.name], self.frames[link.name]
        markers = {"origin": self._in_body(link.name, Pose()), **self.markers[link.name]}
        visuals = self._visuals(link)
        if link.name in self.flexible:
            size = sorted(self._box_of(link).size, reverse=True)
            volume = float(np.prod(size))
            divisions = [max(2, round(size[0] / max(size[1], size[2])) * 2), 2, 2]
            table: dict[str, Any] = {
                "shape": "bar",
                **{key: f"{x:.9g} m" for key, x in zip(("length", "depth", "width"), size, strict=True)},
                **_ALUMINIUM,
                "rho": f"{link.mass / volume:.9g} kg/m^3",
                "mesh": {"divisions": divisions},
                "modes": {"count": 6, "boundary": "joint", "damping": 0.01},
            }
            self.notes.append(
                f"{link.name} is a bar of aluminium of its box, with the file's mass: give E and nu of yours"
            )
            table["marker"] = {key: self._place_on_bar(name, key, pose, size) for key, pose in markers.items()}
            return f"[body.{name}]\n{_write(table)}"
        table = {
            "shape": "rigid",
            **self._inertia(link),
            "centre": write_lengths(frame.axes.T @ (link.centre - frame.at)),
            "marker": {key: {"at": write_lengths(pose.at), **_turn(pose)} for key, pose in markers.items()},
        }
        return "\n\n".join([f"[body.{name}]\n{_write(table)}", *visuals])

    def _inertia(self, link: RobotLink) -> dict[str, Any]:
        """Return the mass and the moments of inertia of a link in its body's axes; notes tell of what is made up."""
        axes = self.frames[link.name].axes
        mass, inertia = link.mass, np.diag(axes.T @ link.inertia @ axes)
        if not mass > 0.0:
            mass, inertia = LIGHT_LINK, np.full(3, LIGHT_LINK * LIGHT_RADIUS**2)
            self.notes.append(f"{link.name} has no mass, which a body needs: {mass:g} kg is taken")
        possible = _make_possible(inertia)
        if not np.allclose(inertia, possible, rtol=SKEW_INERTIA, atol=0.0):
            moments = ", ".join(f"{x:.4g}" for x in inertia)
            self.notes.append(
                f"{link.name}: no body has moments of inertia of {moments} kg m²: the least possible are taken"
            )
        return {"mass": f"{mass:.15g} kg", "inertia": [f"{x:.12g} kg m^2" for x in possible]}

    def _place_on_bar(self, name: str, marker: str, pose: Pose, size: Sequence[float]) -> dict[str, Any]:
        """Return a marker of a bar: an end face where the place is near one, else the nearest point of the bar."""
        low, high = np.array([0.0, -size[1] / 2, -size[2] / 2]), np.array([size[0], size[1] / 2, size[2] / 2])
        at = np.clip(pose.at, low, high)
        near = [abs(at[0] - x) <= 0.5 * max(size[1:]) for x in (0.0, size[0])]
        where: dict[str, Any] = {"at": write_lengths(at)}
        if any(near):
            where = {"face": "x-" if near[0] else "x+"}
            at = np.array([0.0 if near[0] else size[0], 0.0, 0.0])
        if (apart := float(np.linalg.norm(at - pose.at))) > 1e-6:
            self.notes.append(f"{name}.{marker} is {1e3 * apart:.3g} mm from its place in the file, on the bar")
        return {**where, **_turn(pose)}

    def _joint(self, joint: RobotJoint, root: str) -> str:
        name = self.joint_names[joint.name]
        kind = _KINDS.get(joint.kind)
        if kind is None:
            raise InputError(str(self.file), f"joint {joint.name}", joint.kind, f"is none of {', '.join(_KINDS)}")
        carrier = self._carrier(joint.parent)
        self.markers[carrier][name] = self._in_body(joint.parent, joint.pose)
        parent = f"ground.{name}" if carrier == root else f"{self.names[carrier]}.{name}"
        table: dict[str, Any] = {"type": kind, "parent": parent, "child": f"{self.names[joint.child]}.origin"}
        if kind in ("revolute", "prismatic", "planar"):
            table["axis"] = [float(f"{x:.12g}") for x in joint.axis]
        if kind in ("revolute", "prismatic"):
            turns = kind == "revolute"
            table |= {"damper": f"{joint.damping:.9g} {'N m s/rad' if turns else 'N s/m'}"} if joint.damping else {}
            table |= {"spring": f"{joint.spring:.9g} {'N m/rad' if turns else 'N/m'}"} if joint.spring else {}
            table |= {"rest": f"{joint.rest:.12g} {'rad' if turns else 'm'}"} if joint.spring and joint.rest else {}
            table |= {"friction": f"{joint.friction:.9g} {'N m' if turns else 'N'}"} if joint.friction else {}
            table |= self._stops(joint, turns)
        text = f"[joint.{name}]\n{_write(table)}"
        coupler = self._coupler(joint, name, kind)
        return f"{text}\n\n[coupler.{name}]\n{_write(coupler)}" if coupler else text

    def _coupler(self, joint: RobotJoint, name: str, kind: str) -> dict[str, Any]:
        """Return the coupler of a joint that follows another; none, and a note, where there is none."""
        if joint.mimic is None or kind == "fixed":
            return {}
        driver, ratio, offset = joint.mimic
        if driver not in self.robot.joints:
            self.notes.append(f"{joint.name} follows no other: {driver} is no joint of the file")
            return {}
        leader = self.joint_names[driver]
        given = {"ratio": ratio, "offset": f"{offset:.12g} {'rad' if kind == 'revolute' else 'm'}"}
        match kind, _KINDS.get(self.robot.joints[driver].kind):
            case "revolute", "revolute":
                return {"type": "gear", "joint": name, "driver": leader, **given}
            case "prismatic", "prismatic":
                return {"type": "slides", "joint": name, "driver": leader, **given}
            case "prismatic", "revolute":
                ends = {"rack": name, "pinion": leader}
                return {"type": "rack", **ends, "radius": f"{ratio:.12g} m", "offset": given["offset"]}
        self.notes.append(
            f"{joint.name} doesn't follow {driver}: couplers are for hinges, slides, and slides by hinges"
        )
        return {}

    def _stops(self, joint: RobotJoint, turns: bool) -> dict[str, Any]:
        """Return the joint's stops, and its start where 0 isn't between them."""
        limits = joint.limits
        motor = [f"{key} {limits[key]:g}" for key in ("effort", "velocity") if limits.get(key)]
        if motor:
            self.motors.setdefault(", ".join(motor), []).append(joint.name)
        low, high = limits.get("lower", 0.0), limits.get("upper", 0.0)
        if joint.kind == "continuous" or not low < high:
            return {}
        unit, width = ("rad", STOP_ANGLE) if turns else ("m", STOP_LENGTH)
        stiffness = STOP_LOADS * (limits.get("effort") or 1.0) / width
        stop = {"low": f"{low:.12g} {unit}", "high": f"{high:.12g} {unit}"}
        stop |= {"stiffness": f"{stiffness:.6g} {'N m/rad' if turns else 'N/m'}", "width": f"{width:g} {unit}"}
        start = {} if low <= 0.0 <= high else {"angle" if turns else "position": f"{(low + high) / 2:.12g} {unit}"}
        return {**start, "stop": stop}


def _make_names(given: Iterable[str], kind: str, taken: Collection[str] = ()) -> dict[str, str]:
    """Return different names of a scene for those of links, joints or frames, none of them taken."""
    names: dict[str, str] = {}
    for number, name in enumerate(given):
        plain = own = make_name(name) or f"{kind}-{number}"
        others = (f"{own[: LONGEST_NAME - 6]}-{end}" for end in chain([kind], count(number)))
        while plain in taken or plain in names.values():
            plain = next(others)
        names[name] = plain
    return names


def _frame_of_bar(box: Shape) -> Pose:
    """Return the pose of a bar's frame, at the end of its longest edge, in its link's."""
    order = np.argsort(-np.array(box.size), kind="stable")
    axes = np.eye(3)[:, order]
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    along = np.array([-0.5 * max(box.size), 0.0, 0.0])
    return box.pose.then(Pose(axes @ along, axes))


def _make_possible(moments: Array) -> Array:
    """Return principal moments of inertia (3,), raised to the least that a body can have.

    Half their sum less a moment is the integral of a coordinate's square over the mass, which can't be negative.
    """
    squares = np.maximum(0.5 * moments.sum() - moments, 0.0)
    return np.asarray(squares.sum() - squares)


def _turn(pose: Pose) -> dict[str, Any]:
    return {"rotate": turn} if (turn := write_turn(pose)) else {}


def _write(table: dict[str, Any]) -> str:
    return "\n".join(f"{key} = {_value(value)}" for key, value in table.items())


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_value(x)}" for key, x in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)
