"""Outputs of a surface over a whole motion in a scene file: envelope and fatigue of its stress, pressure of contact."""

from typing import Annotated, Literal

from pydantic import Field

from fmd.core.units import Positive, PositiveStress
from fmd.scene.pictures import BodyPicture, PictureSettings
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import Count, FileCheck, Name, Number

FieldFile = Annotated[str, FileCheck((".png", ".vtu", ".csv"))]
Slope = Annotated[Number, Field(ge=1.0, le=100.0)]


class DrawnField(BodyPicture):
    """A field on a body that the file's suffix makes a picture or something else, which takes no keys of pictures."""

    def _check(self) -> None:
        for key in {*BodyPicture.model_fields} - {"file", "body"}:
            if key in self.model_fields_set and not self.file.endswith(".png"):
                raise FaultError("has no effect: it belongs to a .png file", key)


class Plies(DrawnField):
    """Stress of a laminate's plies in their own axes over all output times, and how near it comes to their strength.

    It is that in the middle of elements, at both faces of each ply. ``.csv`` is a table with the extremes of each ply,
    ``.png`` a picture with the largest index of all plies on the undeformed body. An index of 0.5 bears twice the load.

    Example:

        [[output]]
        type = "plies"
        file = "plies.csv"
        body = "wing"
    """

    type: Literal["plies"]
    file: Annotated[str, FileCheck((".png", ".csv"))]
    # Failure index of a picture: Tsai and Hill's, or the largest share of a strength.
    index: Literal["Tsai-Hill", "maximum stress"] = "Tsai-Hill"


class SurfaceField(DrawnField):
    """A field on a body's surface that the file's suffix makes a picture, a mesh or a table.

    ``.png`` is a picture on the undeformed body, ``.vtu`` the surface with all fields for ParaView, ``.csv`` the worst
    nodes with their numbers and places. The keys of pictures belong to the first alone.
    """

    file: FieldFile
    count: Count = 20  # Number of nodes in the table.

    def _check(self) -> None:
        if "count" in self.model_fields_set and not self.file.endswith(".csv"):
            raise FaultError("has no effect: it belongs to a .csv file", "count")


class Envelope(SurfaceField):
    """Largest von Mises, largest and smallest principal stress of each node on the surface over all output times.

    Example:

        [[output]]
        type = "envelope"
        file = "envelope.png"
        body = "beam"
    """

    type: Literal["envelope"]
    # Extreme that a picture shows and that a table is sorted by: of ``principal 3`` the smallest, of the others the
    # largest.
    component: Literal["von Mises", "principal 1", "principal 3"] = "von Mises"


class SnCurve(SceneTable):
    """Stress amplitude against cycles to failure: two straight lines in logarithms that meet at a knee.

    Example:

        [output.sn]
        amplitude = "180 MPa"
        cycles = 2e6
        slope = 5
        slope_beyond = 9
    """

    amplitude: PositiveStress  # Stress amplitude about zero at the knee [Pa].
    cycles: Annotated[Number, Positive]  # Cycles to failure at the knee.
    slope: Slope  # Exponent k above the knee, ``N = cycles (amplitude/σ)^k``.
    # Exponent below the knee, ``"infinite"`` for an endurance limit; that above by default, so that all cycles count.
    slope_beyond: Slope | Literal["infinite"] | None = None


class MeanStress(SceneTable):
    """Correction of each cycle for its mean stress; one of the keys is given.

    Example:

        [output.mean_stress]
        goodman = "520 MPa"
    """

    goodman: PositiveStress | None = None  # Tensile strength of Goodman's line; pressure is taken to do no good [Pa].
    fkm: Annotated[Number, Field(ge=0.0, le=1.0)] | None = None  # Sensitivity to mean stress M of the FKM guideline.

    def _check(self) -> None:
        if (self.goodman is None) == (self.fkm is None):
            raise FaultError("needs one of goodman = '520 MPa' and fkm = 0.3")


class Fatigue(SurfaceField):
    """Repeats of the motion until a crack starts, node by node on the surface, by rainflow counting and Miner's sum.

    Example:

        [[output]]
        type = "fatigue"
        file = "life.png"
        body = "beam"
        sn = { amplitude = "90 MPa", cycles = 1e6, slope = 6, slope_beyond = 11 }
    """

    type: Literal["fatigue"]
    sn: SnCurve  # The material's S–N curve.
    # Stress whose cycles are counted: shear with the largest normal stress of each cycle on the worst plane
    # (``"findley"``), normal stress on the worst plane (``"critical plane"``, for brittle materials), or von Mises
    # stress with the sign of the principal stress that is the largest by size (``"signed von Mises"``, for one
    # direction of stress).
    stress: Literal["findley", "critical plane", "signed von Mises"] = "findley"
    # Coefficient k of the normal stress in Findley's ``τ_a + k σ_n``; with limits of torsion t and bending f about zero
    # ``t/f = (1 + k/√(1 + k²))/2``.
    findley: Annotated[Number, Field(ge=0.0, le=2.0)] = 0.25
    # Number of directions of planes around the surface's normal.
    planes: Annotated[int, Field(strict=True, ge=2, le=180)] = 18
    # Correction for mean stress, which Findley's parameter has in it; none by default.
    mean_stress: MeanStress | None = None

    def _check(self) -> None:
        if "planes" in self.model_fields_set and self.stress == "signed von Mises":
            raise FaultError("has no effect: it belongs to stress = 'findley' and 'critical plane'", "planes")
        if "findley" in self.model_fields_set and self.stress != "findley":
            raise FaultError("has no effect: it belongs to stress = 'findley'", "findley")
        if self.mean_stress is not None and self.stress == "findley":
            why = (
                "can't be: stress = 'findley' has the mean stress in it, by its findley; leave it out, or take another"
            )
            raise FaultError(why, "mean_stress")


class ContactPressure(PictureSettings):
    """A picture of a contact's pressure when it is largest, or of how far points have slipped, on the undeformed body.

    Between two bodies it is on that with the smaller elements, whose points are looked for on the other.

    Example:

        [[output]]
        type = "pressure"
        file = "pressure.png"
        contact = "floor"
    """

    type: Literal["pressure"]
    contact: Name  # Name of the contact.
    # ``"pressure"``, at the instant at which it is largest, or ``"slip"``, the way that each point has slipped
    # while it was pressed, at the end, or ``"wear"``, the depth that each has lost then.
    quantity: Literal["pressure", "slip", "wear"] = "pressure"
    # Of two bodies that wear one another, the one to draw; by default that with the smaller elements.
    body: Name | None = None

    def _check(self) -> None:
        if self.body is not None and self.quantity != "wear":
            raise FaultError(f"is for wear; {self.quantity} is known on one of both bodies alone", "body")
