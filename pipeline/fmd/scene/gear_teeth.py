"""Gears whose teeth push one another in motion, in a scene file."""

from collections.abc import Callable, Iterator
from typing import Annotated, Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.units import NonNegativeTime, Positive, Torque
from fmd.scene.gears import GearMesh, find_pair
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.runs import name_methods
from fmd.scene.values import BodyName


class GearTeethContact(SceneTable):
    """Teeth of two spur gears in motion, each on a hinge of the ground, whose flanks push but don't pull.

    The force follows from the angles by what the static mesh of both gears gives: pairs of teeth come and go, and part
    where the flanks do. At the start flanks touch without load, those by which the pinion drives as it turns about its
    hinge's axis. The gears' modes don't take part: the teeth's flexibility is that of their meshes, from the bores on.

    Example:

        [gear_mesh.first]
        pinion = "pinion"
        wheel = "wheel"
        torque = "100 N m"
        damping = "2 us"
    """

    # Bodies, both spur gears.
    pinion: BodyName
    wheel: BodyName
    # On the pinion, up to four times of which the forces are tabulated [N m]; beyond that they go on straight.
    torque: Annotated[Torque, Positive]
    # Time τ of the damping of the teeth's flexibility [s]: the damping ratio is ``½ ω τ`` at a rate ω.
    damping: NonNegativeTime = 0.0


def check_gears(scene: Any) -> Iterator[FaultError]:
    """Yield the faults of a scene's gears in mesh, in outputs and in motion: of teeth, hinges, methods and start."""
    for number, output in enumerate(scene.output):
        if isinstance(output, GearMesh):
            yield from _faults(scene, ("output", number), output, lambda output: output.distance)
    for name, own in scene.gear_mesh.items():
        if name in {**scene.contact, **scene.joint}:
            yield FaultError("is the name of a contact or a joint, too, whose results have it", "gear_mesh", name)
        for key in ("pinion", "wheel"):
            if getattr(own, key) in scene.pieces:
                yield FaultError(
                    "is in pieces, which have no teeth of a gear; pieces = 1 works", "gear_mesh", name, key
                )
        yield from _faults(scene, ("gear_mesh", name), own, lambda own: _distance(scene, own))
    if not scene.gear_mesh or scene.simulation_table is None:
        return
    for number, run in enumerate(scene.simulation_table.run):
        if not (run.takes_contact and run.takes_memory):  # teeth damp, and their steps end at no touch
            mend = f"{name_methods('takes_contact', 'takes_memory')} do"
            yield FaultError(f"takes no gears in mesh; {mend}", "simulation", "run", number, "integrator")
    if scene.simulation_table.start == "steady":
        yield FaultError(
            "doesn't know of gears in mesh; 'undeformed', 'equilibrium' and 'periodic' do", "simulation", "start"
        )


def _faults(
    scene: Any, path: tuple[str | int, ...], own: Any, distance: Callable[[Any], float | None]
) -> Iterator[FaultError]:
    """Yield the fault of two gears that don't mesh, if they have one."""
    try:
        find_pair(own.pinion, own.wheel, distance(own), scene.body)
    except FaultError as fault:
        apart = isinstance(own, GearTeethContact) and fault.path == ("distance",)
        fault.path = _place_of_hinge(scene, own) if apart else (*path, *fault.path)
        yield fault


def _distance(scene: Any, own: GearTeethContact) -> float:
    """Return the distance of the hinges of two gears across the first one's axis [m]."""
    (first, axis), (second, _) = (_hinge(scene, key, getattr(own, key)) for key in ("pinion", "wheel"))
    return float(np.linalg.norm(np.cross(second - first, axis)) / np.linalg.norm(axis))


def _hinge(scene: Any, key: str, body: str) -> tuple[Array, Array]:
    """Return where the hinge of a gear is on the ground, and its axis in space."""
    origin, z = np.zeros(3), np.array([0.0, 0.0, 1.0])
    joint = scene.joint.get(scene.carrying.get(body, ""))
    if joint is None:
        if body in scene.body:
            raise FaultError("hangs on no joint; a revolute one on the ground is needed", key)
        return origin, z
    if not joint.kind.is_hinge or joint.parent.partition(".")[0] != "ground":
        raise FaultError("isn't carried by a revolute joint on the ground, which teeth in motion need", key)
    place, axis = scene.ground.get(joint.parent.partition(".")[2]), joint.matrix @ joint.direction("axis")
    return (origin, axis) if place is None else (np.array(place.at), place.matrix @ axis)


def _place_of_hinge(scene: Any, own: GearTeethContact) -> tuple[str | int, ...]:
    """Return the key that sets how far two gears are apart: of the wheel's hinge, or the pinion's."""
    joints = [scene.carrying[body] for body in (own.wheel, own.pinion)]
    places = [scene.joint[joint].parent.partition(".")[2] for joint in joints]
    return next((("ground", place, "at") for place in places if place in scene.ground), ("joint", joints[0], "parent"))
