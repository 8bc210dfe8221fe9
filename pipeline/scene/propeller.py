"""Propellers in a scene file: their shape and how they are divided into elements."""

from __future__ import annotations

from math import pi
from typing import Annotated, Literal

from pydantic import Field, model_validator

from pipeline.core.units import Angle, PositiveLength
from pipeline.scene.bodies import Solid
from pipeline.scene.reading import FaultError, SceneTable
from pipeline.scene.values import Count, Number


class PropellerMesh(SceneTable):
    """How a propeller is divided.

    Parameters
    ----------
    element : str
        ``tetrahedron`` puts six of them in place of each hexahedron.
    order : int
        Polynomial order of the displacement in an element; elements of order 2 have curved edges.
    sleeve : tuple of int
        Elements around, along the axis and along the radius.
    joint, blade : tuple of int
        Elements along the chord, which is the sleeve's axis at the root, across the thickness and along the radius; of
        each joint and each blade.
    growth : float
        Radial extent of a blade's elements at its tip over that at its root.
    """

    element: Literal["hexahedron", "tetrahedron"] = "hexahedron"
    order: Annotated[int, Field(strict=True, ge=1, le=2)] = 2
    sleeve: tuple[Count, Count, Count] = (66, 10, 3)
    joint: tuple[Count, Count, Count] = (10, 8, 12)
    blade: tuple[Count, Count, Count] = (10, 8, 27)
    growth: Annotated[Number, Field(ge=0.05, le=20.0)] = 4.0


class Propeller(Solid):
    """A propeller about the z axis: a sleeve, and blades that grow out of it through joints.

    Parameters
    ----------
    blades : int
        How many; the first is on the x axis.
    bore, hub, root, diameter : float
        Diameters [m]: of the sleeve's bore, of the sleeve, of the circle where joints become blades, of the whole.
    length : float
        Extent of the sleeve along z [m].
    chord, thickness : tuple of float
        Of the blade's section [m], at equal distances from root to tip.
    pitch : tuple of float
        Angle of the blade's section against the plane of rotation [rad], likewise.
    camber : float
        Rise of a section's middle line over its chord.
    edge : float
        Thickness of a section's edges over that of its middle.
    seat : float, optional
        Angle that each joint takes of the sleeve [rad]; by default its share of the elements around.
    mesh
        Its elements.
    """

    shape: Literal["propeller"]
    blades: Annotated[int, Field(strict=True, ge=2, le=24)]
    bore: PositiveLength
    hub: PositiveLength
    root: PositiveLength
    diameter: PositiveLength
    length: PositiveLength
    chord: Annotated[tuple[PositiveLength, ...], Field(min_length=1, max_length=20)]
    thickness: Annotated[tuple[PositiveLength, ...], Field(min_length=1, max_length=20)]
    pitch: Annotated[tuple[Angle, ...], Field(min_length=1, max_length=20)]
    camber: Annotated[Number, Field(ge=-0.2, le=0.2)] = 0.0
    edge: Annotated[Number, Field(ge=0.05, le=1.0)] = 0.3
    seat: Annotated[Angle, Field(gt=0)] | None = None
    mesh: PropellerMesh

    @property
    def faces(self) -> tuple[str, ...]:
        """The bore, the sleeve's ends at the least and the greatest z, and three faces of each blade."""
        of_blades = (f"{face}-{k + 1}" for k in range(self.blades) for face in ("tip", "pressure", "suction"))
        return ("bore", "back", "front", *of_blades)

    @property
    def parts(self) -> tuple[str, ...]:
        """The sleeve, all joints and all blades."""
        return ("sleeve", "joints", "blades")

    @model_validator(mode="after")
    def _grows_outwards(self) -> Propeller:
        inner = "bore"
        for outer in ("hub", "root", "diameter"):
            if not getattr(self, inner) < getattr(self, outer):
                raise FaultError(f"must be more than {inner}, {getattr(self, inner):g} m", outer)
            inner = outer
        return self

    @model_validator(mode="after")
    def _conforms(self) -> Propeller:
        """One mesh: the sleeve's cells come in equal sectors, and joints and blades go on from them."""
        (around, axial, _), (chordwise, across, _) = self.mesh.sleeve, self.mesh.joint
        per_blade = max(round(around / self.blades), 2)
        if around != per_blade * self.blades:
            message = f"can't be shared by {self.blades} blades; the nearest that can is {per_blade * self.blades}"
            raise FaultError(message, "mesh", "sleeve", 0)
        if chordwise != axial:
            raise FaultError(f"must be the sleeve's number along the axis, {axial}", "mesh", "joint", 0)
        if across >= per_blade:
            message = f"leaves no gap between blades; at most {per_blade - 1} of the {per_blade} around fit"
            raise FaultError(message, "mesh", "joint", 1)
        for k in (0, 1):
            if self.mesh.blade[k] != self.mesh.joint[k]:
                raise FaultError(f"must be the joint's, {self.mesh.joint[k]}", "mesh", "blade", k)
        return self

    @model_validator(mode="after")
    def _leaves_gaps(self) -> Propeller:
        if self.seat is not None and not self.seat < 2 * pi / self.blades:
            raise FaultError(f"leaves no gap between blades; must be less than {360 / self.blades:g} deg", "seat")
        return self
