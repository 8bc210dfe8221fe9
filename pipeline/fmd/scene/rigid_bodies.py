"""Rigid bodies in a scene file: rods, point masses and bodies given by their inertia, and surfaces that may touch."""

from typing import Annotated, Literal

from pydantic import Field

from fmd.core.limits.contact import USUAL_ROUNDING
from fmd.core.limits.round_off import SOLVED
from fmd.core.units import MomentOfInertia, NonNegative, PositiveLength, PositiveMass, PositiveStress
from fmd.scene.kinds import KindBy
from fmd.scene.orientation import Orientation
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import LengthUnit, Name, Point, Poisson, Turn
from fmd.scene.visuals import VisualFile, Visuals


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


Moment = Annotated[MomentOfInertia, NonNegative]


def require_possible_moments(inertia: tuple[float, float, float]) -> None:
    """Raise ``FaultError`` for principal moments of inertia that no body has."""
    largest = max(inertia)
    if largest > (sum(inertia) - largest) * (1 + SOLVED):
        raise FaultError("isn't any body's: no moment is greater than the sum of the other two", "inertia")


class PointMarker(Orientation):
    """A named point of a rigid body, where joints and loads act and motion is recorded, with axes of its own.

    Example:

        [body.upper.marker]
        elbow = { at = ["0.5 m", "0 m", "0 m"] }
    """

    at: Point  # Position in the body's frame [m].


class Undeformable(SceneTable):
    """Keys that rigid bodies have in common."""

    mass: PositiveMass  # Mass of the body [kg].
    marker: dict[Name, PointMarker]  # Points for joints, loads and results, by name.
    # Shapes in pictures and films. By default a rod is one of its length, a point mass a ball, and any other body its
    # surfaces, else rods or a plate through its markers, or the box that has its inertia.
    visual: Visuals = ()
    # Balls, boxes, pins, bores and files of triangles that may touch something, by name.
    surface: dict[Name, RigidSurface] = Field(default_factory=dict)

    def _check(self) -> None:
        for name in self.surface:
            if name in self.marker:
                raise FaultError("is the name of a marker; another one works", "surface", name)


class Rod(Undeformable):
    """A uniform slender rigid rod along x, from the origin of its frame.

    Example:

        [body.rod]
        shape = "rod"
        mass = "2 kg"
        length = "2 m"
        marker = { hinge = { at = ["0 m", "0 m", "0 m"] } }
    """

    shape: Literal["rod"]
    length: PositiveLength  # Extent along x [m].


class PointMass(Undeformable):
    """A rigid body without extent: a mass in the origin of its frame.

    Example:

        [body.slider]
        shape = "point"
        mass = "5 kg"
        marker = { centre = { at = ["0 m", "0 m", "0 m"] } }
    """

    shape: Literal["point"]


class RigidBody(Undeformable):
    """A rigid body of any shape, given by its mass, centre of mass and moments of inertia.

    Example:

        [body.gripper]
        shape = "rigid"
        mass = "0.4 kg"
        centre = ["60 mm", "0 mm", "0 mm"]
        inertia = ["1e-4 kg m^2", "6e-4 kg m^2", "6e-4 kg m^2"]
        marker = { wrist = { at = ["0 m", "0 m", "0 m"] } }
    """

    shape: Literal["rigid"]
    centre: Point = (0.0, 0.0, 0.0)  # Centre of mass in the body's frame [m].
    # Principal moments about the centre of mass, along the frame's x, y and z [kg m²].
    inertia: tuple[Moment, Moment, Moment]

    def _check(self) -> None:
        require_possible_moments(self.inertia)
