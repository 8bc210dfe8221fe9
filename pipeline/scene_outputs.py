"""The output tables in a scene file: charts, pictures and films."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from pipeline.scene_file import FaultError, Table
from pipeline.scene_parts import Number, Place
from pipeline.units import NonNegative, Positive


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


class Chart(Table):
    """A chart of one quantity over time, with all runs in it.

    Parameters
    ----------
    file, title : str
        Its file, and the text above it.
    quantity : str
        What is drawn.
    joint : str, optional
        The revolute or prismatic joint whose coordinate or rate is drawn.
    unit : str, optional
        What it is drawn in, e.g. ``"deg"`` or ``"mm/s"``; else in rad, m and s.
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
    ]
    joint: Place | None = None
    unit: Place | None = None
    title: str = ""

    @model_validator(mode="after")
    def _joint_where_needed(self) -> Chart:
        if self.quantity == "joint_position" and self.joint is None:
            raise FaultError("is missing: the name of the joint whose coordinate is drawn", "joint")
        if self.quantity not in ("joint_position", "joint_rate") and self.joint is not None:
            raise FaultError("belongs to the quantities 'joint_position' and 'joint_rate'", "joint")
        if self.unit is not None and self.joint is None:
            raise FaultError("belongs to a joint's position or rate", "unit")
        return self


class ModePictures(Table):
    """A picture of each mode; its number replaces ``{mode}`` in ``file``, ``scale`` magnifies its shape."""

    type: Literal["modes"]
    file: Annotated[str, _file(".png"), AfterValidator(_one_mode)]
    body: Place
    scale: Annotated[Number, Positive] | None = None


class StressPicture(Table):
    """A picture of a body's stress; ``scale`` magnifies the deformation, ``size`` is in pixels."""

    type: Literal["stress"]
    file: Annotated[str, _file(".png"), AfterValidator(_no_mode)]
    body: Place
    scale: Scale = 1.0
    size: tuple[Pixels, Pixels] = (1600, 900)


class Film(Table):
    """A film of a body in motion: ``frames`` pictures, shown at ``rate`` [1/s]; else as for the stress."""

    type: Literal["film"]
    file: Annotated[str, _file(".mp4", ".gif"), AfterValidator(_no_mode)]
    body: Place
    scale: Scale = 1.0
    frames: Annotated[int, Field(strict=True, ge=2, le=2000)]
    rate: Annotated[Number, Positive]
    size: tuple[Pixels, Pixels] = (1280, 720)


Output = Annotated[Chart | ModePictures | StressPicture | Film, Field(discriminator="type")]
