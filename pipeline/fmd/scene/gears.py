"""Spur gears in a scene file: their teeth, their elements, and the pictures of two in mesh."""

from collections.abc import Mapping
from functools import cached_property
from math import ceil, pi, sin
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from fmd.core.involute import GearPair, Tooth, tight_distance
from fmd.core.limits.contact import JAMMED
from fmd.core.units import Angle, Positive, PositiveLength, Torque
from fmd.scene.bodies import Solid, scale_count
from fmd.scene.reading import FaultError, SceneTable, UnknownNameError
from fmd.scene.values import BodyName, Count, FileCheck, Number

EvenCount = Annotated[Count, Field(multiple_of=2)]


class GearTeethMesh(SceneTable):
    """Division of a gear into hexahedra of second order, with nodes on the involutes and fillets.

    Example:

        [body.pinion.mesh]
        teeth = 3
        flank = 6
    """

    # Teeth that are meshed, the middle one on the x axis; the rest of the gear is its rim up to the root circle, and
    # has no mass of teeth. Static analysis of two gears takes 3, or 5 from a contact ratio of 2 on.
    teeth: Annotated[Count, Field(le=1000)] = 3
    flank: Count = 6  # Elements along an involute.
    fillet: Count = 6  # Elements along each half of a fillet.
    across: EvenCount = 6  # Elements across a tooth; an even number, as nodes on its middle are needed.
    rim: Count = 5  # Elements from the root to the bore.
    along: Count = 2  # Elements along the axis.
    order: Literal[2] = 2  # Polynomial order of the displacement in an element.


class SpurGear(Solid):
    """An external spur gear about the z axis, its middle at z = 0, with involute teeth that a basic rack cuts.

    The faces are ``bore``, ``back`` and ``front`` (where z is least and greatest), and of all meshed teeth ``flanks``
    (the involutes), ``roots`` (the fillets and the lands between them) and ``tips``; its one part is ``gear``.

    Example:

        [body.pinion]
        shape = "spur-gear"
        teeth = 23
        module = "3 mm"
        width = "20 mm"
        bore = "30 mm"
        E = "206 GPa"
        nu = 0.3
        rho = "7850 kg/m^3"
        mesh = { teeth = 3 }
        modes = { count = 4 }
        marker = { bore = { face = "bore" } }
    """

    parts: ClassVar[tuple[str, ...]] = ("gear",)
    faces: ClassVar[tuple[str, ...]] = ("bore", "back", "front", "flanks", "roots", "tips")
    shape: Literal["spur-gear"]
    teeth: Annotated[int, Field(strict=True, ge=8, le=1000)]  # Number of teeth.
    module: PositiveLength  # Pitch circle's diameter over the number of teeth [m].
    width: PositiveLength  # Extent along z [m].
    bore: PositiveLength  # Diameter of the bore [m].
    pressure_angle: Annotated[Angle, Field(ge=0.17, le=0.53)] = pi / 9  # Of the rack [rad].
    shift: Annotated[Number, Field(ge=-1.0, le=1.5)] = 0.0  # Profile shift over the module.
    # Of the rack, over the module: height above its reference line; by default ISO 53, profile A.
    addendum: Annotated[Number, Field(gt=0.0, le=2.0)] = 1.0
    # Of the rack, over the module: depth below its reference line, likewise.
    dedendum: Annotated[Number, Field(gt=0.0, le=2.5)] = 1.25
    # Of the rack, over the module: radius of its corners, which cut the fillets, likewise.
    rounding: Annotated[Number, Field(gt=0.0, le=1.0)] = 0.38
    mesh: GearTeethMesh = Field(default_factory=GearTeethMesh)  # Division into elements.

    @cached_property
    def tooth(self) -> Tooth:
        """The profile of a tooth."""
        rack = (self.addendum, self.dedendum, self.rounding)
        return Tooth(self.module, self.teeth, self.pressure_angle, self.shift, *rack)

    @property
    def meshed_teeth(self) -> int:
        """Number of teeth that are meshed."""
        return min(self.mesh.teeth, self.teeth)

    def resized(self, factor: float) -> dict[str, Any]:
        """Return the changes for a mesh with about ``factor`` times the elements each way."""
        counts = {key: scale_count(getattr(self.mesh, key), factor) for key in ("flank", "fillet", "rim", "along")}
        counts["across"] = max(2, 2 * round(self.mesh.across * factor / 2))
        return {"mesh": self.mesh.model_copy(update=counts)}

    def _check(self) -> None:
        tooth = self.tooth
        if tooth.land < 0.0 or self.rounding >= self.dedendum:
            raise FaultError("is too large for the rack's depth and space; 0.38 is that of ISO 53", "rounding")
        if tooth.form_roll <= 0.0:
            least = self.shift - tooth.form_roll * tooth.base_radius * sin(self.pressure_angle) / self.module
            fault = f"lets the rack undercut the teeth, whose flanks wouldn't be involutes alone; more than {least:.3g}"
            raise FaultError(f"{fault} works, or more teeth", "shift")
        if tooth.half_angle(tooth.tip_radius) <= 0.0:
            raise FaultError("makes the teeth pointed below their tips; take less, or a smaller addendum", "shift")
        if not self.bore < 2.0 * tooth.root_radius:
            raise FaultError(f"must be less than the root circle's diameter, {2e3 * tooth.root_radius:.5g} mm", "bore")


def has_teeth(body: Any) -> bool:
    """Return true for a gear."""
    return isinstance(body, SpurGear)


class GearMesh(SceneTable):
    """Static mesh of two spur gears: transmission error, stiffness, shares of the load and stress at the roots.

    It takes the meshes of the bodies alone, and no motion. A ``.png``, ``.pdf`` or ``.svg`` is a chart, with a table
    (``.csv``) of the same name beside it.

    Example:

        [[output]]
        type = "gear-mesh"
        file = "mesh.png"
        pinion = "pinion"
        wheel = "wheel"
        torque = "100 N m"
    """

    type: Literal["gear-mesh"]
    file: Annotated[str, FileCheck((".png", ".pdf", ".svg"))]  # File of the chart.
    # Bodies, both spur gears.
    pinion: BodyName
    wheel: BodyName
    torque: Annotated[Torque, Positive]  # Torque on the pinion [N m].
    distance: PositiveLength | None = None  # Of the axes [m]; that without backlash by default.
    points: Annotated[int, Field(strict=True, ge=4, le=1000)] = 64  # Angles of the pinion within a pitch.
    title: str = ""  # Text above the chart.


def find_pair(
    pinion_name: str, wheel_name: str, distance: float | None, bodies: Mapping[str, Any]
) -> tuple[SpurGear, SpurGear, GearPair]:
    """Return pinion and wheel by their names, and their geometry in mesh, without backlash where no distance is given.

    Raises
    ------
    FaultError
        They aren't two spur gears, don't mesh, jam, or touch beside their involutes; or too few teeth are meshed.
    """
    gears = {name: body for name, body in bodies.items() if isinstance(body, SpurGear)}
    for key, name in (("pinion", pinion_name), ("wheel", wheel_name)):
        if name not in gears:
            raise UnknownNameError("spur gear", name, gears, "the spur gears", key)
    pinion, wheel = gears[pinion_name], gears[wheel_name]
    for key in ("module", "pressure_angle", "width"):
        own, other = getattr(wheel, key), getattr(pinion, key)
        if own != other:
            raise FaultError(
                f"has a {key} of {own:.6g} and the pinion one of {other:.6g}, which must be equal", "wheel"
            )
    tight = tight_distance(pinion.tooth, wheel.tooth)
    least = pinion.tooth.base_radius + wheel.tooth.base_radius
    if tight is None and distance is None:
        fault = "is needed, since gears of such shifts have backlash at any distance of their axes; more than"
        raise FaultError(f"{fault} {1e3 * least:.5g} mm, or larger shifts, help", "distance")
    nearest = f"more than {1e3 * least:.7g} mm works" if tight is None else f"{1e3 * tight:.7g} mm is without backlash"
    pair = GearPair(pinion.tooth, wheel.tooth, distance or tight or least)
    if pair.distance < max(least, (tight or least) * (1.0 - JAMMED)):
        raise FaultError(f"lets the teeth jam; {nearest}", "distance")
    if pair.contact_ratio < 1.0:
        fault = f"leaves a contact ratio of {pair.contact_ratio:.3g}, so that teeth part before the next ones touch"
        raise FaultError(f"{fault}; {nearest}", "distance")
    _check_teeth(pair, {"pinion": pinion, "wheel": wheel})
    return pinion, wheel, pair


def _check_teeth(pair: GearPair, gears: Mapping[str, SpurGear]) -> None:
    """Raise the fault of a gear that is met in its fillet, or has too few teeth in its mesh."""
    needed = 2 * ceil(pair.contact_ratio) - 1
    for (key, gear), end, g in zip(gears.items(), pair.path, (0, 1), strict=True):
        if pair.rolls(end)[g] < gear.tooth.form_roll:
            fault = "is met below its involutes, in the fillets, by the other's tips; a smaller addendum of that one"
            raise FaultError(f"{fault}, or a larger shift here, helps", key)
        if gear.meshed_teeth < needed:
            raise FaultError(f"has {gear.meshed_teeth} teeth in its mesh; mesh.teeth = {needed} is needed", key)
