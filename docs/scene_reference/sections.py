"""Sections of the page about the scene file in their order, and the texts between its tables."""

from typing import NamedTuple

from fmd.scene.bar import Bar, BarMesh
from fmd.scene.beams import BeamMesh, Box, ISection, Profile, Rectangle, Shaft, ShaftSegment
from fmd.scene.bodies import FaceLink, MassOnLink, Solid, TiedFace
from fmd.scene.constraints import Gear, Rack, Slides
from fmd.scene.contacts import Contact
from fmd.scene.controllers import ExternalValue, FmuController, LagController, PidController
from fmd.scene.curves import ForceByElongation, TimeFunction
from fmd.scene.fit import FitTable, MeasuredFile
from fmd.scene.force_elements import (
    AngleStop,
    Bearing,
    BearingTable,
    Bushing,
    LengthStop,
    Spring,
)
from fmd.scene.gear_teeth import GearTeethContact
from fmd.scene.gears import GearMesh, GearTeethMesh, SpurGear
from fmd.scene.histories import ExtremesTable, History, Quantities
from fmd.scene.imported_bodies import (
    CadFile,
    CadPart,
    Imported,
    MatrixFiles,
    MatrixPart,
    MeshedPart,
    MeshFile,
    Substance,
)
from fmd.scene.joints.any_joint import JOINTS
from fmd.scene.joints.joint import CarryingJoint, OneAngleJoint, TwoAngleJoint
from fmd.scene.layers import LaminaTable, Layer, PlyStrength
from fmd.scene.loads import ForceDrive, MotionDrive, PointForce, PointTorque, PulseDrive, TorqueDrive
from fmd.scene.modes import ModeSettings, RayleighDamping, ReducedModes
from fmd.scene.orientation import AxisDirections, Orientation
from fmd.scene.outputs import Chart, Export, FrequencyResponseChart, Orbit
from fmd.scene.pictures import (
    BodyPicture,
    Film,
    MechanismPicture,
    MechanismView,
    MeshPicture,
    ModePictures,
    ModeSheet,
    PictureSettings,
    StressPicture,
)
from fmd.scene.places import GroundPlace, MarkerPlace, NamedElement, Support
from fmd.scene.propeller import Propeller, PropellerMesh
from fmd.scene.reading import SceneTable
from fmd.scene.reduced_bodies import BodyFile, FileNode, ReducedPart
from fmd.scene.rigid_bodies import (
    BallSurface,
    BoreSurface,
    BoxSurface,
    ElasticSurface,
    FileSurface,
    PinSurface,
    PointMarker,
    PointMass,
    RigidBody,
    Rod,
)
from fmd.scene.runs import RUNS
from fmd.scene.scene import PublishedResults, Scene
from fmd.scene.shells import Plate, ShellMesh, Tube
from fmd.scene.simulation import Simulation
from fmd.scene.state_loads import FormulaVariable, LoadOverTime
from fmd.scene.stress_outputs import ContactPressure, Envelope, Fatigue, MeanStress, Plies, SnCurve, SurfaceField
from fmd.scene.visuals import BoxVisual, CylinderVisual, FileVisual, RodVisual, VisualSettings

INTRODUCTION = """\
<!-- Written by `python -m docs.scene_reference > docs/scene.md` from docstrings and comments in pipeline/fmd/scene. -->

# The scene file

A scene is a TOML file: the bodies, how they are joined, what drives them, how they are integrated over time, and the
charts, pictures and files that are wanted. `fmd new my-part.toml` writes a commented one to start from;
[your part](your-part.md) goes through one step by step.

- **Quantities** are text with a unit: `"340 mm"`, `"8000 rpm"`, `"2.7 g/cm^3"`. Any unit will do that converts to the
  SI unit of the key. A bare number is refused, and so is a unit of another dimension. Values without a dimension, like
  `nu`, are plain numbers.
- **Tolerances** may follow a number: `mass = "0.4 kg ± 2 %"`, `depth = "12 mm +/- 0.1 mm"`, `nu = "0.33 ± 3 %"`: the
  half-width of the interval that holds 95 % of all pieces. A run takes the number alone; `fmd sensitivities` tells what
  the tolerances make of its [results](fitting.md).
- **Names** of bodies, markers, elements, joints and drives are yours: a letter and up to 39 letters, digits, `_` or
  `-`. A marker is named with its body, `"beam.tip"`. `"ground"` stands still.
- **On the command line** `--set` replaces values of the file: `--set body.beam.length=300mm`,
  `--set simulation.run.1.substeps=7`. Items of a list count from 0.
- **Variants** of another scene start with `base = "./mine.toml"`, its path from this file, or with a ready scene's
  name, `base = "propeller"`. Tables of the first level that the file doesn't hold, such as `body` or `output`, come
  from that scene. `set = ["body.beam.length=300mm"]` beside `title` replaces single values of it, as `--set` does.
  The ready scenes are {ready}.
- **Mistakes** are refused, unknown keys too, all in one message, with a line for each: the file and the line in it, the
  key, the value and what would work.
- **Editors** complete and check a scene by the JSON schema `scene.schema.json`, which `fmd new` writes beside the scene
  and names in its first line, `#:schema ./scene.schema.json`; Taplo and VS Code's Even Better TOML read it. For other
  scenes `python -m fmd.scene.schema > scene.schema.json` writes it. It knows all keys, words and units, but not the
  names that you give.
- **In Python** each table is a class of the same keys, whose quantities may also be plain numbers in SI units:
  `Rod(mass=2.0, length="1 m", marker={{}})`.

The tables below give each key's values, its SI unit and its default. A key with a dash may be left out.
"""

_BODIES = """\
A body is a table `[body.NAME]`, and its key `shape` says of which kind it is. Bars, propellers and bodies from files
are flexible; rods, point masses and rigid bodies are not.

With `like = "NAME"` a body has all keys of another body, and those that it gives itself in place of the other's; its
own tables, such as `mesh` and `marker`, are joined with the other's key by key. Bodies of one part share its mesh, its
matrices and its modes, which are computed once.

```toml
[body.blade-2]
like = "blade-1"
modes = { damping = 0.01 }
```
"""
_SURFACES = """
What of a rigid body may touch something in a [contact](#contacts): `type` is `"ball"`, `"box"`, `"pin"` or `"bore"`.
"""

_VISUALS = """\
A shape is a table `[[body.NAME.visual]]`, and its key `type` says of which kind it is. It shows the body in
pictures and films, and has no effect on the motion.
"""
_JOINTS = """\
A joint is a table `[joint.NAME]`, and its key `type` says of which kind it is. Bodies form a tree: each is the child of
one joint, and through its joints hangs on the ground. A joint holds a marker of the child on a marker of the parent, or
on a place on the ground. At angle and displacement zero a body's frame is parallel to that of the body that carries it,
or to the axes of its place on the ground, unless [markers or joints have axes of their own](#axes). A joint whose child
another joint carries already, or whose child is a place on the ground, closes a loop: it has no coordinate of its own,
and the joints of the loop start where it closes.
"""
_AXES = """\
A marker's axes are those of its body's frame, a place's those of space, unless `rotate` or `axes` turns them. A joint
brings the axes of the child's marker onto those of the parent's at angle and displacement zero, turned by the joint's
own `rotate` or `axes`; its axis is in these axes. A body so gets its first pose where it is joined: by `rotate` at a
fixed joint, by `angle` at a hinge, by `position` and `rotate` at a free joint. Following loads and bushings are in the
axes of their markers.

```toml
[joint.blade-2]
type = "revolute"
parent = "hub.centre"
child = "blade-2.root"
rotate = ["0 deg", "0 deg", "180 deg"]
axis = [0, 0, 1]
```
"""
_COUPLERS = """\
A coupler is a table `[coupler.NAME]`, and its key `type` says of which kind it is. It ties the coordinates of two
joints that carry bodies to each other.
"""
_DRIVES = """\
A drive is a table `[drive.NAME]`, and its key `type` says of which kind it is. Several drives may act on one joint,
unless one of them prescribes its motion.
"""
_CONTROLLERS = """\
A controller is a table `[controller.NAME]`, and its key `type` says of which kind it is. Formulas of drives, and of
controllers after it, name its output; [Drives and control](control.md#controllers) tells how they are computed.
"""
_ELEMENTS = """\
Springs, bushings and bearings are tables `[spring.NAME]`, `[bushing.NAME]` and `[bearing.NAME]`. Each acts between two
places, markers of bodies or places on the ground, and takes nothing away from how they move.
"""
_CONTACT = """\
A contact is a table `[contact.NAME]`; [Contact and friction](contact.md) tells how it is computed.
"""
_GEARS = """\
Two spur gears in motion are a table `[gear_mesh.NAME]`; [Spur gears in mesh](gears.md) tells how the force is computed.
"""
_ELONGATION = """\
A formula holds `x`, the elongation in metres, in place of `t`, and else what formulas of the time hold.
"""
_RUNS = """\
A run is a table `[[simulation.run]]`, and its key `integrator` says by which method. The others are compared with the
first run, and pictures show the first.
"""
_OUTPUTS = """\
An output is a table `[[output]]`, and its key `type` says of which kind it is. Its `file` is a name without a folder;
it lies in the folder of results, and no two outputs have the same.
"""
_FORMULAS = """\
A formula may hold `t`, `pi`, numbers, `+ - * / **`, the functions `sin`, `cos`, `tan`, `exp`, `log`, `sqrt`, `tanh`,
`abs`, `min` and `max`, and choices such as `12*t if t < 0.5 else 6`, whose condition compares `t` with a constant.

A table may also lie in a CSV file beside the scene, with a column of times and one for each quantity:

```toml
[drive.shoulder]
type = "motion"
joint = "shoulder"
angle = { file = "motion.csv", time = "t", column = "q1", unit = "deg" }
```

A column is named as in the file's first row, or by its number from 1. Lines that begin with `#` are comments, and in a
file with semicolons or tabs numbers may have a decimal comma.
"""
_BY_MOTION = """\
So a torque may be a controller's, a spring's with any law, or a gas force by a crank's angle. It is differentiated and
compiled as all other forces are: implicit methods see its stiffness, and steps keep to it. [Drives and
control](control.md) has examples.
"""


class Section(NamedTuple):
    """One section of the page.

    Attributes
    ----------
    heading : str
        Heading with its marks, e.g. ``"### Bar"``.
    table : type, optional
        The scene's table that it describes.
    text : str
        Text that stands before the description, or after it if there is one.
    """

    heading: str
    table: type[SceneTable] | None = None
    text: str = ""

    @property
    def title(self) -> str:
        """Heading without its marks."""
        return self.heading.lstrip("# ")

    @property
    def anchor(self) -> str:
        """FaceLink to the section."""
        return "#" + self.title.lower().replace(" ", "-")


SECTIONS = (
    Section("## The whole file", Scene),
    Section("## Bodies", None, _BODIES),
    Section("### Every flexible body", Solid),
    Section("### Bar", Bar),
    Section("### Mesh of a bar", BarMesh),
    Section("### Plate", Plate),
    Section("### Tube", Tube),
    Section("### Mesh of a plate or tube", ShellMesh),
    Section("### Shaft", Shaft),
    Section("### Segment of a shaft", ShaftSegment),
    Section("### Profile", Profile),
    Section("### Rectangular section", Rectangle),
    Section("### Box section", Box),
    Section("### I section", ISection),
    Section("### Mesh of a shaft or profile", BeamMesh),
    Section("### Propeller", Propeller),
    Section("### Mesh of a propeller", PropellerMesh),
    Section("### Spur gear", SpurGear),
    Section("### Mesh of a spur gear", GearTeethMesh),
    Section("### Every body from a file", Imported),
    Section("### Material of a part", Substance),
    Section("### Layer", Layer),
    Section("### Material of a ply", LaminaTable),
    Section("### Strength of a ply", PlyStrength),
    Section("### Body from a mesh file", MeshedPart),
    Section("### Mesh file", MeshFile),
    Section("### Body from a CAD file", CadPart),
    Section("### CAD file", CadFile),
    Section("### Body from matrices", MatrixPart),
    Section("### Files of matrices", MatrixFiles),
    Section("### Reduced body from a file", ReducedPart),
    Section("### File of a reduced body", BodyFile),
    Section("### Damping of a reduced body", ReducedModes),
    Section("### Markers of a reduced body", FileNode),
    Section("### Modes", ModeSettings),
    Section("### Rayleigh damping", RayleighDamping),
    Section("### Markers of a flexible body", MarkerPlace),
    Section("### Supports", Support),
    Section("### Links", FaceLink),
    Section("### Masses on links", MassOnLink),
    Section("### Tied faces", TiedFace),
    Section("### Named elements", NamedElement),
    Section("### Rod", Rod),
    Section("### Point mass", PointMass),
    Section("### Rigid body", RigidBody),
    Section("### Markers of a rigid body", PointMarker),
    Section("### Surfaces of rigid bodies", ElasticSurface, _SURFACES),
    Section("### Ball that touches", BallSurface),
    Section("### Box that touches", BoxSurface),
    Section("### Pin that touches", PinSurface),
    Section("### Bore that touches", BoreSurface),
    Section("### File of triangles that touches", FileSurface),
    Section("### Shapes of rigid bodies in pictures", VisualSettings, _VISUALS),
    Section("### Box in pictures", BoxVisual),
    Section("### Cylinder in pictures", CylinderVisual),
    Section("### Rod in pictures", RodVisual),
    Section("### Shape from a file in pictures", FileVisual),
    Section("## Places on the ground", GroundPlace),
    Section("## Axes", Orientation, _AXES),
    Section("### Directions of axes", AxisDirections),
    Section("## Joints", None, _JOINTS),
    Section("### Every joint that carries a body", CarryingJoint),
    Section("### Every joint with one angle", OneAngleJoint),
    Section("### Every joint with two angles", TwoAngleJoint),
    *(Section(f"### {joint.title}", joint) for joint in JOINTS),
    Section("## Couplers", None, _COUPLERS),
    Section("### Gear", Gear),
    Section("### Slides that move together", Slides),
    Section("### Rack and pinion", Rack),
    Section("## Drives", None, _DRIVES),
    Section("### Torque pulse", PulseDrive),
    Section("### Torque", TorqueDrive),
    Section("### Force", ForceDrive),
    Section("### Prescribed motion", MotionDrive),
    Section("### Point force", PointForce),
    Section("### Point torque", PointTorque),
    Section("### Quantities over time", TimeFunction, _FORMULAS),
    Section("### Loads by the motion", LoadOverTime, _BY_MOTION),
    Section("### Variables of a formula", FormulaVariable),
    Section("## Controllers", None, _CONTROLLERS),
    Section("### PID", PidController),
    Section("### Lag", LagController),
    Section("### Value from outside", ExternalValue),
    Section("### FMU", FmuController),
    Section("## Force elements", None, _ELEMENTS),
    Section("### Spring", Spring),
    Section("### Force by elongation", ForceByElongation, _ELONGATION),
    Section("### Bushing", Bushing),
    Section("### Bearing", Bearing),
    Section("### Table of a bearing", BearingTable),
    Section("### Stop of a slide or a spring", LengthStop),
    Section("### Stop of a hinge", AngleStop),
    Section("## Contact", Contact, _CONTACT),
    Section("## Gears in mesh", GearTeethContact, _GEARS),
    Section("## Simulation", Simulation),
    Section("## Runs", None, _RUNS),
    *(Section(f"### {run.title}", run) for run in RUNS),
    Section("## Published results", PublishedResults),
    Section("## Fit", FitTable),
    Section("### Experiment of a fit", MeasuredFile),
    Section("## Outputs", None, _OUTPUTS),
    Section("### Chart", Chart),
    Section("### Every picture and film", PictureSettings),
    Section("### Every picture of a body", BodyPicture),
    Section("### Orbit", Orbit),
    Section("### Frequency response", FrequencyResponseChart),
    Section("### Picture of the mesh", MeshPicture),
    Section("### Pictures of modes", ModePictures),
    Section("### Sheet of modes", ModeSheet),
    Section("### Every picture of the mechanism", MechanismView),
    Section("### Picture of the stress", StressPicture),
    Section("### Picture of the mechanism", MechanismPicture),
    Section("### Film", Film),
    Section("### Every envelope and fatigue", SurfaceField),
    Section("### Envelope of the stress", Envelope),
    Section("### Fatigue", Fatigue),
    Section("### Plies", Plies),
    Section("### S-N curve", SnCurve),
    Section("### Mean stress", MeanStress),
    Section("### Pressure of a contact", ContactPressure),
    Section("### Spur gears in mesh", GearMesh),
    Section("### Every history and table", Quantities),
    Section("### History", History),
    Section("### Table of extremes", ExtremesTable),
    Section("### File for other tools", Export),
)
