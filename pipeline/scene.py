"""The scene: what is asked for, read from a TOML file and checked as a whole.

Quantities are SI floats once read. Every fault in the file is one ``InputError``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, PrivateAttr, ValidationError, model_validator

from pipeline.scene_file import FaultError, KeyPath, Table, among, read_scene_file, ready_scenes
from pipeline.scene_outputs import Chart, Film, ModePictures, Output, Pixels, Scale, StressPicture
from pipeline.scene_parts import (
    Axis,
    Bar,
    Body,
    Count,
    Drive,
    Fixed,
    ForceDrive,
    Free,
    Joint,
    Marker,
    Mesh,
    Modes,
    MotionDrive,
    Name,
    Number,
    Place,
    PointForce,
    PointMarker,
    PointMass,
    PointTorque,
    Prismatic,
    Revolute,
    RigidBody,
    Rod,
    Spherical,
    TorqueDrive,
    TorquePulse,
)
from pipeline.units import Acceleration, PositiveFrequency, PositiveTime, unit_ratio

__all__ = [
    "Axis",
    "Bar",
    "Body",
    "CentralDifference",
    "Chart",
    "Count",
    "Drive",
    "Film",
    "Fixed",
    "ForceDrive",
    "Free",
    "Joint",
    "Marker",
    "Mesh",
    "ModePictures",
    "Modes",
    "MotionDrive",
    "Name",
    "Number",
    "Output",
    "Pixels",
    "Place",
    "PointForce",
    "PointMarker",
    "PointMass",
    "PointTorque",
    "Prismatic",
    "Reference",
    "Revolute",
    "RigidBody",
    "Rod",
    "Run",
    "Scale",
    "Scene",
    "Simulation",
    "Spherical",
    "StressPicture",
    "SubCycling",
    "TorqueDrive",
    "TorquePulse",
    "load_scene",
    "ready_scenes",
]

_SINGLE = ("revolute", "prismatic")  # the joints with one coordinate

Tolerance = Annotated[Number, Field(ge=3e-14, lt=1.0)]


class CentralDifference(Table):
    """Central differences; ``step`` [s] overrides that of the simulation."""

    integrator: Literal["central-difference"]
    step: PositiveTime | None = None


class SubCycling(Table):
    """Sub-cycling.

    Parameters
    ----------
    substeps : int or str
        Fast steps in a slow one; ``"auto"`` chooses with the split.
    split : float or str
        What is slow: all joints but those listed as fast (``"joints"``), every coordinate below a frequency [Hz], or
        what makes the least work for the wanted error (``"auto"``).
    step : float, optional
        Fast step [s]; overrides that of the simulation.
    """

    integrator: Literal["sub-cycling"]
    substeps: Count | Literal["auto"]
    split: Literal["joints", "auto"] | PositiveFrequency = "joints"
    step: PositiveTime | None = None

    @model_validator(mode="after")
    def _both_or_none(self) -> SubCycling:
        if (self.substeps == "auto") != (self.split == "auto"):
            raise FaultError("is chosen together with the split: give both 'auto' or none", "substeps")
        return self


class ExponentialRun(Table):
    """Exponential time differencing of order 4; ``step`` [s] overrides that of the simulation."""

    integrator: Literal["exponential"]
    step: PositiveTime | None = None


class RosenbrockRun(Table):
    """Exponential Rosenbrock method of order 4: chooses its steps by a relative ``tolerance``."""

    integrator: Literal["exponential-rosenbrock"]
    tolerance: Tolerance = 1e-6

    step: ClassVar[None] = None


class RungeKuttaRun(Table):
    """Dormand and Prince's Runge–Kutta method of order 8: chooses its steps by a relative ``tolerance``."""

    integrator: Literal["runge-kutta"]
    tolerance: Tolerance = 1e-9

    step: ClassVar[None] = None


class GeneralizedAlphaRun(Table):
    """Generalised-α with spectral radius ``rho`` at infinite frequency; with a ``tolerance`` it chooses its steps."""

    integrator: Literal["generalized-alpha"]
    rho: Annotated[Number, Field(ge=0.0, le=1.0)] = 0.8
    step: PositiveTime | None = None
    tolerance: Tolerance | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> GeneralizedAlphaRun:
        if self.step is not None and self.tolerance is not None:
            raise FaultError("can't stand beside a step: with a tolerance the method chooses its steps", "tolerance")
        return self


class ScipyRun(Table):
    """One of SciPy's adaptive methods, with its relative ``tolerance``."""

    integrator: Literal["DOP853", "Radau", "LSODA"]
    tolerance: Tolerance = 1e-9

    step: ClassVar[None] = None


class AutoRun(Table):
    """The method that measurements say is fastest, with a step that meets the simulation's wanted error."""

    integrator: Literal["auto"]

    step: ClassVar[None] = None


Run = Annotated[
    CentralDifference
    | SubCycling
    | ExponentialRun
    | RosenbrockRun
    | RungeKuttaRun
    | GeneralizedAlphaRun
    | ScipyRun
    | AutoRun,
    Field(discriminator="integrator"),
]


class Simulation(Table):
    """What is integrated over time, and how.

    Parameters
    ----------
    duration, output_step : float
        How long it lasts, and the time between two results [s].
    step : float, optional
        Time step of the methods that don't choose it [s].
    error : float
        Wanted error, relative to the largest value of each kind of coordinate; for what is chosen automatically.
    tip : str
        ``"body.marker"`` whose motion is recorded.
    gravity : tuple of float
        Acceleration of free fall [m/s²].
    frame : str
        How free modes are re-expressed for a torque-driven hinge.
    stiffening : str
        Geometric stiffening by the inertia loads: when the speed matters, always or never.
    fast : tuple of str
        The revolute and prismatic joints whose coordinates take the fast steps in sub-cycling.
    run : tuple of Run
        The integrations; the others are compared with the first.
    """

    duration: PositiveTime
    output_step: PositiveTime
    step: PositiveTime | None = None
    error: Annotated[Number, Field(ge=1e-10, le=0.1)] = 1e-3
    tip: Place
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, 0.0)
    frame: Literal["joint-conforming", "free"] = "joint-conforming"
    stiffening: Literal["auto", "on", "off"] = "auto"
    fast: tuple[Place, ...] = ()
    run: Annotated[tuple[Run, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _steps_fit(self) -> Simulation:
        steps: dict[KeyPath, float | None] = {("step",): self.step, ("output_step",): self.output_step}
        steps |= {("run", number, "step"): run.step for number, run in enumerate(self.run)}
        for path, step in steps.items():
            if step is not None and step > self.duration:
                raise FaultError(f"must not be longer than the duration, {self.duration:g} s", *path)
        if self.step is None:
            for run in self.run:
                chooses = isinstance(run, RosenbrockRun | RungeKuttaRun | ScipyRun | AutoRun) or getattr(
                    run, "tolerance", None
                )
                if not chooses and run.step is None:
                    message = f"is missing: {run.integrator} needs a step, here or in the run, e.g. '10 us'"
                    raise FaultError(message, "step")
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
            if isinstance(drive, PointForce | PointTorque):
                yield from self._wrong_marker(drive.marker, "drive", name, "marker")
                continue
            fitting = {"force": ("prismatic",), "motion": _SINGLE}.get(drive.type, ("revolute",))
            wrong = [*self._wrong_joint(drive.joint, fitting, f"a {drive.type}", "drive", name, "joint")]
            yield from wrong or self._wrong_motion(name, drive)
        yield from self._wrong_marker(self.simulation.tip, "simulation", "tip")
        for number, joint_name in enumerate(self.simulation.fast):
            yield from self._wrong_joint(joint_name, _SINGLE, "the fast list", "simulation", "fast", number)
        for number, output in enumerate(self.output):
            if isinstance(output, Chart):
                yield from self._wrong_chart(output, "output", number)
            else:
                yield from self._wrong_picture(output, "output", number)

    def _wrong_motion(self, name: str, drive: Drive) -> Iterator[FaultError]:
        """A prescribed motion leaves its joint no coordinate: nothing else may act along it."""
        if not isinstance(drive, MotionDrive):
            return
        wanted, other = ("angle", "position") if self.joint[drive.joint].type == "revolute" else ("position", "angle")
        if getattr(drive, wanted) is None:
            yield FaultError(
                f"is missing: a {self.joint[drive.joint].type} joint moves by its {wanted}", "drive", name, wanted
            )
        if getattr(drive, other) is not None:
            yield FaultError(f"belongs to another joint; this one moves by its {wanted}", "drive", name, other)
        for other_name, also in self.drive.items():
            if other_name != name and getattr(also, "joint", None) == drive.joint:
                yield FaultError(f"has no effect: '{name}' prescribes the joint's motion", "drive", other_name, "joint")
        for key in (wanted, "rate", "spring", "damper"):
            if getattr(self.joint[drive.joint], key):
                yield FaultError(f"has no effect: '{name}' prescribes the joint's motion", "joint", drive.joint, key)
        if drive.joint in self.simulation.fast:
            number = self.simulation.fast.index(drive.joint)
            yield FaultError(f"has no coordinate: '{name}' prescribes its motion", "simulation", "fast", number)

    def _wrong_joint(self, name: str, fitting: tuple[str, ...], user: str, *path: str | int) -> Iterator[FaultError]:
        if name not in self.joint:
            yield FaultError(f"no such joint; {among(name, self.joint, 'the joints')}", *path)
        elif self.joint[name].type not in fitting:
            wanted = " or ".join(fitting)
            yield FaultError(f"is a {self.joint[name].type} joint; {user} needs a {wanted} one", *path)

    def _wrong_chart(self, chart: Chart, *path: str | int) -> Iterator[FaultError]:
        if chart.joint is None:
            return
        faults = [*self._wrong_joint(chart.joint, _SINGLE, "joint_position", *path, "joint")]
        yield from faults
        if not faults and chart.unit is not None:
            try:
                unit = "rad" if self.joint[chart.joint].type == "revolute" else "m"
                unit_ratio(f"{unit}/s" if chart.quantity == "joint_rate" else unit, chart.unit)
            except ValueError as error:
                yield FaultError(str(error), *path, "unit")

    def _wrong_picture(self, picture: ModePictures | StressPicture | Film, *path: str | int) -> Iterator[FaultError]:
        if picture.body not in self.body:
            yield FaultError(f"no such body; {among(picture.body, self.body, 'the bodies')}", *path, "body")
        elif not isinstance(self.body[picture.body], Bar):
            flexible = [name for name, body in self.body.items() if isinstance(body, Bar)]
            message = f"is rigid, without modes or stress; {among(picture.body, flexible, 'the flexible bodies')}"
            yield FaultError(message, *path, "body")

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
