"""Outputs in a scene file: charts, pictures, films and files for other tools."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from pipeline.core.units import Angle, NonNegative, Positive, PositiveLength, Stress
from pipeline.scene.reading import FaultError, SceneTable
from pipeline.scene.values import FileCheck, Number, Place, Point


def _check_no_mode(file: str) -> str:
    if "{mode}" in file:
        raise ValueError("'{mode}' belongs to an output of type 'modes'")
    return file


def _check_one_mode(file: str) -> str:
    """One ``{mode}`` in it, for the mode's number."""
    if file.count("{mode}") != 1:
        raise ValueError("must hold '{mode}' once, for the mode's number, e.g. 'mode-{mode}.png'")
    return file


Pixels = Annotated[int, Field(strict=True, ge=64, le=8192)]
Scale = Annotated[Number, NonNegative]
PictureFile = Annotated[str, AfterValidator(FileCheck((".png",))), AfterValidator(_check_no_mode)]
Component = Literal["von Mises", "xx", "yy", "zz", "yz", "xz", "xy", "principal 1", "principal 2", "principal 3"]


# Meanings of the quantities that a chart can draw.
CHART_QUANTITIES = {
    "joint_position": "angle of a revolute or displacement of a prismatic joint, named by `joint` if there are several",
    "joint_rate": "angular rate or speed of such a joint",
    "tip_position": "position of the tip in space",
    "tip_deflection": "displacement of the tip by deformation, seen from the section at its body's joint, in its axes",
    "tip_displacement": "displacement of the tip by deformation, in the floating frame of its body",
    "marker_position": "position of any marker in space, named by `marker`",
    "modal_coordinates": "modal coordinates of the body named by `body`, or of that with the tip",
    "energy": "kinetic and potential energy",
    "centre_of_mass": "position of the centre of all bodies' mass in space",
    "momentum": "momentum of all bodies",
    "angular_momentum": "angular momentum of all bodies about the ground's origin",
    "com_velocity": "velocity of the centre of mass",
    "com_angular_velocity": "angular velocity of the centre of mass about the axis of the first joint",
    "element_stress": "stress in a named element, given by `element` and `component`",
    "com_position": "the former name of `centre_of_mass`",
    "joint_angle": "the former name of `joint_position`",
}


JOINT_QUANTITIES = ("joint_position", "joint_rate", "joint_angle")


class Chart(SceneTable):
    """A chart of one quantity over time with the curves of all runs.

    Parameters
    ----------
    file : str
        File of the chart.
    quantity : str
        Quantity that is drawn; the table of quantities below explains each.
    joint : str, optional
        Revolute or prismatic joint whose position or rate is drawn; needed if there are several.
    body : str, optional
        Flexible body whose modal coordinates are drawn; that of the tip by default.
    marker : str, optional
        ``"body.marker"``, the marker whose position in space is drawn.
    element : str, optional
        ``"body.element"``, a named element whose stress is drawn.
    component : str
        Component of that stress; principal stresses are numbered from the largest.
    unit : str, optional
        Unit of the axis, e.g. ``"deg"`` or ``"mm/s"``; rad, m, s and MPa by default.
    title : str
        Text above the chart; the quantity's name by default.
    band : tuple of float, optional
        Range of stress that is marked [Pa].
    band_title : str
        Text for the band in the legend.

    Examples
    --------
    ::

        [[output]]
        type = "chart"
        file = "shoulder.png"
        quantity = "joint_position"
        joint = "shoulder"
        unit = "deg"
    """

    type: Literal["chart"]
    file: Annotated[str, AfterValidator(FileCheck((".png", ".pdf", ".svg"))), AfterValidator(_check_no_mode)]
    quantity: Literal[
        "joint_position",
        "joint_rate",
        "tip_position",
        "tip_deflection",
        "tip_displacement",
        "marker_position",
        "modal_coordinates",
        "energy",
        "centre_of_mass",
        "momentum",
        "angular_momentum",
        "com_velocity",
        "com_angular_velocity",
        "element_stress",
        "com_position",
        "joint_angle",
    ]
    joint: Place | None = None
    body: Place | None = None
    marker: Place | None = None
    element: Place | None = None
    component: Component = "von Mises"
    unit: Place | None = None
    title: str = ""
    band: tuple[Stress, Stress] | None = None
    band_title: str = ""

    @model_validator(mode="after")
    def _joint_where_needed(self) -> Chart:
        if self.quantity != "modal_coordinates" and self.body is not None:
            raise FaultError("belongs to the quantity 'modal_coordinates'", "body")
        if (self.marker is None) == (self.quantity == "marker_position"):
            wrong = "is missing: 'body.marker', the marker" if self.marker is None else "belongs to 'marker_position'"
            raise FaultError(wrong, "marker")
        if self.quantity not in JOINT_QUANTITIES and self.joint is not None:
            raise FaultError(f"belongs to the quantities {', '.join(JOINT_QUANTITIES[:2])}", "joint")
        if self.unit is not None and self.quantity not in (*JOINT_QUANTITIES, "element_stress"):
            raise FaultError("belongs to a joint's position or rate, or to a stress", "unit")
        if (self.element is None) == (self.quantity == "element_stress"):
            wrong = "is missing: 'body.element', the element" if self.element is None else "belongs to 'element_stress'"
            raise FaultError(wrong, "element")
        if self.band is not None and (self.element is None or not self.band[0] < self.band[1]):
            raise FaultError("must be two stresses, the smaller first, on a chart of 'element_stress'", "band")
        return self


class BodyPicture(SceneTable):
    """Keys that pictures and films have in common.

    Parameters
    ----------
    body : str
        Flexible body that is drawn.
    size : tuple of int, optional
        Width and height [pixels].
    camera : tuple of float, optional
        Direction of the viewer from the body: azimuth about z, counted from x, and elevation [rad].
    zoom : float
        Factor on the body's size in the picture.
    focus : tuple of float, optional
        Point in the middle of a close-up [m].
    extent : float, optional
        Length that the picture's width covers [m].
    colour_map : str
        Colour map, by its name in Matplotlib.
    title : str
        Text above; by default it is made from the scene's title.
    """

    body: Place
    size: tuple[Pixels, Pixels] | None = None
    camera: tuple[Angle, Annotated[Angle, Field(ge=-1.58, le=1.58)]] | None = None
    zoom: Annotated[Number, Field(ge=0.01, le=1000.0)] = 1.0
    focus: Point | None = None
    extent: PositiveLength | None = None
    colour_map: Place = "turbo"
    title: str = ""


class MeshPicture(BodyPicture):
    """A picture of a body's mesh with its parts in different colours.

    Parameters
    ----------
    file : str
        File of the picture.

    Examples
    --------
    ::

        [[output]]
        type = "mesh"
        file = "mesh.png"
        body = "beam"
        camera = ["-60 deg", "32 deg"]
    """

    type: Literal["mesh"]
    file: PictureFile


class ModePictures(BodyPicture):
    """A picture of each mode shape, one file a mode.

    Parameters
    ----------
    file : str
        Files of the pictures; the mode's number replaces ``{mode}``.
    scale : float, optional
        Factor on the shapes; 1 by default, which draws them at 8 % of the body's largest extent.

    Examples
    --------
    ::

        [[output]]
        type = "modes"
        file = "mode-{mode}.png"
        body = "beam"
    """

    type: Literal["modes"]
    file: Annotated[str, AfterValidator(FileCheck((".png",))), AfterValidator(_check_one_mode)]
    scale: Annotated[Number, Positive] | None = None


class ModeSheet(BodyPicture):
    """One picture of the first elastic modes side by side.

    Parameters
    ----------
    file : str
        File of the picture.
    count : int
        Number of modes.
    scale : float
        Factor on the shapes; 1 draws them at 8 % of the body's largest extent.

    Examples
    --------
    ::

        [[output]]
        type = "mode sheet"
        file = "modes.png"
        body = "beam"
        count = 6
    """

    type: Literal["mode sheet"]
    file: PictureFile
    count: Annotated[int, Field(strict=True, ge=1, le=30)] = 6
    scale: Annotated[Number, Positive] = 1.0


class StressPicture(BodyPicture):
    """A picture of the stress on the surface at the instant of the largest von Mises stress.

    Parameters
    ----------
    file : str
        File of the picture.
    component : str
        Component of the stress; principal stresses are numbered from the largest.
    scale : float
        Factor on the deformation in the picture.

    Examples
    --------
    ::

        [[output]]
        type = "stress"
        file = "von-mises.png"
        body = "beam"
        scale = 10.0
    """

    type: Literal["stress"]
    file: PictureFile
    component: Component = "von Mises"
    scale: Scale = 1.0


class Film(BodyPicture):
    """A film of a body in motion, coloured by the stress on its surface.

    Parameters
    ----------
    file : str
        File of the film.
    component : str
        Component of the stress; principal stresses are numbered from the largest.
    scale : float
        Factor on the deformation in the picture.
    frames : int
        Number of pictures, spread over the duration.
    rate : float
        Pictures a second when the film is played [1/s].

    Examples
    --------
    ::

        [[output]]
        type = "film"
        file = "motion.mp4"
        body = "beam"
        frames = 80
        rate = 20.0
    """

    type: Literal["film"]
    file: Annotated[str, AfterValidator(FileCheck((".mp4", ".gif"))), AfterValidator(_check_no_mode)]
    component: Component = "von Mises"
    scale: Scale = 1.0
    frames: Annotated[int, Field(strict=True, ge=2, le=2000)]
    rate: Annotated[Number, Positive]


class Export(SceneTable):
    """A file for other tools; its suffix gives the format and what it holds.

    ``.msh`` and ``.vtu`` hold the mesh with its parts, ``.vtkhdf`` displacement and stress at several times for
    ParaView, ``.nc`` the reduced body: modes, mass, stiffness, inertia integrals and the stress of each mode.

    Parameters
    ----------
    file : str
        File that is written.
    body : str
        Flexible body that it holds.
    frames : int
        Number of output times in a ``.vtkhdf`` file, spread over the duration.

    Examples
    --------
    ::

        [[output]]
        type = "export"
        file = "motion.vtkhdf"
        body = "propeller"
        frames = 41
    """

    type: Literal["export"]
    file: Annotated[str, AfterValidator(FileCheck((".msh", ".vtu", ".vtkhdf", ".nc"))), AfterValidator(_check_no_mode)]
    body: Place
    frames: Annotated[int, Field(strict=True, ge=2, le=2000)] = 21


Output = Annotated[
    Chart | MeshPicture | ModePictures | ModeSheet | StressPicture | Film | Export, Field(discriminator="type")
]
