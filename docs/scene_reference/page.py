"""Writer of the page about the scene file: keys, values, defaults and meanings, table by table."""

from collections.abc import Iterator
from textwrap import fill
from typing import Any

from pydantic.fields import FieldInfo

from docs.scene_reference.sections import INTRODUCTION, SECTIONS
from docs.scene_reference.values import describe_values
from fmd.scene.bar import Bar
from fmd.scene.constraints import Gear
from fmd.scene.controllers import PidController
from fmd.scene.curves import TimeFunction
from fmd.scene.histories import HISTORY_QUANTITIES, Quantities
from fmd.scene.joints.any_joint import JOINTS
from fmd.scene.loads import PulseDrive
from fmd.scene.outputs import CHART_QUANTITIES, Chart
from fmd.scene.reading import SceneTable
from fmd.scene.rigid_bodies import SURFACES
from fmd.scene.runs import RUNS
from fmd.scene.schema import KNOWN_BY_FILES, is_kind, is_known_by_scene, read_docstring, read_meanings
from fmd.scene.toml_files import list_ready_scenes

# Meanings of the key that says a table's kind, by the part of the page.
_KINDS = {
    "Bodies": "Kind of body.",
    "Joints": "Kind of joint.",
    "Couplers": "Kind of coupler.",
    "Drives": "Kind of drive.",
    "Controllers": "Kind of controller.",
    "Runs": "Method of integration.",
    "Outputs": "Kind of output.",
    "Surfaces of rigid bodies": "Kind of surface.",
    "Shapes of rigid bodies in pictures": "Kind of shape.",
}
_NO_KEYS = {(TimeFunction, "constant")}  # a constant is written as the quantity itself
_LINKED: dict[tuple[type[SceneTable], str], str] = {
    (Chart, "quantity"): "[quantity](#quantities-of-a-chart)",
    (Quantities, "quantities"): "list of [quantities](#quantities-of-a-history)",
}


def write_page() -> str:
    """Return the page as Markdown.

    Raises
    ------
    ValueError
        A key has no meaning.
    """
    anchors: dict[type, str] = {section.table: section.anchor for section in SECTIONS if section.table}
    # Where a table may be of several kinds, a link leads to the part of the page about all of them.
    anchors |= {Bar: "#bodies", PulseDrive: "#drives", PidController: "#controllers", RUNS[0]: "#runs"}
    anchors |= dict.fromkeys(SURFACES, "#surfaces-of-rigid-bodies")
    anchors |= {Chart: "#outputs", Gear: "#couplers", JOINTS[0]: "#joints"}
    ready = ", ".join(f"`{name}`" for name in list_ready_scenes())
    blocks, kind = [INTRODUCTION.format(ready=ready).strip()], ""
    for section in SECTIONS:
        blocks.append(section.heading)
        kind = _KINDS.get(section.title, "" if section.heading.startswith("## ") else kind)
        if section.table is not None:
            blocks += describe_table(section.table, kind, anchors)
        if section.text:
            blocks.append(section.text.strip())
        if section.table is Chart:
            blocks += _describe_quantities("chart", CHART_QUANTITIES)
        if section.table is Quantities:
            blocks += _describe_quantities("history", HISTORY_QUANTITIES)
    return "\n\n".join(blocks) + "\n"


def describe_table(table: type[SceneTable], kind: str, anchors: dict[type, str]) -> Iterator[str]:
    """Write a table's description, its keys, links to keys that it shares with others, and an example."""
    paragraphs, example = read_docstring(table)
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
    """List the fields that a table adds to those of bases with a section of their own, but for those that are no keys.

    A field that it defines anew is its own, too.
    """
    bases = [base for base in table.__mro__[1:] if any(section.table is base for section in SECTIONS)]
    inherited = {name for base in bases for name in base.model_fields} - {*table.__annotations__}
    # The kind comes first, then the table's own keys.
    fields = sorted(table.model_fields.items(), key=lambda x: (not is_kind(*x), x[0] not in table.__annotations__))
    own = [(name, field) for name, field in fields if name not in inherited]
    return [(name, field) for name, field in own if (table, name) not in _NO_KEYS]


def _write_row(table: type[SceneTable], name: str, field: FieldInfo, kind: str, anchors: dict[type, str]) -> str:
    words = describe_values(field.annotation, field.metadata, anchors)
    value = _LINKED.get((table, name), words.text)
    meaning = read_meanings(table).get(name) or (kind if name in ("shape", "type", "integrator") else "")
    if not meaning:
        raise ValueError(f"{table.__name__} doesn't say in a comment what {name} means")
    meaning = meaning.replace(f" [{words.unit.replace('^2', '²').replace('^3', '³')}]", "")
    default = _write_default(field, words.unit)
    if is_kind(name, field):
        default = "–" if table in KNOWN_BY_FILES else "required"
    default = "–" if is_known_by_scene(table, name) else default
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


def _describe_quantities(output: str, meanings: dict[str, str]) -> Iterator[str]:
    """Write the quantities of charts or histories with their meanings."""
    yield f"### Quantities of a {output}"
    rows = [f"| `{name}` | {meaning} |" for name, meaning in meanings.items()]
    yield "\n".join(["| quantity | meaning |", "|---|---|", *rows])
