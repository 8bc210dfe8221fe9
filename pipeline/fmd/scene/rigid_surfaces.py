"""Surfaces of rigid bodies that may touch something: balls, boxes, pins, bores and files of triangles."""

from __future__ import annotations

from typing import Annotated, Literal

from fmd.core.limits.contact import USUAL_ROUNDING
from fmd.core.units import PositiveLength, PositiveStress
from fmd.scene.kinds import KindBy
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import LengthUnit, Point, Poisson, Turn
from fmd.scene.visuals import VisualFile


class ElasticSurface(SceneTable):
    """Keys that all surfaces of rigid bodies have in common."""

    E: PositiveStress  # Young's modulus of the material there [Pa].
    nu: Poisson  # Poisson's ratio.


class BallSurface(ElasticSurface):
    """A ball, or a rounded tip.

    Example:

        [body.bob.surface.skin]
        type = "ball"
        radius = "20 mm"
        E = "210 GPa"
        nu = 0.3
    """

    type: Literal["ball"]
    radius: PositiveLength  # Radius [m].
    at: Point = (0.0, 0.0, 0.0)  # Centre in the body's frame [m].


class BoxSurface(ElasticSurface):
    """A box with rounded edges and corners.

    Example:

        [body.crate.surface.skin]
        type = "box"
        size = ["0.4 m", "0.3 m", "0.2 m"]
        E = "1 GPa"
        nu = 0.3
    """

    type: Literal["box"]
    size: tuple[PositiveLength, PositiveLength, PositiveLength]  # Extents along x, y and z [m].
    at: Point = (0.0, 0.0, 0.0)  # Middle in the body's frame [m].
    rotation: Turn = (0.0, 0.0, 0.0)  # Rotation vector that turns the box in the body's frame [rad].
    # Radius of its edges and corners [m]; by default a twentieth of the least extent. A sharp corner would dent under
    # the least force.
    rounding: PositiveLength | None = None

    @property
    def edge_radius(self) -> float:
        """Radius of its edges and corners [m]."""
        return USUAL_ROUNDING * min(self.size) if self.rounding is None else self.rounding

    def _check(self) -> None:
        if 2.0 * self.edge_radius > min(self.size):
            raise FaultError(f"is more than half of the least extent, {min(self.size):g} m", "rounding")


class AxialSurface(ElasticSurface):
    """Keys of surfaces around an axis."""

    # Ends of the axis in the body's frame [m].
    start: Point
    end: Point
    radius: PositiveLength  # Radius [m].

    def _check(self) -> None:
        if self.start == self.end:
            raise FaultError("is the start: a pin or a bore needs a length", "end")


class PinSurface(AxialSurface):
    """The outside of a cylinder.

    Example:

        [body.rod.surface.journal]
        type = "pin"
        start = ["0 mm", "0 mm", "-10 mm"]
        end = ["0 mm", "0 mm", "10 mm"]
        radius = "9.5 mm"
        E = "207 GPa"
        nu = 0.3
    """

    type: Literal["pin"]


class BoreSurface(AxialSurface):
    """The inside of a cylinder.

    Example:

        [body.slider.surface.bore]
        type = "bore"
        start = ["0 mm", "0 mm", "-10 mm"]
        end = ["0 mm", "0 mm", "10 mm"]
        radius = "10 mm"
        E = "207 GPa"
        nu = 0.3
    """

    type: Literal["bore"]


class FileSurface(ElasticSurface):
    """Triangles of an STL, OBJ or CAD file, counter-clockwise seen from outside, whose corners touch: 1,000 at most.

    Example:

        [body.hook.surface.skin]
        type = "file"
        file = "hook.stl"
        E = "210 GPa"
        nu = 0.3
    """

    type: Literal["file"]
    file: VisualFile  # The file, relative to the scene's.
    unit: LengthUnit = "mm"  # Unit of length of an STL or OBJ file; CAD files hold their own.
    at: Point = (0.0, 0.0, 0.0)  # Place of the file's origin in the body's frame [m].
    rotation: Turn = (0.0, 0.0, 0.0)  # Rotation vector that turns the file's axes in the body's frame [rad].


SURFACES = (BallSurface, BoxSurface, PinSurface, BoreSurface, FileSurface)
RigidSurface = Annotated[BallSurface | BoxSurface | PinSurface | BoreSurface | FileSurface, KindBy("type")]
