"""How rigid bodies look in pictures and films; nothing here has an effect on the motion."""

from pathlib import PurePath
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from fmd.core.units import PositiveLength
from fmd.scene.kinds import KindBy
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import LengthUnit, Point, SourceFile, Turn, Words

VISUAL_FILES = (".stl", ".obj", ".step", ".stp", ".iges", ".igs", ".brep")


def _check_visual_file(file: str) -> str:
    if PurePath(file).suffix.lower() not in VISUAL_FILES:
        raise ValueError(f"must end in {', '.join(VISUAL_FILES[:-1])} or {VISUAL_FILES[-1]}")
    return file


VisualFile = Annotated[SourceFile, AfterValidator(_check_visual_file)]


class OneOrMore:
    """Reader of a list that may be written without brackets if it has one table."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self._as_list, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        tables = handler(schema)
        return {"anyOf": [tables["items"], tables]}

    @staticmethod
    def _as_list(given: Any) -> Any:
        return [given] if isinstance(given, dict | SceneTable) else given


Colour = Annotated[str, Field(pattern="^#[0-9a-fA-F]{6}$"), Words('colour, e.g. ``"#c9bb62"``')]


class VisualSettings(SceneTable):
    """Keys that all shapes in pictures have in common."""

    colour: Colour | None = None  # Colour; by default bodies have pale ones in turn.


class BoxVisual(VisualSettings):
    """A box in a body's frame.

    Example:

        [[body.gripper.visual]]
        type = "box"
        size = ["120 mm", "40 mm", "40 mm"]
        at = ["60 mm", "0 mm", "0 mm"]
    """

    type: Literal["box"]
    size: tuple[PositiveLength, PositiveLength, PositiveLength]  # Extents along x, y and z [m].
    at: Point = (0.0, 0.0, 0.0)  # Middle in the body's frame [m].
    rotation: Turn = (0.0, 0.0, 0.0)  # Rotation vector that turns the box in the body's frame [rad].


class CylinderVisual(VisualSettings):
    """A cylinder between two points of a body.

    Example:

        [[body.wheel.visual]]
        type = "cylinder"
        start = ["0 mm", "-40 mm", "0 mm"]
        end = ["0 mm", "40 mm", "0 mm"]
        radius = "150 mm"
    """

    type: Literal["cylinder"]
    start: Point  # Middle of one end in the body's frame [m].
    end: Point  # Middle of the other end [m].
    radius: PositiveLength  # Radius [m].

    def _check(self) -> None:
        if self.start == self.end:
            raise FaultError("is the start: a cylinder needs a length", "end")


class RodVisual(VisualSettings):
    """A round rod from each of a body's markers to the next, in their order.

    Example:

        [[body.upper.visual]]
        type = "rod"
        radius = "12 mm"
    """

    type: Literal["rod"]
    radius: PositiveLength  # Radius [m].


class FileVisual(VisualSettings):
    """A shape from an STL or OBJ file or from CAD.

    Example:

        [[body.knuckle.visual]]
        type = "file"
        file = "knuckle.stl"
        unit = "mm"
    """

    type: Literal["file"]
    file: VisualFile  # The file, relative to the scene's.
    unit: LengthUnit = "mm"  # Unit of length of an STL or OBJ file; CAD files hold their own.
    at: Point = (0.0, 0.0, 0.0)  # Origin of the file in the body's frame [m].
    rotation: Turn = (0.0, 0.0, 0.0)  # Rotation vector that turns the file's axes in the body's frame [rad].


Visual = Annotated[BoxVisual | CylinderVisual | RodVisual | FileVisual, KindBy("type")]
Visuals = Annotated[tuple[Visual, ...], Field(max_length=100), OneOrMore()]
