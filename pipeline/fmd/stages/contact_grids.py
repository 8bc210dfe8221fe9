"""Grids of contacts with a half-space's near field: which contacts have one, where on its face, and how wide."""

from functools import cached_property
from typing import Any

import numpy as np

from fmd.contact.near_field import CurvedPlace, find_curved_place, with_near_field
from fmd.contact.touching_body import ContactPlane, ContactPoints
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.contact import GRID_MARGIN, ONE_BALL, RESOLVED_BY_MESH
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.scene.scene import Scene
from fmd.stages.loop_closing import given_joints


class StartPose:
    """A mechanism at the start, undeformed, as far as contacts need it."""

    def __init__(self, scene: Scene, mechanism: Mechanism) -> None:
        self._scene, self._mechanism = scene, mechanism

    @cached_property
    def _kinematics(self) -> Kinematics:
        q, v = given_joints(self._scene, self._mechanism)
        return Kinematics(self._mechanism, np.zeros(1), q[None], v[None])

    def frame(self, body: str) -> tuple[Array, Array]:
        """Return the origin (3,) and the axes (3, 3) of a body's frame."""
        frame = self._kinematics.frames[self._mechanism.number_of(body)]
        return frame.origin[0], frame.rotation[0]

    def origin(self, body: str) -> Array:
        """Return the origin of a rigid body's frame in the scene's coordinates of the body, shape (3,)."""
        name, marker = next(iter(self._mechanism.links[self._mechanism.number_of(body)].markers.items()))
        table: Any = self._scene.body[body]
        return np.array(table.marker[name].at) - marker.position

    def loads(self, height: float, normal: Array | None = None, rolls: bool = False) -> tuple[float, float]:
        """Return twice the weight [N], and the energy of a fall from a height [J], onto a plane or wherever to.

        What ``rolls`` presses a plane with no more than its motion towards it, whatever its spin and its way along it.
        """
        gravity = self._mechanism.gravity
        pull = float(np.linalg.norm(gravity)) if normal is None else max(0.0, -float(gravity @ normal))
        weight, energy = self._mechanism.mass * pull, float(self._kinematics.energies[0][0])
        if rolls and normal is not None:
            energy = float(self._kinematics.momentum[0] @ normal) ** 2 / (2.0 * self._mechanism.mass)
        return 2.0 * weight, energy + weight * max(0.0, height)

    def rolls(self, body: str, at: CurvedPlace) -> bool:
        """Return true of a body alone in the mechanism, and free, with a spherical face about its centre of mass."""
        link, *others = self._mechanism.links
        own = self._kinematics.momenta[0]
        apart = own.moment[0] / link.integrals.mass - (at.place + at.axes[0] / at.curvatures[0])
        round_off = ONE_BALL / at.curvatures[0]
        return (
            not others
            and link.n_rates == 6
            and at.curvatures[0] - at.curvatures[1] < ONE_BALL * at.curvatures[0]
            and float(np.linalg.norm(apart)) < round_off
        )


def refine_near_field(
    scene: Scene, plane: ContactPlane, body: str, points: ContactPoints, start: StartPose
) -> tuple[ContactPoints, str]:
    """Return a body's points, with a grid on the face of a contact if it takes one, and what gives its near field.

    Raises
    ------
    InputError
        The scene asks for a grid, and the face or the modes have no place for it, or nothing tells its size.
    """
    contact, key = scene.contact[plane.name], f"contact.{plane.name}"
    if contact.near_field == "mesh" or points.elastic is None or plane.face in points.surfaces or len(points.soft):
        _require_mesh(
            scene, plane, "is of several materials, touches a body, too, or is of a body with more than 1,000 points"
        )
        return points, "mesh"
    at = None
    if not points.is_flat(plane.face):
        at = find_curved_place(points, plane.face, start.frame(body)[1].T @ plane.normal)
    if at is None:
        _require_mesh(scene, plane, "is no sphere, cylinder, cone or ellipsoid that is lowest within it at the start")
        return points, "mesh"
    asked, half = contact.near_field == "half-space", 0.5 * (contact.width or 0.0)
    if contact.width is None:
        origin, R = start.frame(body)
        height = float((origin + R @ at.place - plane.position) @ plane.normal) + plane.clearance
        loads = start.loads(height, plane.normal, start.rolls(body, at))
        half = GRID_MARGIN * at.half_width(*points.elastic, *loads)
    if half == 0.0 and asked:
        fault = "is needed: nothing falls, moves or weighs on the plane that would tell the contact's width"
        raise InputError(scene.file, f"{key}.width", None, fault)
    if half == 0.0 or (not asked and half > RESOLVED_BY_MESH * at.spacing):
        return points, "mesh"
    return _add_grid(scene, plane, body, points, at, half, asked)


def _require_mesh(scene: Scene, plane: ContactPlane, why: str) -> None:
    """Raise ``InputError`` where a half-space is asked for."""
    if scene.contact[plane.name].near_field == "half-space":
        key, fault = f"contact.{plane.name}.near_field", f"{plane.face} {why}; 'mesh' works"
        raise InputError(scene.file, key, "half-space", fault)


def _add_grid(
    scene: Scene, plane: ContactPlane, body: str, points: ContactPoints, at: CurvedPlace, half: float, asked: bool
) -> tuple[ContactPoints, str]:
    try:
        found = with_near_field(
            points, plane.face, at, half, scene.contact[plane.name].points, _travels(scene, plane.name, body)
        )
    except ValueError as error:
        if not asked:
            return points, f"mesh, since {error}"
        raise InputError(scene.file, f"contact.{plane.name}.near_field", "half-space", str(error)) from error
    follows = " that follows the contact" if any(found.grids[plane.face].travels) else ""
    size = f"{len(found.faces[plane.face])} points and a width of {2e3 * half:.3g} mm"
    return found, f"half-space, a grid of {size}{follows}"


def _travels(scene: Scene, contact: str, body: str) -> bool:
    """Return true if a contact's grid may follow it: nothing but forces depends on which points are pressed."""
    own = scene.contact[contact]
    alone = sum(end.partition(".")[0] == body for each in scene.contact.values() for end in each.between) == 1
    return alone and not own.damping and not own.wear
