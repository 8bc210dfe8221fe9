"""The page on the scene file, written from the tables' types and docstrings.

``python -m pipeline.scene.reference > docs/scene.md`` writes it anew.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from textwrap import fill
from typing import Any, NamedTuple, get_args

from pydantic.fields import FieldInfo

from pipeline.scene.bodies import Bar, BarMesh, ModeSettings, Solid
from pipeline.scene.imported_bodies import (
    CadFile,
    CadPart,
    Imported,
    MatrixFiles,
    MatrixPart,
    MeshedPart,
    MeshFile,
    Substance,
)
from pipeline.scene.joints import Fixed, Free, Prismatic, Revolute, Spherical
from pipeline.scene.loads import ForceDrive, MotionDrive, PointForce, PointTorque, PulseDrive, TorqueDrive
from pipeline.scene.outputs import (
    CHART_QUANTITIES,
    BodyPicture,
    Chart,
    Export,
    Film,
    MeshPicture,
    ModePictures,
    ModeSheet,
    StressPicture,
)
from pipeline.scene.places import MarkerPlace, NamedElement, Support
from pipeline.scene.propeller import Propeller, PropellerMesh
from pipeline.scene.reading import SceneTable, list_ready_scenes
from pipeline.scene.rigid_bodies import PointMarker, PointMass, RigidBody, Rod
from pipeline.scene.scene import PublishedResults, Scene
from pipeline.scene.simulation import (
    AutoRun,
    CentralDifferenceRun,
    ExponentialRun,
    GeneralizedAlphaRun,
    ReversibleSubCyclingRun,
    RosenbrockRun,
    RungeKuttaRun,
    ScipyRun,
    Simulation,
    SubCyclingRun,
)
from pipeline.scene.time_functions import TimeFunction
from pipeline.scene.value_words import describe_values, to_markdown

_INTRODUCTION = """\
<!-- Written by `python -m pipeline.scene.reference > docs/scene.md` from the docstrings in pipeline/scene. -->

# The scene file

A scene is a TOML file: the bodies, how they are joined, what drives them, how they are integrated over time, and the
charts, pictures and files that are wanted. `fmd new my-part.toml` writes a commented one to start from;
[your part](your-part.md) goes through one step by step.

- **Quantities** are text with a unit: `"340 mm"`, `"8000 rpm"`, `"2.7 g/cm^3"`. Any unit will do that converts to the
  SI unit of the key. A bare number is refused, and so is a unit of another dimension. Values without a dimension, like
  `nu`, are plain numbers.
- **Names** of bodies, markers, elements, joints and drives are yours: a letter and up to 39 letters, digits, `_` or
  `-`. A marker is named with its body, `"beam.tip"`. `"ground"` stands still.
- **On the command line** `--set` replaces values of the file: `--set body.beam.length=300mm`,
  `--set simulation.run.1.substeps=7`. Items of a list count from 0.
- **Variants** of a ready scene start with `base = "propeller"`; tables that the file doesn't hold come from that scene.
  The ready scenes are {ready}.
- **Mistakes** are refused, unknown keys too, by one message with the file, the key, the value and what would work.

The tables below give each key's values, its SI unit and its default. A key with a dash may be left out.
"""

_QUANTITIES = "#quantities-of-a-chart"
_BODIES = """\
A body is a table `[body.NAME]`, and its key `shape` says of which kind it is. Bars, propellers and bodies from files
are flexible; rods, point masses and rigid bodies are not.
"""
_JOINTS = """\
A joint is a table `[joint.NAME]`, and its key `type` says of which kind it is. Bodies form a tree: each is the child of
one joint, and through its joints hangs on the ground. A joint holds a marker of the child on a marker of the parent. At
angle and displacement zero the frames of all bodies are parallel.
"""
_DRIVES = """\
A drive is a table `[drive.NAME]`, and its key `type` says of which kind it is. Several drives may act on one joint,
unless one of them prescribes its motion.
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
        """Link to the section."""
        return "#" + self.title.lower().replace(" ", "-")


SECTIONS = (
    Section("## The whole file", Scene),
    Section("## Bodies", None, _BODIES),
    Section("### Every flexible body", Solid),
    Section("### Bar", Bar),
    Section("### Mesh of a bar", BarMesh),
    Section("### Propeller", Propeller),
    Section("### Mesh of a propeller", PropellerMesh),
    Section("### Every body from a file", Imported),
    Section("### Material of a part", Substance),
    Section("### Body from a mesh file", MeshedPart),
    Section("### Mesh file", MeshFile),
    Section("### Body from a CAD file", CadPart),
    Section("### CAD file", CadFile),
    Section("### Body from matrices", MatrixPart),
    Section("### Files of matrices", MatrixFiles),
    Section("### Modes", ModeSettings),
    Section("### Markers of a flexible body", MarkerPlace),
    Section("### Supports", Support),
    Section("### Named elements", NamedElement),
    Section("### Rod", Rod),
    Section("### Point mass", PointMass),
    Section("### Rigid body", RigidBody),
    Section("### Markers of a rigid body", PointMarker),
    Section("## Joints", None, _JOINTS),
    Section("### Revolute joint", Revolute),
    Section("### Prismatic joint", Prismatic),
    Section("### Fixed joint", Fixed),
    Section("### Spherical joint", Spherical),
    Section("### Free joint", Free),
    Section("## Drives", None, _DRIVES),
    Section("### Torque pulse", PulseDrive),
    Section("### Torque", TorqueDrive),
    Section("### Force", ForceDrive),
    Section("### Prescribed motion", MotionDrive),
    Section("### Point force", PointForce),
    Section("### Point torque", PointTorque),
    Section("### Quantities over time", TimeFunction, _FORMULAS),
    Section("## Simulation", Simulation),
    Section("## Runs", None, _RUNS),
    Section("### Central differences", CentralDifferenceRun),
    Section("### Sub-cycling", SubCyclingRun),
    Section("### Reversible sub-cycling", ReversibleSubCyclingRun),
    Section("### Exponential", ExponentialRun),
    Section("### Exponential Rosenbrock", RosenbrockRun),
    Section("### Runge-Kutta", RungeKuttaRun),
    Section("### Generalised alpha", GeneralizedAlphaRun),
    Section("### Methods of SciPy", ScipyRun),
    Section("### Automatic", AutoRun),
    Section("## Published results", PublishedResults),
    Section("## Outputs", None, _OUTPUTS),
    Section("### Chart", Chart),
    Section("### Every picture and film", BodyPicture),
    Section("### Picture of the mesh", MeshPicture),
    Section("### Pictures of modes", ModePictures),
    Section("### Sheet of modes", ModeSheet),
    Section("### Picture of the stress", StressPicture),
    Section("### Film", Film),
    Section("### File for other tools", Export),
)
# Meanings of the key that says a table's kind, by the part of the page.
_KINDS = {
    "Bodies": "Kind of body.",
    "Joints": "Kind of joint.",
    "Drives": "Kind of drive.",
    "Runs": "Method of integration.",
    "Outputs": "Kind of output.",
}
_NO_KEYS = {(TimeFunction, "constant")}  # a constant is written as the quantity itself
_KNOWN_BY_FILES = {(table, "shape") for table in (MeshedPart, CadPart, MatrixPart)}


def write_page() -> str:
    """Return the page as Markdown.

    Raises
    ------
    ValueError
        A key or a chart's quantity has no meaning.
    """
    anchors: dict[type, str] = {section.table: section.anchor for section in SECTIONS if section.table}
    # Where a table may be of several kinds, a link leads to the part of the page about all of them.
    anchors |= {Bar: "#bodies", Revolute: "#joints", PulseDrive: "#drives", CentralDifferenceRun: "#runs"}
    anchors |= {Chart: "#outputs"}
    ready = ", ".join(f"`{name}`" for name in list_ready_scenes())
    blocks, kind = [_INTRODUCTION.format(ready=ready).strip()], ""
    for section in SECTIONS:
        blocks.append(section.heading)
        if section.heading.startswith("## "):
            kind = _KINDS.get(section.title, "")
        if section.table is not None:
            blocks += _describe_table(section.table, kind, anchors)
        if section.text:
            blocks.append(section.text.strip())
        if section.table is Chart:
            blocks += _describe_quantities()
    return "\n\n".join(blocks) + "\n"


def _describe_table(table: type[SceneTable], kind: str, anchors: dict[type, str]) -> Iterator[str]:
    """Write a table's description, its keys, links to keys that it shares with others, and an example."""
    paragraphs, example = _read_docstring(table)
    yield from (fill(paragraph, 120, break_long_words=False, break_on_hyphens=False) for paragraph in paragraphs)
    rows = [_write_row(table, name, field, kind, anchors) for name, field in list_keys(table)]
    yield "\n".join(["| key | value | unit | default | meaning |", "|---|---|---|---|---|", *rows])
    shared = [section for base in table.__mro__[1:] for section in SECTIONS if section.table is base]
    if shared:
        links = " and ".join(f"[{section.title.lower()}]({section.anchor})" for section in shared)
        yield f"Further keys are those of {links}."
    if example:
        yield f"```toml\n{example}\n```"


def list_keys(table: type[SceneTable]) -> list[tuple[str, FieldInfo]]:
    """List the fields that a table adds to those of its base class, except those that aren't keys of a scene."""
    inherited = {name for base in table.__mro__[1:] for name in getattr(base, "model_fields", {})}
    own = [(name, field) for name, field in table.model_fields.items() if name not in inherited]
    return [(name, field) for name, field in own if (table, name) not in _NO_KEYS]


def _write_row(table: type[SceneTable], name: str, field: FieldInfo, kind: str, anchors: dict[type, str]) -> str:
    words = describe_values(field.annotation, field.metadata, anchors)
    value = f"[quantity]({_QUANTITIES})" if (table, name) == (Chart, "quantity") else words.text
    meaning = read_meanings(table).get(name) or (kind if name in ("shape", "type", "integrator") else "")
    if not meaning:
        raise ValueError(f"{table.__name__} doesn't say in its docstring what {name} means")
    meaning = meaning.replace(f" [{words.unit.replace('^2', '²').replace('^3', '³')}]", "")
    default = "–" if (table, name) in _KNOWN_BY_FILES else _write_default(field, words.unit)
    cells = [f"`{field.alias or name}`", value, words.unit, default, meaning]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _write_default(field: FieldInfo, unit: str) -> str:
    if field.is_required():
        return "required"
    if field.default_factory is not None or field.default in (None, (), ""):
        return "–"
    return f"`{_write_value(field.default, unit)}`"


def _write_value(value: Any, unit: str) -> str:
    """Write a value as TOML."""
    if isinstance(value, tuple):
        return f"[{', '.join(_write_value(item, unit) for item in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    return f'"{value:g} {unit}"' if unit else f"{value:g}" if isinstance(value, float) else str(value)


def _describe_quantities() -> Iterator[str]:
    """Write the quantities of charts with their meanings."""
    names = get_args(Chart.model_fields["quantity"].annotation)
    unknown = set(names) ^ set(CHART_QUANTITIES)
    if unknown:
        raise ValueError(f"a chart's quantities and their meanings differ: {', '.join(sorted(unknown))}")
    yield "### Quantities of a chart"
    rows = [f"| `{name}` | {meaning} |" for name, meaning in CHART_QUANTITIES.items()]
    yield "\n".join(["| quantity | meaning |", "|---|---|", *rows])


def read_meanings(table: type[SceneTable]) -> dict[str, str]:
    """Read the meaning of each key off the section on parameters in a table's docstring, as Markdown."""
    parameters = _split_docstring(table).get("Parameters", "")
    meanings: dict[str, str] = {}
    for names, text in re.findall(r"^(\S[^\n]*?) : [^\n]*\n((?:[ ]+[^\n]*\n?|\n)+)", parameters, re.MULTILINE):
        meanings |= dict.fromkeys(names.split(", "), to_markdown(text))
    return meanings


def _read_docstring(table: type[SceneTable]) -> tuple[list[str], str]:
    """Return the paragraphs at a docstring's beginning and the TOML of its example, empty if it has none."""
    sections = _split_docstring(table)
    paragraphs = [to_markdown(paragraph) for paragraph in sections[""].strip().split("\n\n")]
    example = inspect.cleandoc(sections.get("Examples", "").strip().removeprefix("::").lstrip("\n"))
    return paragraphs, example


def _split_docstring(table: type[SceneTable]) -> dict[str, str]:
    """Return the sections of a numpydoc docstring by heading; the beginning has none."""
    parts = re.split(r"^(\w+)\n-+\n", inspect.getdoc(table) or "", flags=re.MULTILINE)
    return {"": parts[0]} | dict(zip(parts[1::2], parts[2::2], strict=True))


if __name__ == "__main__":
    sys.stdout.write(write_page())
