"""Discreet marks of joints, springs, loads and the ground in pictures of a mechanism."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.shown import WEIGHTLESS
from fmd.scene.loads import MarkerLoad, MotionDrive
from fmd.stages.parent_joint import ground_place, joint_axes, place_axes

if TYPE_CHECKING:
    from fmd.render.moving_bodies import MovingLine, MovingShape
    from fmd.render.surface import Surface
    from fmd.scene.joints.any_joint import Joint
    from fmd.stages.pipeline import Pipeline

JOINT, GROUND, SPRING, BUSHING, LOAD = "#4b5563", "#9aa2ad", "#5b7f6b", "#b08a3e", "#b4442f"
_NEAR = 5.0  # radii of a mark: a body's points so near tell how far a pin reaches
_COILS, _PER_COIL = 9, 12
_WIRE = 1.3  # radius of a coil over that of a mark


class Marks:
    """Marks of a run's joints, springs and ground at output times of chosen numbers, (n_frames,).

    The mechanism has an extent [m]; ``up`` (3,) is upwards in space.
    """

    def __init__(self, run: Pipeline, chosen: IntArray, size: float, up: Array | None) -> None:
        self.run, self.chosen, self.up = run, chosen, up
        self.radius = 0.011 * size  # of a mark over the mechanism's size
        self.kinematics = run.motion.kinematics

    def position(self, place: str) -> Array:
        """Return a marker or a place on the ground in space at the chosen times, shape (n_frames, 3) [m]."""
        body, _, marker = place.partition(".")
        if body == "ground":
            return self._at_rest(ground_place(self.run.scene, place)[0])[0]
        number = self.run.mechanism.number_of(body)
        return self.kinematics.marker_position(number, marker)[self.chosen]

    def rotation(self, place: str) -> Array:
        """Return the axes of a place's body in space, those of space for the ground, shape (n_frames, 3, 3)."""
        body = place.partition(".")[0]
        if body == "ground":
            return self._at_rest(np.zeros(3))[1]
        return self.kinematics.frames[self.run.mechanism.number_of(body)].rotation[self.chosen]

    def shapes(self) -> list[MovingShape]:
        """Return the marks of joints, bushings and bearings, and the ground under those that it holds."""
        from fmd.render.moving_bodies import MovingShape
        from fmd.render.solids import make_ball, make_cylinder

        r, origin, found = self.radius, np.zeros(3), []
        for name in self.run.scene.joint:
            found += self._of_a_joint(name)
        for name, element in self._elements("ball", "disc"):
            place = element.between[1]
            if element.mark == "disc":
                place = element.between[0]
                axis = _unit(place_axes(self.run.scene, place) @ np.array(element.axis))
                surface = make_cylinder(-0.8 * r * axis, 0.8 * r * axis, 1.7 * r)
            else:
                surface = make_ball(origin, 1.2 * r)
            found.append(MovingShape(surface, BUSHING, self.position(place), self.rotation(place), name))
        return found + self._ground()

    def planes(self, places: Array) -> list[MovingShape]:
        """Return a thin plate for each plane of the ground that bodies may touch, below points (n, 3) [m] of these."""
        from fmd.render.moving_bodies import MovingShape
        from fmd.render.solids import axes_along, make_box

        found = []
        for name, contact in self.run.scene.contact.items():
            if not contact.on_ground:
                continue
            place = contact.between[0]
            axes = axes_along(place_axes(self.run.scene, place) @ np.array(contact.normal))
            thick = 0.5 * self.radius  # thickness of a plane over the radius of a mark
            low, high = (places @ axes).min(axis=0), (places @ axes).max(axis=0)
            middle, edges = (low + high) / 2, high - low + 6 * self.radius
            middle[2] = self.position(place)[0] @ axes[:, 2] - thick / 2
            edges[2] = thick
            plate = make_box(edges, np.zeros(3), axes)
            origin, rotation = self._at_rest(axes @ middle)
            found.append(MovingShape(plate, GROUND, origin, rotation, f"contact.{name}"))
        return found

    def loads(self) -> list[MovingShape]:
        """Return an arrow to where each force acts, with one head, and each torque, with two, along its direction."""
        from fmd.render.moving_bodies import MovingShape

        found = []
        for name, drive in self.run.scene.drive.items():
            if isinstance(drive, MotionDrive):
                continue
            if isinstance(drive, MarkerLoad):
                place, axis = drive.marker, _unit(drive.direction)
                axes = self.rotation(place) @ place_axes(self.run.scene, place)
                if not drive.following:
                    axes = self._at_rest(np.zeros(3))[1]
            else:
                joint = self.run.scene.joint[drive.joint]
                place, axis = joint.child, self._axis_in_child(joint)
                axes = self.rotation(place)
            arrow = _arrow(axis, self.radius, heads=2 if drive.unit == "N m" else 1)
            found.append(MovingShape(arrow, LOAD, self.position(place), axes, f"drive.{name}, {drive.type}"))
        return found

    def gravity(self, places: Array) -> list[MovingShape]:
        """Return an arrow along gravity at the side of points (n, 3) [m], none in a scene without weight."""
        from fmd.render.moving_bodies import MovingShape
        from fmd.render.solids import axes_along

        pull = np.array(self.run.scene.simulation.gravity)
        size = float(np.linalg.norm(pull))
        if size <= WEIGHTLESS:
            return []
        axes = axes_along(pull)  # the last one down
        low, high = (places @ axes).min(axis=0), (places @ axes).max(axis=0)
        wide = int(np.argmax((high - low)[:2]))
        beside = np.where(np.arange(3) == wide, low - 6 * self.radius, (low + high) / 2)
        arrow = _arrow(axes[:, 2], self.radius, heads=1)
        return [MovingShape(arrow, LOAD, *self._at_rest(axes @ beside), f"gravity, {size:.4g} m/s²")]

    def _at_rest(self, place: Array) -> tuple[Array, Array]:
        """Return a place and the axes of space at the chosen times, shapes (n_frames, 3) and (n_frames, 3, 3)."""
        return np.tile(place, (len(self.chosen), 1)), np.tile(np.eye(3), (len(self.chosen), 1, 1))

    def lines(self) -> list[MovingLine]:
        """Return springs as coils, kept distances as lines, and the rails of slides on the ground."""
        from fmd.render.moving_bodies import MovingLine

        found = []
        for _, spring in self._elements("coil"):
            one, other = (self.position(place) for place in spring.between)
            found.append(MovingLine(_coil(one, other, _WIRE * self.radius), SPRING, 1.8))
        for joint in self.run.scene.joint.values():
            if joint.mark.shape == "line":
                ends = [self.position(place) for place in (joint.parent, joint.child)]
                found.append(MovingLine(np.stack(ends, axis=1), JOINT, 2.0))
            elif joint.mark.rail and joint.parent.startswith("ground"):
                axis = self._axis_in_parent(joint)
                start, places = self.position(joint.parent)[0], self.position(joint.child)
                along = np.append((places - start) @ axis, 0.0)
                reach = np.array([along.min() - 3 * self.radius, along.max() + 3 * self.radius])
                rail = start + reach[:, None] * axis
                found.append(MovingLine(np.tile(rail, (len(self.chosen), 1, 1)), GROUND, 2.5))
        return found

    def _elements(self, *marks: str) -> list[tuple[str, Any]]:
        """Return the scene's force elements that have one of some marks, all if none is given, with their names."""
        return [
            (f"{kind}.{name}", element)
            for kind, table in self.run.scene.elements.items()
            for name, element in table.items()
            if not marks or element.mark in marks
        ]

    def _of_a_joint(self, name: str) -> list[MovingShape]:
        """Return the mark of a joint, which moves with its child: a pin, a ball or a slide."""
        from fmd.render.moving_bodies import MovingShape
        from fmd.render.solids import axes_along, make_ball, make_box, make_cylinder

        joint = self.run.scene.joint[name]
        r, origin = self.radius, np.zeros(3)
        if joint.mark.shape == "ball":
            surface = make_ball(origin, 1.25 * r)
        elif joint.mark.shape == "pin":
            axis = self._axis_in_child(joint)
            half = max(1.5 * r, *(self._reach(place, axis) + 0.4 * r for place in (joint.parent, joint.child)))
            if self._is_around(joint.child):
                return []
            surface = make_cylinder(-half * axis, half * axis, 0.8 * r)
        elif joint.mark.shape == "box":
            axis = self._axis_in_child(joint)
            surface = make_box(np.array(joint.mark.edges) * r, origin, axes_along(axis))
        else:
            return []
        places = self.position(joint.child), self.rotation(joint.child)
        return [MovingShape(surface, JOINT, *places, f"joint.{name}, {joint.type}")]

    def _axis_in_child(self, joint: Joint) -> Array:
        """Return a joint's axis in the axes of its child's body, z of one without."""
        return _unit(joint_axes(self.run.scene, joint).axis_in_child(joint.axis_of_child))

    def _axis_in_parent(self, joint: Joint) -> Array:
        """Return a joint's axis in the axes of its parent's body, z of one without."""
        return _unit(joint_axes(self.run.scene, joint).in_parent @ joint.direction("axis"))

    def _reach(self, place: str, axis: Array) -> float:
        """Return how far a flexible body reaches along an axis around one of its markers [m]."""
        body, _, marker = place.partition(".")
        if body not in self.run.parts or not self.run.parts[body].has_stress:
            return 0.0
        reduced = self.run.bodies[body]
        away = reduced.x[self.run.parts[body].surface.nodes] - reduced.markers[marker].position
        near = away[np.linalg.norm(away, axis=1) < _NEAR * self.radius]
        return float(np.abs(near @ axis).max(initial=0.0))

    def _is_around(self, place: str) -> bool:
        """Return true if a body surrounds its joint, so that a mark would lie in its bore."""
        body = place.partition(".")[0]
        return body in self.run.wholes and self.run.wholes[body].has_mesh and self.run.wholes[body].mesh.sectors > 1

    def _ground(self) -> list[MovingShape]:
        """Return a small pyramid at each place of the ground that holds something."""
        from fmd.render.moving_bodies import MovingShape
        from fmd.render.solids import make_pyramid

        held: dict[str, tuple[str, Array]] = {}  # what holds on to a place, and its axis in space
        for joint in self.run.scene.joint.values():
            for place, other in ((joint.parent, joint.child), (joint.child, joint.parent)):
                holds = place.partition(".")[0] == "ground" and joint.mark.stands
                if holds and not self._is_around(other):
                    find = self._axis_in_parent if place == joint.parent else self._axis_in_child
                    held.setdefault(place, (other, find(joint)))
        for between in [element.between for _, element in self._elements()]:
            for place, other in (between, between[::-1]):
                if place.partition(".")[0] == "ground":
                    held.setdefault(place, (other, np.array([0.0, 0.0, 1.0])))
        shapes = []
        for place, (other, axis) in held.items():
            along = self._away(place, other, axis)
            pyramid = make_pyramid(np.zeros(3), along, 3.2 * self.radius, 3.4 * self.radius)
            shapes.append(MovingShape(pyramid, GROUND, self.position(place), self.rotation(place), place))
        return shapes

    def _away(self, place: str, other: str, axis: Array) -> Array:
        """Return the side of the ground: below what stands on it, above what hangs from it, behind what turns."""
        if self.up is None:
            return -axis
        body = self.run.mechanism.number_of(other.partition(".")[0])
        frame, momenta = self.kinematics.frames[body], self.kinematics.momenta[body]
        mass = self.run.mechanism.links[body].integrals.mass
        centre = frame.origin + np.einsum("tij,tj->ti", frame.rotation, momenta.moment / mass)
        above = float(np.mean((centre[self.chosen] - self.position(place)) @ self.up))
        return -self.up if above >= -2 * self.radius else self.up


def _unit(direction: Any) -> Array:
    along = np.array(direction, dtype=float)
    return np.asarray(along / np.linalg.norm(along))


def _arrow(axis: Array, r: float, heads: int) -> Surface:
    """Return an arrow along a unit vector (3,) to the origin, for marks of a radius [m]."""
    from fmd.render.solids import join_surfaces, make_cylinder, make_pyramid

    back = -3.0 * r * axis  # the length of a head
    tips = [make_pyramid(head * back, -axis, 3.0 * r, 2.4 * r) for head in range(heads)]
    return join_surfaces([*tips, make_cylinder(4.0 * back, back, 0.4 * r)])


def _coil(start: Array, end: Array, radius: float) -> Array:
    """Return a coil between two places that move, (n_frames, 3) each, shape (n_frames, n_points, 3) [m]."""
    share = np.linspace(0.12, 0.88, _COILS * _PER_COIL + 1)
    angle = 2 * np.pi * np.arange(len(share)) / _PER_COIL
    points = np.empty((len(start), len(share) + 4, 3))
    for k, (one, other) in enumerate(zip(start, end, strict=True)):
        along = other - one
        aside = np.eye(3)[int(np.argmin(np.abs(end[0] - start[0])))]  # of one frame, so that the coil doesn't jump
        across = np.cross(along, aside)
        across /= max(float(np.linalg.norm(across)), 1e-30)
        third = np.cross(along, across) / max(float(np.linalg.norm(along)), 1e-30)
        wound = radius * (np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * third)
        inner = one + share[:, None] * along + wound
        points[k] = np.concatenate([[one, one + share[0] * along], inner, [one + share[-1] * along, other]])
    return points
