"""Quantities over time in a scene file: histories as files, and tables of their extremes."""

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from fmd.scene.pictures import Component
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.state_loads import FormulaVariables
from fmd.scene.values import ElementName, FileCheck, JointName, MarkerName, Name, OneOf, Words

# Meanings of the quantities that a history can hold.
HISTORY_QUANTITIES = {
    "joint_position": "position, coordinates or orientation of each of `joints`",
    "joint_rate": "rates of each of `joints`",
    "joint_reaction": "force and moment of each of `joints` on its child, about the joint's place there; they hold all "
    "that the joint transmits, its spring, damper, friction and drive included; on the parent they are the opposite",
    "marker_position": "position of each of `markers` in space",
    "marker_displacement": "displacement of each of `markers`: from where it was at the start, or with `axes = "
    '"body"` by deformation in its body\'s frame',
    "marker_velocity": "velocity of each of `markers` in space",
    "marker_acceleration": "acceleration of each of `markers` in space, as an accelerometer has it but for gravity",
    "element_stress": "each of `components` of the stress in the middle of each of `elements`",
    "node_stress": "each of `components` of the stress at each of `nodes`",
    "gear_mesh": "force and transmission error of each two gears in mesh, along the line of action",
    "energy": "kinetic and potential energy of all bodies",
}

HistoryQuantity = Annotated[str, OneOf((*HISTORY_QUANTITIES,))]


def _check_node(name: str) -> str:
    if not re.fullmatch(r"[^.]{1,40}\.[0-9]{1,9}", name):
        raise ValueError("must be a body and the number of a node, e.g. 'beam.112'")
    return name


NodeName = Annotated[str, AfterValidator(_check_node), Words('``"body.number"``')]
_BELONGS = {"joints": "joint_", "markers": "marker_", "elements": "element_stress", "nodes": "node_stress"}


class Quantities(SceneTable):
    """A choice of quantities over time."""

    file: str  # File that is written.
    # Quantities, required without ``formulas``; the table of quantities of a history explains each.
    quantities: tuple[HistoryQuantity, ...] = ()
    # Formulas of the motion by the names that they get, such as what a sensor measures or a controller puts out, in SI
    # units.
    formulas: dict[Name, str] = Field(default_factory=dict)
    joints: tuple[JointName, ...] = ()  # Joints whose quantities are meant; all by default.
    markers: tuple[MarkerName, ...] = ()  # Markers whose quantities are meant; all by default.
    elements: tuple[ElementName, ...] = ()  # Named elements whose stress is meant; all by default.
    # Nodes whose stress is meant, by their bodies and numbers, as tables of the worst nodes give them.
    nodes: tuple[NodeName, ...] = ()
    # Components of stress; principal stresses are numbered from the largest.
    components: Annotated[tuple[Component, ...], Field(min_length=1)] = ("von Mises",)
    # Axes of vectors at joints and markers: those of ``space``, or those of the marker's or the child's ``body``.
    axes: Literal["space", "body"] = "space"

    def _check(self) -> None:
        if not (self.quantities or self.formulas):
            raise FaultError('is missing: what is wanted, e.g. ["joint_reaction"], or formulas', "quantities")
        for name, text in self.formulas.items():
            try:
                FormulaVariables().parse(text)
            except ValueError as error:
                raise FaultError(str(error), "formulas", name) from None
        for key, start in _BELONGS.items():
            if getattr(self, key) and not any(quantity.startswith(start) for quantity in self.quantities):
                names = [quantity for quantity in HISTORY_QUANTITIES if quantity.startswith(start)]
                raise FaultError(f"has no effect: it belongs to {', '.join(names)}", key)
        if "node_stress" in self.quantities and not self.nodes:
            raise FaultError("is missing: the nodes whose stress is wanted, e.g. ['beam.112']", "nodes")
        if "components" in self.model_fields_set and not {"element_stress", "node_stress"} & {*self.quantities}:
            raise FaultError("has no effect: it belongs to element_stress, node_stress", "components")
        for key in ("quantities", "joints", "markers", "elements", "nodes", "components"):
            names = getattr(self, key)
            if len(set(names)) < len(names):
                raise FaultError("holds a name twice", key)


class History(Quantities):
    """A file of quantities over time, in SI units.

    A ``.csv`` has a column for each number, named with its unit, over the first run; a ``.nc`` has a variable for each
    quantity, over all runs; a ``.png``, ``.pdf`` or ``.svg`` a chart for each quantity over the first run.

    Example:

        [[output]]
        type = "history"
        file = "loads.csv"
        quantities = ["joint_reaction", "marker_acceleration"]
        joints = ["shoulder"]
        markers = ["forearm.wrist"]
        formulas = { reach = "sqrt(forearm.wrist.x**2 + forearm.wrist.y**2)" }
    """

    type: Literal["history"]
    file: Annotated[str, FileCheck((".csv", ".nc", ".png", ".pdf", ".svg"))]
    title: str = ""  # Text above the charts.


class ExtremesTable(Quantities):
    """A table of the smallest and largest values of quantities over the first run, and when; in SI units.

    Vectors have a row for each component and one for their size. The table stands in the summary, too, under
    ``tables``.

    Example:

        [[output]]
        type = "table"
        file = "extremes.csv"
        quantities = ["joint_reaction", "joint_position", "energy"]
    """

    type: Literal["table"]
    file: Annotated[str, FileCheck((".csv",))]
