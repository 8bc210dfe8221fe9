"""Grids of contacts with a half-space's near field: which contacts have one, where on its face, and how wide."""

from functools import cached_property
from typing import Any

import numpy as np

from fmd.contact.near_field import CurvedPlace, find_curved_place, with_near_field
from fmd.contact.touching_body import ContactPlane, ContactPoints
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.contact import GRID_MARGIN, RESOLVED_BY_MESH
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

    def loads(self, height: float, normal: Array | None = None) -> tuple[float, float]:
        """Return twice the weight [N], and the energy of a fall from a height [J], onto a plane or wherever to."""
        gravity = self._mechanism.gravity
        pull = float(np.linalg.norm(gravity)) if normal is None else max(0.0, -float(gravity @ normal))
        weight = self._mechanism.mass * pull
        return 2.0 * weight, float(self._kinematics.energies[0][0]) + weight * max(0.0, height)


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
        half = GRID_MARGIN * at.half_width(*points.elastic, *start.loads(height, plane.normal))
    if half == 0.0 and asked:
        fault = "is needed: nothing falls, moves or weighs on the plane that would tell the contact's width"
        raise InputError(scene.file, f"{key}.width", None, fault)
    if half == 0.0 or (not asked and half > RESOLVED_BY_MESH * at.spacing):
        return points, "mesh"
    return _add_grid(scene, plane, points, at, half, asked)


def _require_mesh(scene: Scene, plane: ContactPlane, why: str) -> None:
    """Raise ``InputError`` where a half-space is asked for."""
    if scene.contact[plane.name].near_field == "half-space":
        key, fault = f"contact.{plane.name}.near_field", f"{plane.face} {why}; 'mesh' works"
        raise InputError(scene.file, key, "half-space", fault)


def _add_grid(
    scene: Scene, plane: ContactPlane, points: ContactPoints, at: CurvedPlace, half: float, asked: bool
) -> tuple[ContactPoints, str]:
    assert points.elastic is not None
    try:
        found = with_near_field(points, plane.face, at, half, scene.contact[plane.name].points, *points.elastic)
    except ValueError as error:
        if not asked:
            return points, f"mesh, since {error}"
        raise InputError(scene.file, f"contact.{plane.name}.near_field", "half-space", str(error)) from error
    return found, f"half-space, a grid of {len(found.faces[plane.face])} points and a width of {2e3 * half:.3g} mm"
