"""Outputs in a scene file: charts, pictures and films, and files for other tools."""

from collections.abc import Collection
from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Field, WithJsonSchema

from fmd.core.units import Frequency, NonNegative, NonNegativeTime, PositiveFrequency, Stress, unit_ratio
from fmd.scene.gears import GearMesh
from fmd.scene.histories import ExtremesTable, History
from fmd.scene.kinds import KindBy
from fmd.scene.pictures import (
    BodyPicture,
    Component,
    Film,
    MechanismPicture,
    MeshPicture,
    ModePictures,
    ModeSheet,
    StressPicture,
)
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.stress_outputs import ContactPressure, Envelope, Fatigue, Plies
from fmd.scene.values import BodyName, ElementName, FileCheck, JointName, MarkerName, OneOf, Text, Words

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
    "contact_force": "largest force of each contact since the output time before",
    "contact_pressure": "largest pressure of each contact since the output time before, of points that one is found at",
    "contact_slip": "longest way that a point of each contact has slipped while it was pressed",
    "contact_area": "largest area that each contact presses since the output time before",
    "com_position": "the former name of `centre_of_mass`",
    "joint_angle": "the former name of `joint_position`",
}


EXPORT_FORMATS: dict[str, tuple[str, ...]] = {
    "python": (".nc",),
    "sid": (".SID_FEM",),
    "exudyn": (".npz",),
    "mbdyn": (".fem",),
    "simscape": (".mat",),
    "openfast": (".dat",),
    "nastran": (".pch",),
    "full": (".mtx", ".npz", ".txt"),
    "load-cases": (".inp",),
    "fmu": (".fmu",),
}
"""Formats of other programs, and the suffixes of their files."""

MECHANISM_FORMATS = ("fmu",)
"""Those of them that hold the whole mechanism; the others hold one flexible body."""

BODY_FORMATS = {name: suffixes for name, suffixes in EXPORT_FORMATS.items() if name not in MECHANISM_FORMATS}
"""Formats of a flexible body, and the suffixes of their files."""

READ_FORMATS = BODY_FORMATS | {"nastran": (".pch", ".op4", ".op2"), "abaqus": (".mtx",)}
"""Formats of a flexible body that scenes may read, too, if `fmd.reduction.formats` has a reader."""

_SUFFIXES = (".msh", ".vtu", ".vtkhdf", ".nc")
_FORMAT_SUFFIXES = tuple(suffix for own in EXPORT_FORMATS.values() for suffix in own if suffix not in _SUFFIXES)

CONTACT_QUANTITIES = ("contact_force", "contact_pressure", "contact_slip", "contact_area")

JOINT_QUANTITIES = ("joint_position", "joint_rate", "joint_angle")


def _write_number(value: Any) -> Any:
    """Return a number as text, which a formula may be, too."""
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


Density = Annotated[
    Text,
    BeforeValidator(_write_number),
    Words("number, or text: a formula of f or a ``.csv`` file"),
    WithJsonSchema({"type": ["number", "string"]}),
]
ChartFile = Annotated[str, FileCheck((".png", ".pdf", ".svg"))]
PortName = Annotated[Text, Words('text, e.g. ``"plate.tip.z"``')]


class Chart(SceneTable):
    """A chart of one quantity over time with the curves of all runs.

    Example:

        [[output]]
        type = "chart"
        file = "shoulder.png"
        quantity = "joint_position"
        joint = "shoulder"
        unit = "deg"
    """

    type: Literal["chart"]
    file: ChartFile  # File of the chart.
    # Quantity that is drawn; the table of quantities below explains each.
    quantity: Annotated[str, OneOf((*CHART_QUANTITIES,))]
    # Revolute or prismatic joint whose position or rate is drawn; needed if there are several.
    joint: JointName | None = None
    body: BodyName | None = None  # Flexible body whose modal coordinates are drawn; that of the tip by default.
    marker: MarkerName | None = None  # Marker whose position in space is drawn.
    element: ElementName | None = None  # Named element whose stress is drawn.
    component: Component = "von Mises"  # Component of that stress; principal stresses are numbered from the largest.
    unit: Text | None = None  # Unit of the axis, e.g. ``"deg"`` or ``"mm/s"``; rad, m, s and MPa by default.
    title: str = ""  # Text above the chart; the quantity's name by default.
    band: tuple[Stress, Stress] | None = None  # Range of stress that is marked [Pa].
    band_title: str = ""  # Text for the band in the legend.

    def _check(self) -> None:
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
        if self.unit is not None and self.element is not None:
            try:
                unit_ratio("Pa", self.unit)
            except ValueError as error:
                raise FaultError(str(error), "unit") from None
        if self.band is not None and (self.element is None or not self.band[0] < self.band[1]):
            raise FaultError("must be two stresses, the smaller first, on a chart of 'element_stress'", "band")


class Orbit(SceneTable):
    """Path of a marker in a plane of space, drawn with equal scales or as a table.

    A ``.png``, ``.pdf`` or ``.svg`` has a curve for each run, with a dot where it begins; a ``.csv`` has time and place
    over the first run.

    Example:

        [[output]]
        type = "orbit"
        file = "orbit.png"
        marker = "rotor.disc"
        plane = "yz"
        start = "0.5 s"
    """

    type: Literal["orbit"]
    file: Annotated[str, FileCheck((".png", ".pdf", ".svg", ".csv"))]  # File of the chart or the table.
    marker: MarkerName  # Marker whose path is drawn.
    plane: Literal["xy", "xz", "yz", "yx", "zx", "zy"] = "xy"  # Axes of space across and upwards.
    start: NonNegativeTime = 0.0  # Time from which the path is drawn, to leave out a run-up [s].
    title: str = ""  # Text above the chart.


class FrequencyResponseChart(SceneTable):
    """Frequency response of the scene, linearised about a state: chart, table and NetCDF file.

    Example:

        [[output]]
        type = "frf"
        file = "frf.png"
        input = "plate.side.z"
        output = ["plate.tip.z", "plate.root.xx"]
        to = "2 kHz"
        psd = 0.1
    """

    type: Literal["frf"]
    # File of the chart; a table (``.csv``) and a NetCDF file (``.nc``) of the same name stand beside it.
    file: ChartFile
    # What acts: ``"body.marker.z"`` (a force), ``".rz"`` (a moment), ``"drive.NAME"``, ``"JOINT.torque"``,
    # ``"JOINT.force"`` or ``"ground.z"`` (an acceleration of the ground).
    input: PortName
    # What answers: ``"body.marker.z"``, also ``".velocity"`` or ``".acceleration"`` of it, ``"JOINT.position"``,
    # ``"body.element.xx"``.
    output: PortName | Annotated[tuple[PortName, ...], Field(min_length=1, max_length=20)]
    to: PositiveFrequency  # Highest frequency [Hz].
    # Lowest frequency [Hz]; a thousandth of the highest by default. In a scene its name is ``from``.
    from_: Annotated[Frequency, NonNegative] | None = Field(default=None, alias="from")
    # Number of evenly spaced frequencies; more are added about each resonance.
    points: Annotated[int, Field(strict=True, ge=2, le=100_000)] = 1000
    # State of linearisation: the scene's ``"start"``, its ``"equilibrium"``, a ``"steady"`` motion, or a time of the
    # first run in seconds.
    about: Text = "start"
    # One-sided power spectral density of a random input, in the input's SI unit squared per Hz: a number, a formula of
    # the frequency f in Hz, or a ``.csv`` file of frequencies and densities. With it, root mean squares of the outputs
    # are computed.
    psd: Density | None = None
    title: str = ""  # Text above the chart.

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return (self.output,) if isinstance(self.output, str) else self.output

    def _check(self) -> None:
        if self.from_ is not None and not self.from_ < self.to:
            raise FaultError(f"must be below the highest frequency, {self.to:g} Hz", "from")
        if self.file.startswith("motion."):
            raise FaultError("would write its table over the motion's file; 'frf.png' works", "file")


class Export(SceneTable):
    """A file for other tools; its suffix gives what it holds, unless ``format`` does.

    ``.msh`` and ``.vtu`` hold the mesh with its parts, ``.vtkhdf`` displacement and stress at several times for
    ParaView, ``.nc`` the reduced body: modes, mass, stiffness, inertia integrals and the stress of each mode.

    Example:

        [[output]]
        type = "export"
        file = "motion.vtkhdf"
        body = "propeller"
        frames = 41
    """

    type: Literal["export"]
    file: Annotated[str, FileCheck((*_SUFFIXES, *_FORMAT_SUFFIXES))]  # File that is written.
    # Format of another program, as of ``fmd export --to``.
    format: Annotated[str, OneOf((*EXPORT_FORMATS,))] | None = None
    body: BodyName | None = None  # Flexible body that it holds, where it holds one; the scene's only one by default.
    # Number of output times in a ``.vtkhdf`` file, spread over the duration.
    frames: Annotated[int, Field(strict=True, ge=2, le=2000)] = 21

    def _check(self) -> None:
        suffixes = _SUFFIXES if self.format is None else EXPORT_FORMATS[self.format]
        if not self.file.endswith(suffixes):
            what = "without a format" if self.format is None else f"of format {self.format!r}"
            raise FaultError(f"a file {what} ends in {' or '.join(suffixes)}", "file")
        if self.format in MECHANISM_FORMATS and self.body is not None:
            raise FaultError(f"belongs to other formats: {self.format!r} holds the whole mechanism", "body")
        if self.format not in MECHANISM_FORMATS and self.body is None:
            raise FaultError("is missing: the flexible body that the file holds", "body")


Output = Annotated[
    Chart
    | Orbit
    | FrequencyResponseChart
    | MeshPicture
    | ModePictures
    | ModeSheet
    | StressPicture
    | MechanismPicture
    | Film
    | Envelope
    | Fatigue
    | Plies
    | ContactPressure
    | GearMesh
    | History
    | ExtremesTable
    | Export,
    KindBy("type"),
]

OUTPUT_MODELS: dict[str, type[SceneTable]] = {
    get_args(model.model_fields["type"].annotation)[0]: model for model in get_args(get_args(Output)[0])
}
"""Tables of outputs by their types."""


def with_only_body(output: Any, bodies: Collection[str]) -> Any:
    """Return an output's unread table with a scene's only flexible body, if it holds one and names none."""
    if len(bodies) != 1 or not isinstance(output, dict) or "body" in output:
        return output
    kind = output.get("type")
    model = OUTPUT_MODELS.get(kind) if isinstance(kind, str) else None
    holds = model is not None and issubclass(model, BodyPicture)
    if model is Export and str(output.get("format")) not in MECHANISM_FORMATS:
        holds = True
    return output | {"body": next(iter(bodies))} if holds else output
