"""Checks between the tables of a scene: names exist, joints fit their use, bodies form a tree on the ground."""

import re
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from fmd.core.data_classes import dataclass
from fmd.core.units import unit_ratio
from fmd.scene.contacts import check_bodies, check_faces, check_surface, check_wear_picture
from fmd.scene.controllers import Controller
from fmd.scene.curves import TimeFunction
from fmd.scene.gear_teeth import check_gears
from fmd.scene.histories import Quantities
from fmd.scene.joints.any_joint import Joint, kinds_that
from fmd.scene.joints.joint import RATE_KEYS, CarryingJoint
from fmd.scene.loads import Drive, MarkerLoad, MotionDrive
from fmd.scene.outputs import CONTACT_QUANTITIES, JOINT_QUANTITIES, MECHANISM_FORMATS, Chart, Export
from fmd.scene.pictures import BodyPicture, Film, MechanismView, StressPicture
from fmd.scene.reading import FaultError, UnknownNameError, suggest_name
from fmd.scene.rigid_bodies import Undeformable
from fmd.scene.run_faults import check_contact_runs, check_runs
from fmd.scene.scene_tables import SceneTables, leads_round
from fmd.scene.state_loads import OWN, FormulaVariables, LoadOverTime
from fmd.scene.stress_outputs import ContactPressure

_SINGLE = kinds_that(lambda kind: bool(kind.unit))


@dataclass(frozen=True, slots=True)
class CrossCheck:
    """Checks between the tables of a scene."""

    scene: SceneTables

    def find_faults(self) -> list[FaultError]:
        """List all faults; the tree of bodies is checked once the names in it are right."""
        return self._check_names() or [*self._check_tree()]

    def find_unknown_names(self, left_out: Collection[str]) -> list[FaultError]:
        """List the names that nothing has, but for those that have been left out because they have faults."""
        unknown = [fault for fault in self._check_names() if isinstance(fault, UnknownNameError)]
        return [fault for fault in unknown if not {*fault.name.split(".")} & {*left_out}]

    def find_unknown_parts(self, table: FormulaVariables, text: str) -> list[FaultError]:
        """List the names in a formula outside of the scene that nothing in it has; it may name controllers, too."""
        return [*self._check_state(table, text, [*self.scene.controller], (), ())]

    def _check_names(self) -> list[FaultError]:
        return [
            *self._check_joints(),
            *self._check_drives(),
            *self._check_controllers(),
            *self._check_elements(),
            *self._check_contacts(),
            *self._check_couplers(),
            *check_gears(self.scene),
            *self._check_simulation(),
            *self._check_outputs(),
        ]

    def _check_joints(self) -> Iterator[FaultError]:
        for name, joint in self.scene.joint.items():
            yield from self._check_place(joint.parent, "joint", name, "parent")
            yield from self._check_place(joint.child, "joint", name, "child")
            if joint.parent.partition(".")[0] == (body := joint.child.partition(".")[0]):
                yield FaultError(f"holds {body} to itself", "joint", name, "child")
            elif joint.measured_across and body in self.scene.body:
                marker = self.scene.body[body].marker.get(joint.child.partition(".")[2])
                if marker is not None and marker.is_turned:
                    mend = "turn the joint instead, by its rotate or axes"
                    yield FaultError(
                        f"has axes of its own, which a {joint.type} joint can't take; {mend}", "joint", name, "child"
                    )

    def _check_drives(self) -> Iterator[FaultError]:
        for name, drive in self.scene.drive.items():
            yield from self._check_tables(name, drive)
            for key, value in drive:
                if isinstance(value, LoadOverTime) and value.state is not None:
                    own = (*(() if isinstance(drive, MarkerLoad) else OWN), *self.scene.controller)
                    at = ("drive", name, key)
                    yield from self._check_state(value, value.formula or "", own, (*at, "formula"), (*at, "variables"))
            if isinstance(drive, MarkerLoad):
                yield from self._check_marker(drive.marker, "drive", name, "marker")
                continue
            fitting = _joints_along(*drive.joint_units)
            faults = [*self._check_joint(drive.joint, fitting, f"a {drive.type}", "drive", name, "joint")]
            yield from faults
            if not faults and isinstance(drive, MotionDrive):
                yield from self._check_motion(name, drive)

    def _check_tables(self, name: str, drive: Drive) -> Iterator[FaultError]:
        for key, value in drive:
            if isinstance(value, TimeFunction) and self.scene.simulation_table is not None:
                try:
                    value.check_duration(self.scene.simulation_table.duration)
                except FaultError as fault:
                    yield FaultError(str(fault), "drive", name, key, *fault.path)

    def _check_controllers(self) -> Iterator[FaultError]:
        """Controllers name those before them alone."""
        known: list[str] = []
        for name, controller in self.scene.controller.items():
            for table, tables in (("body", self.scene.body), ("joint", self.scene.joint)):
                if name in tables:
                    yield FaultError(f"a {table} has this name; formulas need another one", "controller", name)
            if isinstance(controller, Controller):
                for key, text in controller.formulas.items():
                    at = ("controller", name)
                    yield from self._check_state(controller, text, known, (*at, key), (*at, "variables"))
            known.append(name)

    def _check_state(
        self,
        table: FormulaVariables,
        text: str,
        known: Sequence[str],
        of_formula: tuple[str, ...],
        of_variables: tuple[str, ...],
    ) -> Iterator[FaultError]:
        """Names in a formula of the motion exist: variables, controllers, and parts of the motion."""
        for name in table.parse(text).names:
            if table.find_constant(name) is not None or table.find_derivative(name) is not None or name in known:
                continue
            at = (*of_variables, name) if name in table.variables else of_formula
            measured = table.find_measured(name)
            if measured is None:
                parts = ("joint.angle", "joint.rate", "body.marker.x", "body.marker.vx")
                names = ", ".join([*known, *table.variables, *parts])
                later = " before it" if name in self.scene.controller else ""
                mend = f"beside t, pi and functions it may name {names}, and keys of its variables"
                column = 1 + text.find(name)
                yield FaultError(f"at column {column}: there is no {name!r}{later}; {mend}", *at)
            elif measured.axis < 0:
                yield from self._check_joint(measured.place, _SINGLE, "a formula", *at)
            else:
                yield from self._check_marker(measured.place, *at)
                if measured.place.partition(".")[0] in self.scene.pieces:
                    yield FaultError(f"is of a body in pieces, where {name} can't be measured; pieces = 1 works", *at)

    def _check_couplers(self) -> Iterator[FaultError]:
        for name, coupler in self.scene.coupler.items():
            for key, unit in coupler.ends:
                fitting = _joints_along("m") if unit == "m" else kinds_that(lambda kind: kind.is_hinge)
                yield from self._check_joint(getattr(coupler, key), fitting, f"a {coupler.type}", "coupler", name, key)
            if len({getattr(coupler, key) for key, _ in coupler.ends}) == 1:
                yield FaultError("couples a joint with itself", "coupler", name, coupler.ends[1][0])

    def _check_elements(self) -> Iterator[FaultError]:
        for table, elements in self.scene.elements.items():
            for name, element in elements.items():
                for number, place in enumerate(element.between):
                    yield from self._check_place(place, table, name, "between", number)
                first, second = element.between
                if first == second or first.partition(".")[0] == second.partition(".")[0] == "ground":
                    yield FaultError("must be two places that can move against each other", table, name, "between")

    def _check_contacts(self) -> Iterator[FaultError]:
        for name, contact in self.scene.contact.items():
            for number, place in enumerate(contact.between):
                body = self.scene.body.get(place.partition(".")[0])
                if isinstance(body, Undeformable):
                    yield from check_surface(place, [*body.surface], contact, "contact", name, "between", number)
                else:
                    yield from self._check_place(place, "contact", name, "between", number)
        yield from check_faces(self.scene.contact, self.scene.flexible)
        yield from check_bodies(self.scene.contact, self.scene.pieces, self.scene.flexible, self.scene.of_triangles)
        if self.scene.contact and self.scene.sampled:
            fault = f"can't be in a scene with a sampled controller, {self.scene.sampled[0]}"
            yield FaultError(fault, "contact", next(iter(self.scene.contact)))

    def _check_motion(self, name: str, drive: MotionDrive) -> Iterator[FaultError]:
        """A prescribed motion leaves its joint no coordinate: nothing else may act along it."""
        joint, drives = self.scene.joint[drive.joint], self.scene.drive
        alike = (other for other, d in drives.items() if isinstance(d, MotionDrive) and d.joint == drive.joint)
        if next(alike) != name:  # the first one says that others have no effect
            return
        wanted = joint.position_key
        other = "angle" if wanted == "position" else "position"
        if getattr(drive, other) is not None:
            yield FaultError(f"belongs to another joint; this one moves by its {wanted}", "drive", name, other)
            return
        if getattr(drive, wanted) is None:
            yield FaultError(f"is missing: a {joint.type} joint moves by its {wanted}", "drive", name, wanted)
        for other_name, also in self.scene.drive.items():
            if other_name != name and getattr(also, "joint", None) == drive.joint:
                yield FaultError(f"has no effect: '{name}' prescribes the joint's motion", "drive", other_name, "joint")
        for key in (wanted, "rate", "spring", "damper", "stop", "friction"):
            if getattr(joint, key):
                yield FaultError(f"has no effect: '{name}' prescribes the joint's motion", "joint", drive.joint, key)
        if self.scene.simulation_table is not None and drive.joint in self.scene.simulation_table.fast:
            number = self.scene.simulation_table.fast.index(drive.joint)
            yield FaultError(f"has no coordinate: '{name}' prescribes its motion", "simulation", "fast", number)

    def _check_simulation(self) -> Iterator[FaultError]:
        if self.scene.simulation_table is None:
            return
        yield from self._check_marker(self.scene.simulation_table.tip, "simulation", "tip")
        if self.scene.simulation_table.start == "equilibrium":
            for name, joint in self.scene.joint.items():
                for key in RATE_KEYS:
                    if np.any(getattr(joint, key, 0.0)):
                        fault = "has no effect: simulation.start is 'equilibrium', at rest"
                        yield FaultError(fault, "joint", name, key)
        remembering = [name for name, one in self.scene.controller.items() if one.has_states]
        starts = ("undeformed",) if self.scene.sampled else ("undeformed", "periodic")
        if remembering and self.scene.simulation_table.start not in starts:
            fault = f"holds no controller with a memory, such as {remembering[0]}; {starts[-1]!r} works"
            yield FaultError(fault, "simulation", "start")
        if self.scene.contact:
            yield from check_contact_runs(self.scene)
        yield from check_runs(self.scene, self.scene.simulation_table.run)
        for number, name in enumerate(self.scene.simulation_table.fast):
            yield from self._check_joint(name, _SINGLE, "the fast list", "simulation", "fast", number)

    def _check_outputs(self) -> Iterator[FaultError]:
        for number, output in enumerate(self.scene.output):
            for key, check in (("marker", self._check_marker), ("element", self._check_element)):
                if (name := getattr(output, key, None)) is not None:
                    yield from check(name, "output", number, key)
            if isinstance(output, ContactPressure) and output.contact not in self.scene.contact:
                known = self.scene.contact
                yield UnknownNameError("contact", output.contact, known, "the contacts", "output", number, "contact")
            elif isinstance(output, ContactPressure):
                yield from check_wear_picture(output, self.scene.contact[output.contact], self.scene.flexible, number)
            if isinstance(output, Chart):
                yield from self._check_chart(output, "output", number)
            elif isinstance(output, Quantities):
                yield from self._check_quantities(output, "output", number)
            elif isinstance(output, BodyPicture | MechanismView | Export):
                yield from self._check_picture(output, "output", number)
        yield from self._check_files()

    def _check_chart(self, chart: Chart, *path: str | int) -> Iterator[FaultError]:
        if chart.body is not None and chart.body not in self.scene.flexible:
            yield UnknownNameError(
                "flexible body", chart.body, self.scene.flexible, "the flexible bodies", *path, "body"
            )
        if chart.quantity == "modal_coordinates" and not self.scene.flexible:
            yield FaultError("needs a flexible body; this scene has none", *path, "quantity")
        if chart.quantity in CONTACT_QUANTITIES and not self.scene.contact:
            yield FaultError("needs a contact; this scene has none", *path, "quantity")
        if chart.joint is None:
            single = [name for name, joint in self.scene.joint.items() if joint.type in _SINGLE]
            if chart.quantity in JOINT_QUANTITIES and len(single) != 1:
                known = f"; the revolute and prismatic joints: {', '.join(single) or 'none'}"
                yield FaultError(f"is missing: the name of the joint whose motion is drawn{known}", *path, "joint")
            return
        faults = [*self._check_joint(chart.joint, _SINGLE, "joint_position", *path, "joint")]
        yield from faults
        if not faults and chart.unit is not None:
            try:
                unit = self.scene.joint[chart.joint].kind.unit
                unit_ratio(f"{unit}/s" if chart.quantity == "joint_rate" else unit, chart.unit)
            except ValueError as error:
                yield FaultError(str(error), *path, "unit")

    def _check_quantities(self, output: Quantities, *path: str | int) -> Iterator[FaultError]:
        """Names of a history or a table exist, and what it takes by default isn't empty."""
        for number, name in enumerate(output.joints):
            if name not in self.scene.joint:
                yield UnknownNameError("joint", name, self.scene.joint, "the joints", *path, "joints", number)
            elif name in self.scene.closing and "joint_reaction" not in output.quantities:
                yield FaultError("closes a loop, so it has a reaction, but no coordinate", *path, "joints", number)
        for key, check in (("markers", self._check_marker), ("elements", self._check_element)):
            for number, name in enumerate(getattr(output, key)):
                yield from check(name, *path, key, number)
        meshed = {name: body for name, body in self.scene.flexible.items() if body.shape != "matrices"}
        for number, name in enumerate(output.nodes):
            if (body := name.partition(".")[0]) not in meshed:
                yield UnknownNameError("body with stress", body, meshed, "those with a mesh", *path, "nodes", number)
        if "element_stress" in output.quantities and not any(body.element for body in meshed.values()):
            yield FaultError("element_stress needs a named element, [body.NAME.element]", *path, "quantities")
        for name, text in output.formulas.items():
            unknown = self.find_unknown_parts(FormulaVariables(), text)
            yield from (FaultError(str(each), *path, "formulas", name) for each in unknown)

    def _check_picture(self, picture: BodyPicture | MechanismView | Export, *path: str | int) -> Iterator[FaultError]:
        flexible = self.scene.flexible
        of_body_alone = isinstance(picture, Export) and (
            picture.file.endswith(".nc") or picture.format not in (None, *MECHANISM_FORMATS)
        )
        divided = [*self.scene.pieces]
        if of_body_alone and (divided if picture.body is None else picture.body in divided):
            name = picture.body or divided[0]
            yield FaultError(
                f"holds bodies in one piece, and {name} is in several; pieces = 1 exports it", *path, "file"
            )
        if picture.body is None:  # of the whole mechanism
            if isinstance(picture, StressPicture) and not any(body.may_have_stress for body in flexible.values()):
                yield FaultError(
                    "needs a flexible body with a mesh or matrices.stress; this scene has none", *path, "type"
                )
            return
        if picture.body not in self.scene.body:
            yield UnknownNameError("body", picture.body, self.scene.body, "the bodies", *path, "body")
        elif picture.body not in flexible:
            names = suggest_name(picture.body, flexible, "the flexible bodies")
            yield FaultError(f"is rigid, without modes or stress; {names}", *path, "body")
        elif flexible[picture.body].shape in ("matrices", "reduced") and not of_body_alone:
            if isinstance(picture, StressPicture | Film) and flexible[picture.body].may_have_stress:
                return
            if flexible[picture.body].shape == "matrices":
                mend = "is given by its matrices: without elements there is no stress but that of matrices.stress"
                yield FaultError(mend, *path, "body")
                return
            yield FaultError("is reduced: it has no mesh, and no pictures of it or of its modes", *path, "body")

    def _check_files(self) -> Iterator[FaultError]:
        """No output may write over another's file; some file systems don't distinguish upper from lower case."""
        taken: list[tuple[str, str]] = []
        for number, output in enumerate(self.scene.output):
            file = output.file.casefold()
            pattern = re.escape(file).replace(r"\{mode\}", r"(\d+|\{mode\})")
            if any(re.fullmatch(pattern, other) or re.fullmatch(its, file) for other, its in taken):
                yield FaultError("another output has this file; rename it", "output", number, "file")
            taken.append((file, pattern))

    def _check_tree(self) -> Iterator[FaultError]:
        """Every body hangs on one joint, and through it on the ground."""
        parents: dict[str, str] = {}
        closing = self.scene.closing
        for name, joint in self.scene.joint.items():
            child = joint.child.partition(".")[0]
            if name in closing:
                yield from self._check_closing(name, joint)
                continue
            for key in joint.closing_keys:
                if getattr(joint, key) is not None:
                    yield FaultError("has no effect: the joint carries its child, along axis", "joint", name, key)
            parents[child] = joint.parent.partition(".")[0]
            if joint.kind.is_free and child in self.scene.flexible and self.scene.flexible[child].support:
                yield FaultError("holds nothing that a support could hold on to; take a fixed joint", "joint", name)
        for name in self.scene.body:
            if name in parents:
                if leads_round(name, parents):
                    yield FaultError("its joints lead round in a circle; one must lead to ground", "body", name)
            elif joint_name := self.scene.turned_round.get(name):
                joint = self.scene.joint[joint_name]
                mend = f"hangs on nothing: parent = {joint.child!r} and child = {joint.parent!r} work"
                yield FaultError(mend, "joint", joint_name, "child")
            elif self.scene.simulation_table is not None:
                yield FaultError(f"hangs on no joint; give it one with child = '{name}.…'", "body", name)
            elif name in self.scene.flexible and self.scene.flexible[name].modes.boundary == "joint":
                yield FaultError("hangs on no joint to be held at", "body", name, "modes", "boundary")

    def _check_closing(self, name: str, joint: Joint) -> Iterator[FaultError]:
        """A joint that closes a loop holds two places together, and has no coordinate of its own."""
        if not isinstance(joint, CarryingJoint):
            return
        if joint.cannot_close:
            yield FaultError(joint.cannot_close, "joint", name, "type")
        mend = f"closes a loop, so it has no coordinate for this; {_mend_to_carry(joint)}"
        yield from (FaultError(mend, "joint", name, key) for key in joint.of_coordinates)

    def _check_joint(self, name: str, fitting: tuple[str, ...], user: str, *path: str | int) -> Iterator[FaultError]:
        if name not in self.scene.joint:
            yield UnknownNameError("joint", name, self.scene.joint, "the joints", *path)
        elif name in self.scene.closing:
            if name not in self.scene.turned_round.values():  # of which `_check_tree` tells the cause
                mend = _mend_to_carry(self.scene.joint[name])
                yield FaultError(f"closes a loop, so it has no coordinate that {user} could take; {mend}", *path)
        elif self.scene.joint[name].type not in fitting:
            wanted = " or ".join([", ".join(fitting[:-1]), fitting[-1]] if len(fitting) > 1 else fitting)
            yield FaultError(f"is a {self.scene.joint[name].type} joint; {user} needs a {wanted} one", *path)

    def _check_place(self, place: str, *path: str | int) -> Iterator[FaultError]:
        """Check a marker of a body, or a place on the ground."""
        if place.partition(".")[0] != "ground":
            yield from self._check_marker(place, *path)
        elif place != "ground" and place not in (known := [f"ground.{name}" for name in self.scene.ground]):
            yield UnknownNameError("place", place, known, "the places on the ground", *path)

    def _check_marker(self, place: str, *path: str | int) -> Iterator[FaultError]:
        body = place.partition(".")[0]
        if body not in self.scene.body:
            yield UnknownNameError("body", body, self.scene.body, "the bodies", *path)
            return
        markers = [f"{body}.{marker}" for marker in self.scene.body[body].marker]
        if place not in markers:
            yield UnknownNameError("marker", place, markers, "the markers", *path)

    def _check_element(self, place: str, *path: str | int) -> Iterator[FaultError]:
        elements = [f"{name}.{element}" for name, body in self.scene.flexible.items() for element in body.element]
        if place not in elements:
            yield UnknownNameError("element", place, elements, "the named elements", *path)


def _mend_to_carry(joint: Joint) -> str:
    """Return how a joint that closes a loop carries a body, and another closes the loop."""
    carried, turn = joint.child, ""
    if carried == "ground" or carried.startswith("ground."):
        carried, turn = joint.parent, f" with parent = {joint.child!r} and child = {joint.parent!r}"
    return f"write it{turn} before the other joint that carries {carried.partition('.')[0]}, which closes the loop then"


def _joints_along(*units: str) -> tuple[str, ...]:
    """Return the kinds of joints whose one coordinate is in one of these units."""
    return kinds_that(lambda kind: kind.unit in units)
