"""Pictures and films in a scene file: of meshes, modes and stress."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, WithJsonSchema

from fmd.core.units import Angle, NonNegative, NonNegativeTime, Positive, PositiveLength
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import BodyName, FileCheck, Number, Point, Text, Words, check_file_name


def _check_mode_file(file: str) -> str:
    check_file_name(file, ".png")
    if file.count("{mode}") != 1:
        raise ValueError("must hold '{mode}' once, for the mode's number, e.g. 'mode-{mode}.png'")
    return file


Pixels = Annotated[int, Field(strict=True, ge=64, le=8192)]
Scale = Annotated[Number, NonNegative]
PictureFile = Annotated[str, FileCheck((".png",))]
ModeFile = Annotated[
    str,
    AfterValidator(_check_mode_file),
    Words("name of a ``.png`` file with ``{mode}`` in it"),
    WithJsonSchema({"type": "string", "pattern": r"\{mode\}.*\.png$"}),
]
Component = Literal["von Mises", "xx", "yy", "zz", "yz", "xz", "xy", "principal 1", "principal 2", "principal 3"]


class PictureSettings(SceneTable):
    """Keys that pictures and films have in common."""

    file: PictureFile  # File that is written.
    size: tuple[Pixels, Pixels] | None = None  # Width and height in pixels.
    # Direction of the viewer from what is drawn: azimuth about z, counted from x, and elevation [rad].
    camera: tuple[Angle, Annotated[Angle, Field(ge=-1.58, le=1.58)]] | None = None
    zoom: Annotated[Number, Field(ge=0.01, le=1000.0)] = 1.0  # Factor on the size in the picture.
    focus: Point | None = None  # Point in the middle of a close-up [m].
    extent: PositiveLength | None = None  # Length that the picture's width covers [m].
    colour_map: Text = "light turbo"  # Colour map: ``light turbo``, whose lower end is light, or a name in Matplotlib.
    title: str = ""  # Text above; by default it is made from the scene's title.


class BodyPicture(PictureSettings):
    """Keys that pictures of one flexible body have in common."""

    body: BodyName  # Flexible body that is drawn; the scene's only one by default.


class MeshPicture(BodyPicture):
    """A picture of a body's mesh with its parts in different colours.

    Example:

        [[output]]
        type = "mesh"
        file = "mesh.png"
        body = "beam"
        camera = ["-60 deg", "32 deg"]
    """

    type: Literal["mesh"]


class ModePictures(BodyPicture):
    """A picture of each mode shape, one file a mode.

    Example:

        [[output]]
        type = "modes"
        file = "mode-{mode}.png"
        body = "beam"
    """

    type: Literal["modes"]
    file: ModeFile  # Files of the pictures; the mode's number replaces ``{mode}``.
    # Factor on the shapes; 1 by default, which draws them at 8 % of the body's largest extent.
    scale: Annotated[Number, Positive] | None = None


class ModeSheet(BodyPicture):
    """One picture of the first elastic modes side by side.

    Example:

        [[output]]
        type = "mode sheet"
        file = "modes.png"
        body = "beam"
        count = 6
    """

    type: Literal["mode sheet"]
    count: Annotated[int, Field(strict=True, ge=1, le=30)] = 6  # Number of modes.
    scale: Annotated[Number, Positive] = 1.0  # Factor on the shapes; 1 draws them at 8 % of the body's largest extent.


class MechanismView(PictureSettings):
    """Keys that pictures and films of the whole mechanism have in common.

    They show all bodies, flexible ones with their mesh, rigid ones as shapes, marks of the joints, springs, and where
    the ground holds them.
    """

    body: BodyName | None = None  # Flexible body whose stress is coloured; all of them by default.
    component: Component = "von Mises"  # Component of the stress; principal stresses are numbered from the largest.
    scale: Scale = 1.0  # Factor on the deformation in the picture.
    alone: bool = False  # True to leave out everything but ``body``.

    def _check(self) -> None:
        if self.alone and self.body is None:
            raise FaultError("is missing: the body that is drawn alone", "body")


class StressPicture(MechanismView):
    """A picture of the stress on the surface at the instant of the largest von Mises stress.

    In a scene with a single body, or with ``alone``, it is drawn in its own frame over its undeformed shape.

    Example:

        [[output]]
        type = "stress"
        file = "von-mises.png"
        body = "beam"
        scale = 10.0
    """

    type: Literal["stress"]


class MechanismPicture(MechanismView):
    """A picture of the whole mechanism at one time.

    Example:

        [[output]]
        type = "mechanism"
        file = "arm.png"
        time = "0.4 s"
    """

    type: Literal["mechanism"]
    time: NonNegativeTime = 0.0  # Time, of which the nearest output time is shown [s].


class Film(MechanismView):
    """A film of the mechanism in motion, its flexible bodies coloured by the stress on their surface.

    The camera sees the whole motion.

    Example:

        [[output]]
        type = "film"
        file = "motion.mp4"
        frames = 80
        rate = 20.0
    """

    type: Literal["film"]
    # What the colours span: ``largest``, to the largest stress of all frames; ``usual``, to their 99th percentile,
    # which tells more apart where one instant or one corner has far more stress than the rest; ``frame``, each frame to
    # its own largest stress, with a scale that changes.
    span: Literal["largest", "usual", "frame"] = "largest"
    file: Annotated[str, FileCheck((".mp4", ".gif"))]
    frames: Annotated[int, Field(strict=True, ge=2, le=2000)] = 75  # Number of pictures, spread over the duration.
    rate: Annotated[Number, Positive] = 25.0  # Pictures a second when the film is played.
