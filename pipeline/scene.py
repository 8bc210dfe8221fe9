"""The scene: what is asked for, read from a TOML file and checked as a whole.

Quantities are SI floats once read. Every fault in the file is one ``InputError``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, PrivateAttr, ValidationError, model_validator

from pipeline.scene_file import FaultError, KeyPath, Table, among, read_scene_file, ready_scenes
from pipeline.units import (
    Angle,
    AngularRate,
    NonNegative,
    NonNegativeTime,
    Positive,
    PositiveDensity,
    PositiveFrequency,
    PositiveLength,
    PositiveStress,
    PositiveTime,
    Torque,
)

__all__ = ["Scene", "load_scene", "ready_scenes"]


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


Name = Annotated[str, AfterValidator(_name)]
Place = Annotated[str, Field(max_length=100)]
Number = Annotated[float, Field(strict=True)]
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Pixels = Annotated[int, Field(strict=True, ge=64, le=8192)]
Scale = Annotated[Number, NonNegative]


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


class CentralDifference(Table):
    """Central differences; ``step`` [s] overrides that of the simulation."""

    integrator: Literal["central-difference"]
    step: PositiveTime | None = None


class SubCycling(Table):
    """Sub-cycling: ``substeps`` fast steps in a slow one; ``step`` [s] overrides that of the simulation."""

    integrator: Literal["sub-cycling"]
    substeps: Count
    step: PositiveTime | None = None


class Chart(Table):
    """A chart of one quantity over time, with all runs in it."""

    type: Literal["chart"]
    file: Annotated[str, _file(".png", ".pdf", ".svg"), AfterValidator(_no_mode)]
    quantity: Literal[
        "com_position",
        "com_velocity",
        "com_angular_velocity",
        "tip_deflection",
        "joint_angle",
        "joint_rate",
        "modal_coordinates",
        "energy",
    ]
    title: str = ""


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


# Each is told apart by one key; where there is one member so far, the key is checked all the same.
Body = Annotated[Bar, Field(discriminator="shape")]
Joint = Annotated[Revolute, Field(discriminator="type")]
Drive = Annotated[TorquePulse, Field(discriminator="type")]
Run = Annotated[CentralDifference | SubCycling, Field(discriminator="integrator")]
Output = Annotated[Chart | ModePictures | StressPicture | Film, Field(discriminator="type")]


class Simulation(Table):
    """What is integrated over time, and how.

    Parameters
    ----------
    duration, step, output_step : float
        How long it lasts, the time step, and the time between two results [s].
    tip : str
        ``"body.marker"`` whose deflection is recorded.
    frame : str
        How free modes are re-expressed for a body's joint.
    run : tuple of Run
        The integrations; the others are compared with the first.
    """

    duration: PositiveTime
    step: PositiveTime
    output_step: PositiveTime
    tip: Place
    frame: Literal["joint-conforming", "free"] = "joint-conforming"
    run: Annotated[tuple[Run, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _steps_fit(self) -> Simulation:
        steps: dict[KeyPath, float | None] = {("step",): self.step, ("output_step",): self.output_step}
        steps |= {("run", number, "step"): run.step for number, run in enumerate(self.run)}
        for path, step in steps.items():
            if step is not None and step > self.duration:
                raise FaultError(f"must not be longer than the duration, {self.duration:g} s", *path)
        return self


class Reference(Table):
    """Published results to compare with: their ``source`` and natural ``frequencies`` [Hz]."""

    source: str
    frequencies: tuple[PositiveFrequency, ...]


class Scene(Table):
    """Everything that is asked for.

    ``model_dump(mode="json")`` is its content, for hashing.
    """

    title: str
    source: str = ""
    body: Annotated[dict[Name, Body], Field(min_length=1)]
    joint: dict[Name, Joint]
    drive: dict[Name, Drive] = Field(default_factory=dict)
    simulation: Simulation
    reference: Reference | None = None
    output: tuple[Output, ...] = ()
    _file: str = PrivateAttr("")

    @property
    def file(self) -> str:
        """The file that it was read from."""
        return self._file

    @property
    def name(self) -> str:
        """The file's name without folder and suffix."""
        return Path(self._file).stem

    @model_validator(mode="after")
    def _fits_together(self) -> Scene:
        faults = [*self._wrong_names(), *self._shared_files()] or [*self._wrong_tree()]
        if faults:
            faults[0].more = len(faults) - 1
            raise faults[0]
        return self

    def _wrong_names(self) -> Iterator[FaultError]:
        for name, joint in self.joint.items():
            if joint.parent != "ground":
                yield from self._wrong_marker(joint.parent, "joint", name, "parent")
            yield from self._wrong_marker(joint.child, "joint", name, "child")
        for name, drive in self.drive.items():
            if drive.joint not in self.joint:
                message = f"no such joint; {among(drive.joint, self.joint, 'the joints')}"
                yield FaultError(message, "drive", name, "joint")
        yield from self._wrong_marker(self.simulation.tip, "simulation", "tip")
        for number, output in enumerate(self.output):
            if not isinstance(output, Chart) and output.body not in self.body:
                message = f"no such body; {among(output.body, self.body, 'the bodies')}"
                yield FaultError(message, "output", number, "body")

    def _wrong_marker(self, place: str, *path: str | int) -> Iterator[FaultError]:
        body = place.partition(".")[0]
        if body not in self.body:
            yield FaultError(f"no such body; {among(body, self.body, 'the bodies')}", *path)
            return
        markers = [f"{body}.{marker}" for marker in self.body[body].marker]
        if place not in markers:
            yield FaultError(f"no such marker; {among(place, markers, 'the markers')}", *path)

    def _shared_files(self) -> Iterator[FaultError]:
        taken: list[tuple[str, str]] = []
        for number, output in enumerate(self.output):
            file = output.file.casefold()  # some file systems take upper and lower case for the same
            pattern = re.escape(file).replace(r"\{mode\}", r"(\d+|\{mode\})")
            if any(re.fullmatch(pattern, other) or re.fullmatch(its, file) for other, its in taken):
                yield FaultError("another output has this file; rename it", "output", number, "file")
            taken.append((file, pattern))

    def _wrong_tree(self) -> Iterator[FaultError]:
        """Every body hangs on one joint, and through it on the ground."""
        parents: dict[str, str] = {}
        for name, joint in self.joint.items():
            child = joint.child.partition(".")[0]
            if child in parents:
                yield FaultError("is the child of another joint; a body has one", "joint", name, "child")
            parents[child] = joint.parent.partition(".")[0]
        for body in self.body:
            if body not in parents:
                yield FaultError(f"hangs on no joint; give it one with child = '{body}.…'", "body", body)
                continue
            seen: set[str] = set()
            link = body
            while link in parents and link not in seen:
                seen.add(link)
                link = parents[link]
            if link in seen:
                yield FaultError("its joints lead round in a circle; one must lead to ground", "body", body)


def load_scene(name_or_path: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read a scene file.

    Parameters
    ----------
    name_or_path : str or Path
        A ready scene's name, e.g. ``"beam"``, or the path of a TOML file.
    overrides : sequence of str
        Values to use instead of the file's: ``"body.beam.length=300mm"``, ``"simulation.run.1.substeps=7"``.
        The items of a list count from 0. What isn't a TOML value is taken as a string.

    Returns
    -------
    Scene
        The scene, checked; quantities in SI units.

    Raises
    ------
    InputError
        The file can't be read, or something in it is wrong; the message names the key and what would work.
    """
    source = read_scene_file(name_or_path, overrides)
    try:
        scene = Scene.model_validate(source.data)
    except ValidationError as error:
        raise source.input_error(error) from None
    scene._file = source.file
    return scene
