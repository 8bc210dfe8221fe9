"""The output tables in a scene file: charts, pictures and films."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from pipeline.core.units import Angle, Length, NonNegative, Positive, PositiveLength, Stress
from pipeline.scene.reading import FaultError, SceneTable
from pipeline.scene.values import Number, Place


def _file(*suffixes: str) -> AfterValidator:
    """Return a check for a plain file name with one of these suffixes."""

    def check(file: str) -> str:
        plain = re.fullmatch(r"\w[\w .-]{0,99}", file.replace("{mode}", "1"))
        if not plain or ".." in file or not file.endswith(suffixes):
            raise ValueError(f"must be a plain file name without a folder, ending in {' or '.join(suffixes)}")
        return file

    return AfterValidator(check)


def _no_mode(file: str) -> str:
    if "{mode}" in file:
        raise ValueError("'{mode}' belongs to an output of type 'modes'")
    return file


def _one_mode(file: str) -> str:
    if file.count("{mode}") != 1:
        raise ValueError("must hold '{mode}' once, for the mode's number, e.g. 'mode-{mode}.png'")
    return file


Pixels = Annotated[int, Field(strict=True, ge=64, le=8192)]
Scale = Annotated[Number, NonNegative]
Component = Literal["von Mises", "xx", "yy", "zz", "yz", "xz", "xy", "principal 1", "principal 2", "principal 3"]


class Chart(SceneTable):
    """A chart of one quantity over time, with all runs in it.

    Parameters
    ----------
    file, title : str
        Its file, and the text above it.
    quantity : str
        What is drawn.
    joint : str, optional
        The revolute or prismatic joint whose coordinate or rate is drawn.
    element : str, optional
        ``"body.element"``, a named element whose stress is drawn.
    component : str
        Of that stress.
    unit : str, optional
        What it is drawn in, e.g. ``"deg"`` or ``"mm/s"``; else in rad, m, s and MPa.
    band : tuple of float, optional
        A range of stress to be marked [Pa], with ``band_title`` in the legend.
    """

    type: Literal["chart"]
    file: Annotated[str, _file(".png", ".pdf", ".svg"), AfterValidator(_no_mode)]
    quantity: Literal[
        "com_position",
        "com_velocity",
        "com_angular_velocity",
        "tip_deflection",
        "tip_displacement",
        "tip_position",
        "joint_angle",
        "joint_rate",
        "joint_position",
        "modal_coordinates",
        "energy",
        "element_stress",
    ]
    joint: Place | None = None
    element: Place | None = None
    component: Component = "von Mises"
    unit: Place | None = None
    title: str = ""
    band: tuple[Stress, Stress] | None = None
    band_title: str = ""

    @model_validator(mode="after")
    def _joint_where_needed(self) -> Chart:
        if self.quantity == "joint_position" and self.joint is None:
            raise FaultError("is missing: the name of the joint whose coordinate is drawn", "joint")
        if self.quantity not in ("joint_position", "joint_rate") and self.joint is not None:
            raise FaultError("belongs to the quantities 'joint_position' and 'joint_rate'", "joint")
        if self.unit is not None and self.joint is None and self.element is None:
            raise FaultError("belongs to a joint's position or rate, or to a stress", "unit")
        if (self.element is None) == (self.quantity == "element_stress"):
            wrong = "is missing: 'body.element', the element" if self.element is None else "belongs to 'element_stress'"
            raise FaultError(wrong, "element")
        if self.band is not None and (self.element is None or not self.band[0] < self.band[1]):
            raise FaultError("must be two stresses, the smaller first, on a chart of 'element_stress'", "band")
        return self


class BodyPicture(SceneTable):
    """What pictures and films have in common.

    Parameters
    ----------
    body : str
        The flexible body that is shown.
    size : tuple of int, optional
        Width and height [pixels].
    camera : tuple of float, optional
        Where the viewer stands: azimuth about z, counted from x, and elevation [rad].
    zoom : float
        Factor on the body's size in the picture.
    focus : tuple of float, optional
        The point in the middle of a close-up [m].
    extent : float, optional
        Length that the picture's width shows [m].
    colour_map : str
        Matplotlib's name of the colours.
    title : str
        The text above; else it is made from the scene's.
    """

    body: Place
    size: tuple[Pixels, Pixels] | None = None
    camera: tuple[Angle, Annotated[Angle, Field(ge=-1.58, le=1.58)]] | None = None
    zoom: Annotated[Number, Field(ge=0.01, le=1000.0)] = 1.0
    focus: tuple[Length, Length, Length] | None = None
    extent: PositiveLength | None = None
    colour_map: Place = "turbo"
    title: str = ""


class MeshPicture(BodyPicture):
    """A picture of a body's mesh, its parts in colours."""

    type: Literal["mesh"]
    file: Annotated[str, _file(".png"), AfterValidator(_no_mode)]


class ModePictures(BodyPicture):
    """A picture of each mode; its number replaces ``{mode}`` in ``file``, ``scale`` magnifies its shape."""

    type: Literal["modes"]
    file: Annotated[str, _file(".png"), AfterValidator(_one_mode)]
    scale: Annotated[Number, Positive] | None = None


class ModeSheet(BodyPicture):
    """The first ``count`` elastic modes in one picture; ``scale`` magnifies their shapes."""

    type: Literal["mode sheet"]
    file: Annotated[str, _file(".png"), AfterValidator(_no_mode)]
    count: Annotated[int, Field(strict=True, ge=1, le=30)] = 6
    scale: Annotated[Number, Positive] = 1.0


class StressPicture(BodyPicture):
    """A picture of one ``component`` of the stress at the worst instant; ``scale`` magnifies the deformation."""

    type: Literal["stress"]
    file: Annotated[str, _file(".png"), AfterValidator(_no_mode)]
    component: Component = "von Mises"
    scale: Scale = 1.0


class Film(BodyPicture):
    """A film of a body in motion: ``frames`` pictures, shown at ``rate`` [1/s]; else as for the stress."""

    type: Literal["film"]
    file: Annotated[str, _file(".mp4", ".gif"), AfterValidator(_no_mode)]
    component: Component = "von Mises"
    scale: Scale = 1.0
    frames: Annotated[int, Field(strict=True, ge=2, le=2000)]
    rate: Annotated[Number, Positive]


class Export(SceneTable):
    """A file for other tools, by its suffix.

    ``.msh`` and ``.vtu`` hold the mesh with its parts, ``.vtkhdf`` displacement and stress at ``frames`` output times,
    ``.nc`` the reduced body: modes, mass, stiffness, inertia integrals and the stress of each mode.
    """

    type: Literal["export"]
    file: Annotated[str, _file(".msh", ".vtu", ".vtkhdf", ".nc"), AfterValidator(_no_mode)]
    body: Place
    frames: Annotated[int, Field(strict=True, ge=2, le=2000)] = 21


Output = Annotated[
    Chart | MeshPicture | ModePictures | ModeSheet | StressPicture | Film | Export, Field(discriminator="type")
]
