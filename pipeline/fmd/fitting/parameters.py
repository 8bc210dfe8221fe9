"""Numbers of a scene that results are differentiated by: found by their keys, and changed."""

from collections.abc import Mapping, Sequence
from typing import Any, get_args

from pydantic import BaseModel

from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.units import QuantityReader, si_unit
from fmd.scene.bodies import Deformable
from fmd.scene.curves import FormulaOrTable
from fmd.scene.reading import suggest_name
from fmd.scene.scene import Scene

_TABLES = ("body", "ground", "joint", "drive", "coupler", "spring", "bushing", "bearing", "contact")


@dataclass(frozen=True)
class Parameter:
    """A number of a scene."""

    key: str  # dotted as for ``--set``, e.g. ``joint.elbow.spring``
    value: float  # in the SI unit; 1 for a formula or a table, of which the parameter is a factor
    unit: str = ""  # SI unit; empty for a plain number and for a factor
    is_factor: bool = False  # true if it is a factor of a formula or of a table
    # Measured channel whose clock it shifts, ``time`` for those of all; empty for a number of the scene.
    clock: str = ""

    @property
    def meaning(self) -> str:
        """Text after the value: a unit, or that it is a factor."""
        return self.unit or ("times the scene's" if self.is_factor else "")


def find_parameter(scene: Scene, key: str, origin: str = "--to") -> Parameter:
    """Find a number of a scene by its key, dotted as for ``--set``; messages name the option or file that has it.

    A formula or a table of a load counts as one number, its factor 1.

    Raises
    ------
    InputError
        There is no such key, or it is no number that results change smoothly with, or it is 0.
    """
    parts = key.split(".")
    if parts[0] not in _TABLES and tuple(parts[:2]) != ("simulation", "gravity"):
        known = f"{', '.join(f'{table}.…' for table in _TABLES)}, simulation.gravity.…"
        raise InputError(origin, key, None, f"is no number that results change with smoothly; those are in {known}")
    node: Any = scene
    unit = ""
    for depth, part in enumerate(parts):
        names = _list_keys(node)
        if part not in names:
            place = ".".join(parts[:depth]) or "the scene"
            mend = f"there is no {part!r} in {place}; {suggest_name(part, names, 'the keys there')}"
            raise InputError(origin, key, None, mend)
        unit, node = _unit_of(node, part) or unit, _get(node, part)
    if isinstance(node, FormulaOrTable):
        constant = getattr(node, "constant", None)
        if constant is None:
            return Parameter(key, 1.0, "", is_factor=True)
        unit, node = si_unit(node.kind), constant
    if not isinstance(node, float):
        numbers = [name for name in _list_keys(node) if isinstance(_get(node, name), float | FormulaOrTable)]
        what = suggest_name("", numbers, "the numbers there") if numbers else "a length or a stiffness would be one"
        raise InputError(origin, key, None, f"is no number that results change with smoothly; {what}")
    if not node:
        raise InputError(origin, key, 0.0, "is 0, of which there is no per cent; give it a value in the scene")
    return Parameter(key, node, unit)


def change_parameters(scene: Scene, values: Mapping[Parameter, float]) -> Scene:
    """Return the scene with other values of some of its numbers, in SI units; shifts of clocks are none of it.

    Bodies whose dimensions change keep the elements of the given scene.
    """
    first = scene
    for parameter, value in values.items():
        if parameter.clock:
            continue
        scene = _replace(scene, parameter.key.split("."), value)
    bodies = {name: body for name, body in scene.body.items() if isinstance(body, Deformable)}
    kept = {name: body.with_elements_of(first.body[name]) for name, body in bodies.items()}  # type: ignore[arg-type]
    return scene.model_copy(update={"body": {**scene.body, **kept}})


def list_settings(scene: Scene, parameter: Parameter, value: float) -> list[str]:
    """Return what sets a number to a value [SI], as for ``--set``: of a formula or a table its own key."""
    if not parameter.is_factor:
        return [f"{parameter.key}={value!r} {parameter.unit}".rstrip()]
    node: Any = scene
    for part in parameter.key.split("."):
        node = _get(node, part)
    scaled = _scale(node, value)
    if scaled.formula is not None:
        return [f"{parameter.key}.formula={scaled.formula}"]
    return [f"{parameter.key}.values={[*(scaled.values or ())]!r}"]


def _list_keys(node: Any) -> Sequence[str]:
    """Return the keys of a table, or the numbers of a list's items, as text."""
    if isinstance(node, BaseModel):
        return [field.alias or name for name, field in type(node).model_fields.items()]
    if isinstance(node, Mapping):
        return [*node]
    return [str(number) for number in range(len(node))] if isinstance(node, tuple) else []


def _field_name(node: BaseModel, key: str) -> str:
    return next(name for name, field in type(node).model_fields.items() if key in (name, field.alias))


def _get(node: Any, key: str) -> Any:
    if isinstance(node, BaseModel):
        return getattr(node, _field_name(node, key))
    return node[key] if isinstance(node, Mapping) else node[int(key)]


def _unit_of(node: Any, key: str) -> str:
    """Return the SI unit of a table's key; empty if the key is no quantity, or an item of a list."""
    if not isinstance(node, BaseModel):
        return ""
    field = type(node).model_fields[_field_name(node, key)]
    readers = [*_readers(field.annotation), *(found for item in field.metadata for found in _readers(item))]
    return si_unit(readers[0].kind) if readers else ""


def _readers(annotation: Any) -> list[QuantityReader]:
    """List the readers of quantities within an annotation."""
    if isinstance(annotation, QuantityReader):
        return [annotation]
    return [found for inner in get_args(annotation) for found in _readers(inner)]


def _replace(node: Any, parts: Sequence[str], value: float) -> Any:
    """Return a table, or a list, with another number at a place in it."""
    if not parts:
        return _scale(node, value) if isinstance(node, FormulaOrTable) else value
    key, *rest = parts
    inner = _replace(_get(node, key), rest, value)
    if isinstance(node, BaseModel):
        return node.model_copy(update={_field_name(node, key): inner})
    if isinstance(node, Mapping):
        return {**node, key: inner}
    return (*node[: int(key)], inner, *node[int(key) + 1 :])


def _scale(node: FormulaOrTable, value: float) -> FormulaOrTable:
    """Return a constant with another value, a formula or a table times a factor."""
    if getattr(node, "constant", None) is not None:
        return node.model_copy(update={"constant": value})
    if node.formula is not None:
        return node.model_copy(update={"formula": f"{value!r}*({node.formula})"})
    assert node.values is not None
    return node.model_copy(update={"values": tuple(value * x for x in node.values)})
