"""The tables of a scene that name one another."""

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from fmd.scene.any_body import Body, Flexible, wanted_pieces
from fmd.scene.constraints import AnyCoupler
from fmd.scene.contacts import Contact
from fmd.scene.controllers import AnyController
from fmd.scene.fit import FitTable
from fmd.scene.force_elements import Bearing, Bushing, ForceElement, Spring
from fmd.scene.gear_teeth import GearTeethContact
from fmd.scene.joints.any_joint import Joint, closing_joints
from fmd.scene.loads import Drive, MarkerLoad
from fmd.scene.outputs import Output, with_only_body
from fmd.scene.places import GroundPlace
from fmd.scene.reading import SceneTable
from fmd.scene.runs import AutoRun
from fmd.scene.simulation import Simulation
from fmd.scene.state_loads import VariableName
from fmd.scene.values import Name


class SceneTables(SceneTable):
    """Bodies, joints and all that names them, each table checked by itself."""

    body: dict[Name, Body]  # Bodies by name.
    ground: dict[Name, GroundPlace] = Field(default_factory=dict)  # Places on the ground by name.
    # Joints by name. In a scene with a simulation every body is the child of one joint.
    joint: dict[Name, Joint] = Field(default_factory=dict)
    drive: dict[Name, Drive] = Field(default_factory=dict)  # Torques, forces and prescribed motions by name.
    # Controllers by name, whose outputs formulas of drives and of later controllers name.
    controller: dict[VariableName, AnyController] = Field(default_factory=dict)
    # Gears, slides that move together and racks by name.
    coupler: dict[Name, AnyCoupler] = Field(default_factory=dict)
    spring: dict[Name, Spring] = Field(default_factory=dict)  # Force elements between two places, by name.
    bushing: dict[Name, Bushing] = Field(default_factory=dict)  # Force elements between two places, by name.
    bearing: dict[Name, Bearing] = Field(default_factory=dict)  # Force elements between two places, by name.
    contact: dict[Name, Contact] = Field(default_factory=dict)  # Faces that may touch planes or one another, by name.
    # Spur gears whose teeth push one another in motion, by name.
    gear_mesh: dict[Name, GearTeethContact] = Field(default_factory=dict)
    # The integration over time. Without it the scene has meshes and modes alone, and its bodies need no joint.
    simulation_table: Simulation | None = Field(default=None, alias="simulation")
    output: tuple[Output, ...] = ()  # Charts, pictures, films and files that a run writes.
    fit: FitTable | None = None  # What ``fmd fit`` finds from measurements.

    @field_validator("output", mode="before")
    @classmethod
    def _name_only_body(cls, given: Any, info: ValidationInfo) -> Any:
        """Name the only flexible body in outputs that hold one."""
        flexible = [name for name, body in info.data.get("body", {}).items() if isinstance(body, Flexible)]
        return [with_only_body(output, flexible) for output in given] if isinstance(given, list | tuple) else given

    @property
    def elements(self) -> dict[str, dict[str, ForceElement]]:
        """The force elements by table and name."""
        return {"spring": dict(self.spring), "bushing": dict(self.bushing), "bearing": dict(self.bearing)}

    @property
    def loaded_places(self) -> set[str]:
        """The places, ``"body.marker"`` or on the ground, at which joints, loads and force elements act."""
        places = {end for joint in self.joint.values() for end in (joint.parent, joint.child)}
        places |= {load.marker for load in self.drive.values() if isinstance(load, MarkerLoad)}
        return places | {end for table in self.elements.values() for one in table.values() for end in one.between}

    @property
    def touching_faces(self) -> tuple[tuple[str, str, str], ...]:
        """Contact, body and marker of each face of a flexible body that may touch something."""
        both = ((name, *end.partition(".")[::2]) for name, own in self.contact.items() for end in own.between)
        return tuple((name, body, face) for name, body, face in both if body in self.flexible)

    @property
    def refines_contacts(self) -> bool:
        """True if steps are halved until contacts' figures agree: the run of a scene with contacts is ``"auto"``."""
        table = self.simulation_table
        return bool(self.contact) and table is not None and any(isinstance(own, AutoRun) for own in table.run)

    @property
    def rigid_in_contact(self) -> tuple[str, ...]:
        """The rigid bodies that may touch something."""
        bodies = (end.partition(".")[0] for own in self.contact.values() for end in own.between)
        return tuple(dict.fromkeys(body for body in bodies if body in self.body and body not in self.flexible))

    @property
    def of_triangles(self) -> set[str]:
        """The surfaces of rigid bodies, ``"body.surface"``, that are triangles of a file."""
        surfaces = {name: getattr(body, "surface", {}) for name, body in self.body.items()}
        return {f"{body}.{name}" for body, own in surfaces.items() for name in own if own[name].type == "file"}

    def faces_in_contact(self, body: str, with_bodies: bool) -> tuple[str, ...]:
        """Return the markers on the faces of a body that may touch something, or faces of other bodies alone."""
        pairs = {name for name, *_ in self.touching_faces if [at[0] for at in self.touching_faces].count(name) == 2}
        pairs |= {name for name, own in self.contact.items() if not self.of_triangles.isdisjoint(own.between)}
        faces = (at for at in self.touching_faces if at[0] in pairs or not with_bodies)
        return tuple(dict.fromkeys(face for _, own, face in faces if own == body))

    def markers_under_load(self, body: str) -> tuple[str, ...]:
        """Return the markers of a body that drives and force elements act on."""
        places = [drive.marker for drive in self.drive.values() if isinstance(drive, MarkerLoad)]
        places += [end for table in self.elements.values() for element in table.values() for end in element.between]
        return _of_body(body, places)

    def markers_on_joints(self, body: str) -> tuple[str, ...]:
        """Return the markers of a body that joints hold it by."""
        return _of_body(body, [end for joint in self.joint.values() for end in (joint.parent, joint.child)])

    @property
    def flexible(self) -> dict[str, Flexible]:
        """The flexible bodies by name."""
        return {name: body for name, body in self.body.items() if isinstance(body, Flexible)}

    def with_its_basis(self, name: str) -> Flexible:
        """Return a flexible body with the basis that it has where the scene leaves that open.

        Fixed-interface modes have static responses already. Free modes of a body on joints with others stand alone: the
        static responses to their forces have very high frequencies, which couple through the joints, so that next to no
        step would do.
        """
        body = self.flexible[name]
        if (modes := body.modes).enrich:
            return body
        pairs = [{end.partition(".")[0] for end in (joint.parent, joint.child)} for joint in self.joint.values()]
        joined = any(name in pair and "ground" not in pair for pair in pairs)
        bare = modes.boundary == "interface" or (joined and modes.boundary == "free")
        return body.model_copy(update={"modes": modes.model_copy(update={"enrich": "none" if bare else "inertia"})})

    @property
    def pieces(self) -> dict[str, int | Literal["auto"]]:
        """Numbers of pieces of the flexible bodies that are to be cut, by name."""
        return wanted_pieces(self.flexible)

    @property
    def sampled(self) -> tuple[str, ...]:
        """Names of the controllers that measure now and then."""
        return tuple(name for name, one in self.controller.items() if getattr(one, "sample_time", None))

    @property
    def closing(self) -> tuple[str, ...]:
        """Names of the joints that close loops."""
        return closing_joints(self.joint)

    @property
    def carrying(self) -> dict[str, str]:
        """Name of the joint that carries each body, by the body's name."""
        closing = self.closing
        return {joint.child.partition(".")[0]: name for name, joint in self.joint.items() if name not in closing}

    @property
    def turned_round(self) -> dict[str, str]:
        """Joint whose child is the ground, by the body that is its parent and hangs on no other joint."""
        ends = {
            name: [end.partition(".")[0] for end in (joint.parent, joint.child)] for name, joint in self.joint.items()
        }
        hanging = self.body.keys() - self.carrying.keys()
        return {parent: name for name, (parent, child) in ends.items() if child == "ground" and parent in hanging}


def leads_round(body: str, parents: Mapping[str, str]) -> bool:
    """Return true if the parents of a body come back to one of themselves."""
    seen: set[str] = set()
    while body in parents and body not in seen:
        seen.add(body)
        body = parents[body]
    return body in seen


def _of_body(body: str, places: list[str]) -> tuple[str, ...]:
    """Return the markers of a body among places, each once."""
    return tuple(dict.fromkeys(marker for own, _, marker in (place.partition(".") for place in places) if own == body))
