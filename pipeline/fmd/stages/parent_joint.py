"""Axes of places and joints, the joint that carries a flexible body, and what it means for the body's modes."""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.round_off import EXACT, SUMMED
from fmd.scene.joints.any_joint import Joint
from fmd.scene.joints.joint import CarryingJoint
from fmd.scene.loads import Drive, MarkerLoad, find_motion
from fmd.scene.scene import Scene

Direction = tuple[float, float, float]


@dataclass(frozen=True)
class ParentJoint:
    """The joint that carries a body, as far as the body's reduction depends on it."""

    marker: str  # the body's marker at the joint; empty in a scene of parts alone
    axis: Direction  # normal of the plane of motion: the hinge's axis, or that of the other hinges
    # Directions (k, 3) about which the joint lets the body turn by itself: its frame floats about them.
    free: tuple[Direction, ...]
    floating: bool  # holds nothing at all: a free joint, or none
    welded: bool  # holds everything: a fixed joint
    prescribed: bool  # its motion is given
    in_plane: bool  # every joint of the scene keeps to the plane across ``axis``, and so do gravity and all loads
    # Number of the only coordinate axis that the body turns about in space, on a hinge to the ground; else -1.
    normal: int = -1
    # Markers where other bodies hang or loads act, by name, and if those keep to the plane of motion.
    loaded: tuple[tuple[str, bool], ...] = ()

    @property
    def free_directions(self) -> Array:
        """Unit vectors about which the body turns freely, shape (k, 3)."""
        free = np.array(self.free, dtype=float).reshape(-1, 3)
        return np.asarray(free / np.linalg.norm(free, axis=1, keepdims=True))

    @property
    def plane(self) -> Array | None:
        """Normal of the plane of motion, shape (3,); ``None`` if the scene moves in space."""
        return np.array(self.axis) if self.in_plane else None


def read_parent_joint(scene: Scene, body: str) -> ParentJoint:
    """Read from a scene how the joint that carries a flexible body holds it."""
    gravity = scene.moves and any(scene.simulation.gravity)
    if body not in scene.carrying:  # a scene of parts alone
        axis = (0.0, 0.0, 1.0)
        loaded = _loaded_markers(scene, body, axis)
        return ParentJoint("", axis, (), floating=True, welded=False, prescribed=False, in_plane=False, loaded=loaded)
    name = scene.carrying[body]
    joint = scene.joint[name]
    prescribed = find_motion(scene.drive, name) is not None
    hinges = [_axis_in_space(scene, other) for other in scene.joint.values() if other.kind.keeps_plane_across_axis]
    into_body = axes_in_space(scene, body).T
    axis = _turned(into_body, hinges[0]) if hinges else (0.0, 0.0, 1.0)
    if joint.kind.is_hinge:
        x, y, z = joint_axes(scene, joint).axis_in_child(joint.direction("axis"))
        axis = float(x), float(y), float(z)
    normal = _turned(into_body.T, axis)
    kept = [_parallel(normal, hinge) for hinge in hinges]
    kept += [other.kind.may_keep_plane for other in scene.joint.values()]
    slides = [_axis_in_space(scene, other) for other in scene.joint.values() if other.kind.is_slide]
    kept += [_across(normal, slide) for slide in slides]
    kept += [not gravity or _across(normal, scene.simulation.gravity)]
    kept += [_acts_in_plane(scene, drive, normal) for drive in scene.drive.values()]
    kept += [not any(scene.elements.values()), not scene.contact]  # which may pull and push across any plane
    free: tuple[Direction, ...] = ()
    if joint.kind.is_hinge and not prescribed:
        free = (axis,)
    elif joint.kind.is_ball:
        free = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    on_ground = joint.parent.partition(".")[0] == "ground"
    about_an_axis = joint.kind.is_hinge and on_ground and np.count_nonzero(axis) == 1
    return ParentJoint(
        marker=joint.child.partition(".")[2],
        axis=axis,
        free=free,
        floating=joint.kind.is_free,
        welded=joint.kind.is_weld,
        prescribed=prescribed,
        in_plane=all(kept),
        normal=int(np.argmax(np.abs(axis))) if about_an_axis else -1,
        loaded=_loaded_markers(scene, body, normal),
    )


def _loaded_markers(scene: Scene, body: str, normal: Direction) -> tuple[tuple[str, bool], ...]:
    closing = [scene.joint[name] for name in scene.closing]
    ends = [*(joint.parent for joint in scene.joint.values()), *(joint.child for joint in closing)]
    places = dict.fromkeys(ends, True)
    if any(joint.kind.is_weld for joint in closing):
        # What walls clamp at both ends may buckle across the plane, too.
        clamps = [joint for joint in scene.joint.values() if joint.kind.is_weld]
        places |= {at: False for joint in clamps for at in (joint.parent, joint.child)}
    for drive in scene.drive.values():
        if isinstance(drive, MarkerLoad):
            places[drive.marker] = places.get(drive.marker, True) and _acts_in_plane(scene, drive, normal)
    places |= {at: False for table in scene.elements.values() for element in table.values() for at in element.between}
    own = {place.partition(".")[2]: flat for place, flat in places.items() if place.partition(".")[0] == body}
    return tuple(sorted(own.items()))


def _acts_in_plane(scene: Scene, drive: Drive, normal: Direction) -> bool:
    """Return False for a force or torque at a point that acts out of the plane across a direction in space."""
    if not isinstance(drive, MarkerLoad):
        return True
    turned = axes_in_space(scene, drive.marker.partition(".")[0]) if drive.following else np.eye(3)
    turned = turned @ place_axes(scene, drive.marker) if drive.following else turned
    direction = _turned(turned, drive.direction)
    return _parallel(normal, direction) if drive.turns else _across(normal, direction)


def _axis_in_space(scene: Scene, joint: Joint) -> Direction:
    x, y, z = joint.direction("axis")
    into_space = axes_in_space(scene, joint.parent.partition(".")[0]) @ joint_axes(scene, joint).in_parent
    return _turned(into_space, (x, y, z))


def _turned(R: Array, direction: Direction) -> Direction:
    if (np.eye(3) == R).all():
        return direction
    x, y, z = R @ np.array(direction, dtype=float)
    return float(x), float(y), float(z)


def _parallel(a: Direction, b: Direction) -> bool:
    return bool(np.linalg.norm(np.cross(a, b)) <= SUMMED * np.linalg.norm(a) * np.linalg.norm(b))


def _across(a: Direction, b: Direction) -> bool:
    return bool(abs(np.dot(a, b)) <= SUMMED * np.linalg.norm(a) * np.linalg.norm(b))


@dataclass(frozen=True)
class JointAxes:
    """Axes of a joint that carries a body."""

    in_parent: Array  # (3, 3): rotation from the joint's axes into those of the parent's body, or into space
    in_child: Array  # (3, 3): rotation from the joint's axes, with its coordinates at 0, into those of the child's body

    @property
    def of_child(self) -> Array:
        """Rotation (3, 3) from the child's body axes into those of the parent's, with the coordinates at 0."""
        return np.asarray(self.in_parent @ self.in_child.T)

    def axis_in_child(self, direction: tuple[float, float, float] | Array) -> Array:
        """Return a direction (3,) of the joint in the child's body axes, without round-off where it is along them."""
        axis = self.in_child @ np.array(direction, dtype=float)
        return np.asarray(np.where(np.abs(axis) > EXACT * np.linalg.norm(axis), axis, 0.0))


def ground_place(scene: Scene, place: str) -> tuple[Array, Array]:
    """Return the position (3,) [m] of ``"ground"`` or a place on it, and the rotation (3, 3) from its axes to space."""
    name = place.partition(".")[2]
    if not name:
        return np.zeros(3), np.eye(3)
    return np.array(scene.ground[name].at), scene.ground[name].matrix


def place_axes(scene: Scene, place: str) -> Array:
    """Return the rotation (3, 3) from the axes of a marker or a place into those of its body, or into space."""
    body, _, name = place.partition(".")
    return ground_place(scene, place)[1] if body == "ground" else scene.body[body].marker[name].matrix


def joint_axes(scene: Scene, joint: Joint) -> JointAxes:
    """Return the axes of a joint; those of one whose own turn is its start are its parent's."""
    in_parent = place_axes(scene, joint.parent)
    if isinstance(joint, CarryingJoint) and not joint.starts_turned:
        in_parent = in_parent @ joint.matrix
    return JointAxes(in_parent, place_axes(scene, joint.child))


def axes_in_space(scene: Scene, body: str) -> Array:
    """Return the rotation (3, 3) from a body's axes into space with all joints at 0."""
    carrying, axes = scene.carrying, np.eye(3)
    while body in carrying:
        joint = scene.joint[carrying[body]]
        axes = joint_axes(scene, joint).of_child @ axes
        body = joint.parent.partition(".")[0]
    return axes
