"""Links and lumped masses of a flexible body in a scene file: what is bolted to it without a mesh of its own."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from fmd.core.units import PositiveLength, PositiveMass
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.rigid_bodies import Moment, require_possible_moments
from fmd.scene.values import FaceName, LinkName, Plane, Point


class FaceLink(SceneTable):
    """A reference point, as the middle of a bearing, that moves a face rigidly or follows it in the mean.

    Exactly one of ``face``, ``near`` and ``plane`` says which face, as for a marker. Other parts hang on the reference
    by a marker ``{ link = "NAME" }``, and a lumped mass by its ``at``.

    Example:

        [body.bracket.link]
        bearing = { face = "bore", type = "rigid", at = ["42 mm", "0 mm", "30 mm"] }
    """

    # One face of the shape, or several that make one.
    face: FaceName | Annotated[tuple[FaceName, ...], Field(min_length=1, max_length=100)] | None = None
    near: Point | None = None  # A point [m]; the smooth face nearest to it is meant.
    plane: Plane | None = None  # Plane; all of the surface in it is the face.
    # ``"rigid"`` (RBE2): the face moves as a rigid piece; ``"average"`` (RBE3): the reference moves as the face does in
    # the mean, each part of it weighted by its area, and leaves it free to deform.
    type: Literal["rigid", "average"]
    at: Point | None = None  # The reference point [m]; the middle of the face by default.

    @property
    def faces(self) -> tuple[str, ...]:
        """Names of its faces; empty if another key says where it is."""
        return (self.face,) if isinstance(self.face, str) else self.face or ()

    def _check(self) -> None:
        given = [key for key in ("face", "near", "plane") if getattr(self, key) is not None]
        if not given:
            raise FaultError("is missing: a face's name; or give near, a point, or plane, e.g. 'x = 0'", "face")
        if len(given) > 1:
            raise FaultError(f"can't stand beside {given[0]}: a link's face is given in one way", given[1])


class MassOnLink(SceneTable):
    """A rigid body on the reference point of a link: a motor, a wheel, what is bolted on.

    Example:

        [body.bracket.mass]
        motor = { at = "bearing", mass = "0.4 kg", inertia = ["1e-4 kg m^2", "1e-4 kg m^2", "2e-4 kg m^2"] }
    """

    at: LinkName  # Name of the link, or number or set of a point of the deck's links.
    mass: PositiveMass  # [kg]
    centre: Point | None = None  # Centre of mass in the part's coordinates [m]; the reference point by default.
    # Moments about the centre of mass, along the part's x, y and z [kg m²].
    inertia: tuple[Moment, Moment, Moment] = (0.0, 0.0, 0.0)

    def _check(self) -> None:
        require_possible_moments(self.inertia)


class TiedFace(SceneTable):
    """A face that stays together with another, of a part whose mesh has no nodes in common with its own.

    Example:

        [[body.box.mesh.tie]]
        face = "lid-rim"
        onto = "box-rim"
    """

    face: FaceName  # The face that follows: that of the finer mesh, on which no rigid link or rigid attachment is.
    onto: FaceName  # The face that it follows.
    # How far apart facets of both may be [m]; a tenth of a facet's size by default.
    within: PositiveLength | None = None
