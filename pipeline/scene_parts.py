"""The mechanism's tables in a scene file: bodies with mesh, modes and markers, joints, drives."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from pipeline.scene_file import FaultError, Table
from pipeline.units import (
    Angle,
    AngularRate,
    NonNegativeTime,
    PositiveDensity,
    PositiveLength,
    PositiveStress,
    PositiveTime,
    Torque,
)


def _name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,39}", name) or name == "ground":
        raise ValueError("a name is a letter and up to 39 letters, digits, '_' or '-'; 'ground' is taken")
    return name


def _poisson(nu: float) -> float:
    if not nu > -1:
        raise ValueError("must be above -1; most metals have about 0.3")
    if not nu < 0.5:
        raise ValueError("must be below 0.5 (0.5 is incompressible); 0.499 works")
    return nu


Name = Annotated[str, AfterValidator(_name)]
Place = Annotated[str, Field(max_length=100)]
Number = Annotated[float, Field(strict=True)]
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]


class Mesh(Table):
    """How a body is divided into elements.

    Parameters
    ----------
    element : str
        The elements' shape.
    order : int
        Polynomial order of the displacement in an element.
    divisions : tuple of int, optional
        Elements along x, y and z; for hexahedra.
    size : float, optional
        Edge length of an element [m]; for tetrahedra.
    """

    element: Literal["hexahedron", "tetrahedron"] = "hexahedron"
    order: Annotated[int, Field(strict=True, ge=1, le=2)] = 2
    divisions: tuple[Count, Count, Count] | None = None
    size: PositiveLength | None = None

    @model_validator(mode="after")
    def _divided_one_way(self) -> Mesh:
        if self.element == "hexahedron":
            if self.size is not None:
                raise FaultError("belongs to tetrahedra; hexahedra take divisions, e.g. [48, 4, 2]", "size")
            if self.divisions is None:
                raise FaultError("is missing: hexahedra along x, y and z, e.g. [48, 4, 2]", "divisions")
        else:
            if self.divisions is not None:
                raise FaultError("belongs to hexahedra; tetrahedra take a size, e.g. '5 mm'", "divisions")
            if self.size is None:
                raise FaultError("is missing: the edge length of a tetrahedron, e.g. '5 mm'", "size")
        return self


class Modes(Table):
    """Which modes describe a body's deformation.

    Parameters
    ----------
    count : int
        How many, above the rigid-body modes.
    family : str
        The kind of motion that they are chosen from.
    enrich : str
        The loads whose static responses are added.
    """

    count: Count
    family: Literal["any", "in-plane bending", "out-of-plane bending", "torsion", "axial"] = "any"
    enrich: Literal["none", "inertia"] = "none"


class Marker(Table):
    """A face of a body, named for joints and results; ``"x-"`` is where x is least."""

    face: Literal["x-", "x+", "y-", "y+", "z-", "z+"]


class Bar(Table):
    """A straight bar with a rectangular section.

    Parameters
    ----------
    length, depth, width : float
        Extent along x, y and z [m].
    E : float
        Young's modulus [Pa].
    nu : float
        Poisson's ratio.
    rho : float
        Density [kg/m³].
    mesh, modes, marker
        Its elements, its modes, and its markers by name.
    """

    shape: Literal["bar"]
    length: PositiveLength
    depth: PositiveLength
    width: PositiveLength
    E: PositiveStress
    nu: Annotated[Number, AfterValidator(_poisson)]
    rho: PositiveDensity
    mesh: Mesh
    modes: Modes
    marker: dict[Name, Marker]


class Revolute(Table):
    """A hinge.

    Parameters
    ----------
    parent, child : str
        ``"body.marker"``; the parent may be ``"ground"``.
    axis : tuple of float
        Its direction; the length is of no account.
    angle : float
        Angle at the start [rad].
    rate : float
        Angular rate at the start [rad/s].
    """

    type: Literal["revolute"]
    parent: Place
    child: Place
    axis: tuple[Number, Number, Number]
    angle: Angle = 0.0
    rate: AngularRate = 0.0

    @model_validator(mode="after")
    def _has_direction(self) -> Revolute:
        if not any(self.axis):
            raise FaultError("has no direction; [0, 0, 1] is the z axis", "axis")
        return self


class TorquePulse(Table):
    """A smooth torque about a joint that ends by itself, given by its effect or by its peak.

    Parameters
    ----------
    joint : str
        The joint that it drives.
    duration, start : float
        How long it lasts and when it begins [s].
    speed : float, optional
        Mean rate that it brings the joint to from rest [rad/s].
    torque : float, optional
        Its peak [N m].
    """

    type: Literal["torque pulse"]
    joint: Place
    duration: PositiveTime
    start: NonNegativeTime = 0.0
    speed: AngularRate | None = None
    torque: Torque | None = None

    @model_validator(mode="after")
    def _sized_one_way(self) -> TorquePulse:
        if self.speed is None and self.torque is None:
            raise FaultError("is missing: give it, e.g. '20 rad/s', or a torque, e.g. '1.5 N m'", "speed")
        if self.speed is not None and self.torque is not None:
            raise FaultError("can't stand beside speed: give one of the two", "torque")
        return self


# Each is told apart by one key; where there is one member so far, the key is checked all the same.
Body = Annotated[Bar, Field(discriminator="shape")]
Joint = Annotated[Revolute, Field(discriminator="type")]
Drive = Annotated[TorquePulse, Field(discriminator="type")]
