"""Propellers in a scene file: their shape and how they are divided into elements."""

from math import pi
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from fmd.core.units import Angle, PositiveLength
from fmd.scene.bodies import DividedMesh, Solid, scale_count
from fmd.scene.reading import FaultError
from fmd.scene.values import Count, Number, Order

Sections = Annotated[tuple[PositiveLength, ...], Field(min_length=1, max_length=20)]


class PropellerMesh(DividedMesh):
    """Division of a propeller into elements that conform from sleeve to joint to blade.

    Example:

        [body.propeller.mesh]
        order = 1
        sleeve = [66, 10, 3]
        joint = [10, 8, 12]
        blade = [10, 8, 27]
    """

    # Shape of the elements; six tetrahedra take the place of each hexahedron.
    element: Literal["hexahedron", "tetrahedron"] = "hexahedron"
    order: Order = 2  # Polynomial order of the displacement in an element; elements of order 2 have curved edges.
    # Elements of the sleeve around, along the axis and along the radius; the number around must be a multiple of the
    # number of blades.
    sleeve: tuple[Count, Count, Count] = (66, 10, 3)
    # Elements of each joint along the chord (at the root that is the sleeve's axis), across the thickness and along the
    # radius.
    joint: tuple[Count, Count, Count] = (10, 8, 12)
    # Elements of each blade along the chord, across the thickness and along the radius; the first two are those of the
    # joint.
    blade: tuple[Count, Count, Count] = (10, 8, 27)
    # Radial extent of a blade's elements at its tip over that at its root.
    growth: Annotated[Number, Field(ge=0.05, le=20.0)] = 4.0


class Propeller(Solid):
    """A propeller about the z axis: a sleeve with blades that grow out of it through joints.

    The first blade is on the x axis. The faces are ``bore``, ``back`` and ``front`` (the ends of the sleeve where z is
    least and greatest), and of each blade ``tip-1``, ``pressure-1``, ``suction-1`` and so on; the parts are ``sleeve``,
    ``joints`` and ``blades``.

    Example:

        [body.propeller]
        shape = "propeller"
        blades = 6
        bore = "80 mm"
        hub = "150 mm"
        root = "260 mm"
        diameter = "900 mm"
        length = "110 mm"
        chord = ["95 mm", "115 mm", "100 mm", "55 mm"]
        thickness = ["34 mm", "20 mm", "9 mm"]
        pitch = ["62 deg", "42 deg", "30 deg"]
        E = "70 GPa"
        nu = 0.3
        rho = "2780 kg/m^3"
        mesh = { order = 1 }
        modes = { count = 24, enrich = "inertia" }
        marker = { hub = { face = "bore" }, tip = { face = "tip-1" } }
    """

    parts: ClassVar[tuple[str, ...]] = ("sleeve", "joints", "blades")  # all joints and all blades
    shape: Literal["propeller"]
    blades: Annotated[int, Field(strict=True, ge=2, le=24)]  # Number of blades.
    bore: PositiveLength  # Diameter of the sleeve's bore [m].
    hub: PositiveLength  # Outer diameter of the sleeve [m].
    root: PositiveLength  # Diameter of the circle where joints become blades [m].
    diameter: PositiveLength  # Diameter of the circle through the blades' tips [m].
    length: PositiveLength  # Extent of the sleeve along z [m].
    chord: Sections  # Chords of the blade's section, at equal distances from root to tip [m].
    thickness: Sections  # Thicknesses of the blade's section in its middle, at equal distances from root to tip [m].
    # Angles of the blade's section against the plane of rotation, at equal distances from root to tip [rad].
    pitch: Annotated[tuple[Angle, ...], Field(min_length=1, max_length=20)]
    camber: Annotated[Number, Field(ge=-0.2, le=0.2)] = 0.0  # Rise of a section's middle line over its chord.
    edge: Annotated[Number, Field(ge=0.05, le=1.0)] = 0.3  # Thickness of a section's edges over that of its middle.
    # Angle that each joint takes of the sleeve [rad]; by default its share of the elements around.
    seat: Annotated[Angle, Field(gt=0)] | None = None
    mesh: PropellerMesh  # Division into elements.

    @property
    def faces(self) -> tuple[str, ...]:
        """Names of the bore, of the sleeve's two ends and of three faces of each blade."""
        of_blades = (f"{face}-{k + 1}" for k in range(self.blades) for face in ("tip", "pressure", "suction"))
        return ("bore", "back", "front", *of_blades)

    def of_order(self, order: int) -> dict[str, Any]:
        """Return the changes for elements of another order."""
        return {"mesh": self.mesh.model_copy(update={"order": order})}

    def resized(self, factor: float) -> dict[str, Any]:
        """Return the changes for a mesh with about ``factor`` times the elements each way, on joints as wide."""
        (around, axial, radial), (chordwise, across, outwards) = self.mesh.sleeve, self.mesh.joint
        # Between two joints the sleeve has elements of its own; with too few of them they would become thin.
        between = around // self.blades - across
        seat = self.seat or 2 * pi * across / around
        axial, radial, chordwise, across, outwards, between, along = (
            scale_count(count, factor)
            for count in (axial, radial, chordwise, across, outwards, between, self.mesh.blade[2])
        )
        divisions = {
            "sleeve": ((across + between) * self.blades, axial, radial),
            "joint": (chordwise, across, outwards),
            "blade": (chordwise, across, along),
        }
        return {"mesh": self.mesh.model_copy(update=divisions), "seat": seat}

    def _check(self) -> None:
        inner = "bore"
        for outer in ("hub", "root", "diameter"):
            if not getattr(self, inner) < getattr(self, outer):
                raise FaultError(f"must be more than {inner}, {getattr(self, inner):g} m", outer)
            inner = outer
        self._check_sectors()
        if self.seat is not None and not self.seat < 2 * pi / self.blades:
            raise FaultError(f"leaves no gap between blades; must be less than {360 / self.blades:g} deg", "seat")

    def _check_sectors(self) -> None:
        """Require equal sectors of the sleeve's elements, from which those of joints and blades go on."""
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
