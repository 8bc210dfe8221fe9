"""The scene: what is asked for, read from a TOML file and checked as a whole.

Quantities are SI floats once read. Every fault in the file is one ``InputError``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field, PrivateAttr, ValidationError, model_validator

from pipeline.core.errors import InputError
from pipeline.core.units import PositiveFrequency, Share, unit_ratio
from pipeline.scene.bodies import (
    Axis,
    Bar,
    Count,
    Marker,
    Mesh,
    Modes,
    Name,
    Number,
    Place,
    Propeller,
    PropellerMesh,
)
from pipeline.scene.joints import (
    Body,
    Drive,
    Fixed,
    Flexible,
    ForceDrive,
    Free,
    Joint,
    MotionDrive,
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
from pipeline.scene.outputs import (
    Chart,
    Export,
    Film,
    MeshPicture,
    ModePictures,
    ModeSheet,
    Output,
    Picture,
    Pixels,
    Scale,
    StressPicture,
)
from pipeline.scene.reading import FaultError, Table, among, read_scene_file, ready_scenes
from pipeline.scene.scene_table import scene_table
from pipeline.scene.simulation import CentralDifference, ReversibleSubCycling, Run, Simulation, SubCycling

__all__ = [
    "Axis",
    "Bar",
    "Body",
    "CentralDifference",
    "Chart",
    "Count",
    "Drive",
    "Export",
    "Film",
    "Fixed",
    "Flexible",
    "ForceDrive",
    "Free",
    "Joint",
    "Marker",
    "Mesh",
    "MeshPicture",
    "ModePictures",
    "ModeSheet",
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
    "Propeller",
    "PropellerMesh",
    "Reference",
    "ReversibleSubCycling",
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


class Reference(Table):
    """Published results to compare with: their ``source`` and natural ``frequencies`` [Hz]."""

    source: str
    frequencies: tuple[PositiveFrequency, ...]


class Scene(Table):
    """Everything that is asked for.

    ``model_dump(mode="json")`` is its content, for hashing. Without a simulation a scene is of parts alone, whose mesh
    and modes can be asked for; a part then needs no joint. With an ``accuracy``, a run chooses meshes, modes,
    integrator and step until its error budget states that or better for every quantity.
    """

    title: str
    source: str = ""
    accuracy: Share | None = None
    body: Annotated[dict[Name, Body], Field(min_length=1)]
    joint: dict[Name, Joint] = Field(default_factory=dict)
    drive: dict[Name, Drive] = Field(default_factory=dict)
    march: Simulation | None = Field(default=None, alias="simulation")
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

    @property
    def simulation(self) -> Simulation:
        """What is integrated over time.

        Raises
        ------
        InputError
            Nothing is.
        """
        if self.march is None:
            raise InputError(
                self.file, "simulation", None, "is missing: without it a scene has mesh and modes alone, no motion"
            )
        return self.march

    @property
    def flexible(self) -> dict[str, Flexible]:
        """The flexible bodies."""
        return {name: body for name, body in self.body.items() if isinstance(body, Flexible)}

    def _repr_html_(self) -> str:
        return scene_table(self.title, self.file, self.body, self.joint, self.drive, self.march, self.output)

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
        if self.march is not None:
            yield from self._wrong_marker(self.march.tip, "simulation", "tip")
            for number, joint_name in enumerate(self.march.fast):
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
        if self.march is not None and drive.joint in self.march.fast:
            number = self.march.fast.index(drive.joint)
            yield FaultError(f"has no coordinate: '{name}' prescribes its motion", "simulation", "fast", number)

    def _wrong_joint(self, name: str, fitting: tuple[str, ...], user: str, *path: str | int) -> Iterator[FaultError]:
        if name not in self.joint:
            yield FaultError(f"no such joint; {among(name, self.joint, 'the joints')}", *path)
        elif self.joint[name].type not in fitting:
            wanted = " or ".join(fitting)
            yield FaultError(f"is a {self.joint[name].type} joint; {user} needs a {wanted} one", *path)

    def _wrong_chart(self, chart: Chart, *path: str | int) -> Iterator[FaultError]:
        if chart.element is not None:
            yield from self._wrong_element(chart.element, *path, "element")
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

    def _wrong_element(self, place: str, *path: str | int) -> Iterator[FaultError]:
        elements = [f"{name}.{element}" for name, body in self.flexible.items() for element in body.element]
        if place not in elements:
            yield FaultError(f"no such element; {among(place, elements, 'the named elements')}", *path)

    def _wrong_picture(self, picture: Picture | Export, *path: str | int) -> Iterator[FaultError]:
        if picture.body not in self.body:
            yield FaultError(f"no such body; {among(picture.body, self.body, 'the bodies')}", *path, "body")
        elif picture.body not in self.flexible:
            message = f"is rigid, without modes or stress; {among(picture.body, self.flexible, 'the flexible bodies')}"
            yield FaultError(message, *path, "body")
        elif self.body[picture.body].shape == "matrices" and not _is_body_file(picture):
            yield FaultError("is given by its matrices: without elements there is no stress or picture", *path, "body")

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
            if joint.type == "free" and child in self.flexible and self.flexible[child].support:
                yield FaultError("holds nothing that a support could hold on to; take a fixed joint", "joint", name)
        for body in self.body:
            if body not in parents:
                if self.march is not None:
                    yield FaultError(f"hangs on no joint; give it one with child = '{body}.…'", "body", body)
                elif body in self.flexible and self.flexible[body].modes.boundary == "joint":
                    yield FaultError("hangs on no joint to be held at", "body", body, "modes", "boundary")
                continue
            seen: set[str] = set()
            link = body
            while link in parents and link not in seen:
                seen.add(link)
                link = parents[link]
            if link in seen:
                yield FaultError("its joints lead round in a circle; one must lead to ground", "body", body)


def _is_body_file(picture: Picture | Export) -> bool:
    return isinstance(picture, Export) and picture.file.endswith(".nc")


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
