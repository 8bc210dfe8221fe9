"""Tables of a scene as classes, and the faults that are found in what they are made of."""

from __future__ import annotations

import difflib
import json
import math
import re
import reprlib
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, ValidationError, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, InitErrorDetails

from fmd.core.errors import InputError
from fmd.core.limits.shown import LONGEST_VALUE
from fmd.core.units import QuantityReader, example_of
from fmd.scene.toml_lines import KeyPath
from fmd.scene.values import TextCheck, Words

Place = tuple[str, int | None]
"""A file and a line in it, from 1; ``None`` where it has no lines."""

_PACKAGE = str(Path(__file__).parents[1])
# Where a value may be of several types pydantic puts the type into a fault's path.
_ALTERNATIVE = re.compile(r"(literal|function-\w+)\[|\[key\]$|(constrained-)?(str|int|float)$| ")


# Words of other programs and of everyday speech for names of a scene, in small letters without marks between them.
SYNONYMS = {
    "revolute": "hinge hinged pin pinned rotary rotational rotation",
    "prismatic": "slider slide sliding translational linear",
    "spherical": "ball balljoint ballsocket socket",
    "fixed": "weld welded rigid clamp clamped",
    "universal": "cardan hooke",
    "free": "floating sixdof",
    "bar": "beam box cuboid block",
    "rigid": "box cuboid block sphere ball cylinder mass lumped",
    "shaft": "cylinder",
    "point": "pointmass mass lumped",
    "E": "youngsmodulus youngmodulus young modulus elasticmodulus elasticity emodulus",
    "nu": "poisson poissonratio poissonsratio",
    "rho": "density",
    "damper": "damping dashpot viscous",
    "stiffness": "k springconstant springrate",
    "spring": "stiffness k springconstant springrate",
    "low": "lower min minimum lowerlimit",
    "high": "upper max maximum upperlimit",
    "lowest": "low lower min minimum lowerlimit",
    "highest": "high upper max maximum upperlimit",
    "proportional": "p kp gain",
    "integral": "i ki",
    "derivative": "d kd",
    "error": "reference setpoint target",
    "duration": "tend endtime stoptime finaltime totaltime",
    "step": "dt timestep h stepsize",
    "output_step": "dtout outputinterval sampletime",
    "times": "arguments",
    "time": "argument",
    "time_unit": "argumentunit",
    "integrator": "solver method scheme",
    "central-difference": "leapfrog verlet velocityverlet stormerverlet explicit",
    "runge-kutta": "rungekutta rk rk4 rk45 rk23 ode45 ode23 dopri dopri5 dop853",
    "generalized-alpha": "newmark newmarkbeta hht hhtalpha hilberhughestaylor chunghulbert bathe implicit",
    "Radau": "bdf ode15s ode23s ode23t sdirk dassl ida",
    "LSODA": "cvode vode lsode gear",
    "auto": "automatic adaptive default",
    "type": "kind",
    "body": "part parts link links bodies",
    "drive": "load loads force forces torque actuator motor",
    "output": "outputs result results",
    "marker": "point frame node",
    "parent": "from body1 base",
    "child": "to body2 follower",
}


class FaultError(ValueError):
    """A fault at keys below the table that is being checked; the message says what is wrong and what would work."""

    def __init__(self, message: str, *path: str | int) -> None:
        self.path = path
        super().__init__(message)


class UnknownNameError(FaultError):
    """A name that nothing in the scene has, with those that such things, e.g. of the kind ``"joint"``, have.

    ``words`` say what these are, e.g. ``"the joints"``; the path is that of `FaultError`.
    """

    def __init__(self, what: str, name: str, names: Iterable[str], words: str, *path: str | int) -> None:
        self.name = name
        super().__init__(f"no such {what}; {suggest_name(name, names, words)}", *path)


class Fault(NamedTuple):
    """A value of a scene that is wrong."""

    path: KeyPath  # the keys that lead to it
    mend: str  # what is wrong and what would work

    def look_up(self, tables: Mapping[str, Any]) -> object:
        """Return the value; ``None`` if it is missing or too long for a message."""
        value: Any = tables
        try:
            for key in self.path:
                value = value[key]
            return value if len(repr(value)) <= LONGEST_VALUE else None
        except (LookupError, TypeError, ValueError, RecursionError):  # repr refuses very large integers
            return None


class SceneTable(BaseModel):
    """A table of a scene, immutable once made; an unknown key in it is a fault, never ignored.

    In Python its quantities are numbers in SI units or text with units, ``Rod(mass=2.0, length="1 m", marker={})``, and
    ``InputError`` tells all that is wrong with it.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    if not TYPE_CHECKING:  # editors know the keys by the fields

        def __init__(self, /, **values: Any) -> None:
            fields = type(self).model_fields
            values = {fields[key].alias or key if key in fields else key: value for key, value in values.items()}
            try:
                super().__init__(**values)
            except ValidationError as error:
                place, name = find_caller(), type(self).__name__
                faults = type(self)._list_faults(error, values, {})
                if name != "Scene":
                    order = [(), *((key,) for key in values)]
                    faults.sort(key=lambda fault: order.index(fault.path[:1]) if fault.path[:1] in order else 0)
                    faults, values = [Fault((name, *path), mend) for path, mend in faults], {name: values}
                raise join_errors(faults, values, lambda _: place) from None

        __init__.__pydantic_base_init__ = True  # by which pydantic doesn't call it for tables within tables

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Let a class say its kind by itself, which a file has to give: ``Rod()`` has the shape ``"rod"``."""
        for field in cls.model_fields.values():
            words = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
            if field.is_required() and len(words) == 1:
                field.default = words[0]

    @classmethod
    def _list_faults(cls, error: ValidationError, values: Mapping[str, Any], context: Mapping[str, Any]) -> list[Fault]:
        """List all that is wrong with the values that a table was to be made of."""
        return list_faults(error)

    @model_validator(mode="wrap")
    @classmethod
    def _find_all_faults(cls, table: Any, check: ModelWrapValidatorHandler[Any]) -> Any:
        """Find the faults of all keys at once, those of unknown ones, too."""
        try:
            return check({key: _to_plain(value) for key, value in table.items()} if isinstance(table, dict) else table)
        except ValidationError as error:
            details = error.errors(include_url=False)
            unknown = [str(detail["loc"][0]) for detail in details if detail["type"] == "extra_forbidden"]
            fields_of = {field.alias or name: field for name, field in cls.model_fields.items()}
            missing = {
                f["loc"]: example
                for f in details
                if f["type"] == "missing" and (example := _example_of(fields_of.get(str(f["loc"][0]))))
            }
            if not (unknown or missing):
                raise
            fields = sorted(cls.model_fields.items(), key=lambda item: item[0] not in cls.__annotations__)
            known = [field.alias or name for name, field in fields]  # its own first
            meant = [(near[0],) for key in unknown if (near := _near(key, known))]
            faults = [_detail(UnknownNameError("key", key, known, "the keys here", key)) for key in unknown]
            faults += [
                InitErrorDetails(type=f["type"], loc=f["loc"], input=f["input"], ctx=f.get("ctx", {}))
                for f in details
                if f["type"] != "extra_forbidden" and not (f["type"] == "missing" and f["loc"] in {*meant, *missing})
            ]
            faults += [_detail(FaultError(f"is missing{mend}", *at)) for at, mend in missing.items() if at not in meant]
            raise ValidationError.from_exception_data(cls.__name__, faults) from None

    @model_validator(mode="after")
    def _check_all(self) -> Self:
        """Let each class of the table, bases first, check values that are right by themselves by its ``_check``."""
        for kind in reversed(type(self).__mro__):
            if check := vars(kind).get("_check"):
                check(self)
        return self


def example_of_key(table: type[SceneTable], key: str) -> str:
    """Return what would work for a key of a table that is missing, for a message."""
    return _example_of(table.model_fields[key])


def _example_of(field: FieldInfo | None) -> str:
    """Return what would work for a key that is missing, for a message; empty if only its table's page tells."""
    for each in field.metadata if field else ():
        if isinstance(each, QuantityReader):
            return f", e.g. {example_of(each.kind)!r}"
        if isinstance(each, Words | TextCheck):
            return f": {each.description.replace('``', '')}"
    if field and field.examples:
        return f", e.g. {json.dumps(field.examples[0], separators=(', ', ' = '))}"  # in TOML
    table = field.annotation if field else None
    if isinstance(table, type) and issubclass(table, SceneTable):
        needed = [inner.alias or name for name, inner in table.model_fields.items() if inner.is_required()]
        return f": a table with {', '.join(needed)}" if needed else ""
    return ""


def raise_faults(faults: Iterable[FaultError]) -> None:
    """Raise several faults of a table at once; none, if there are none."""
    details = [_detail(fault) for fault in faults]
    if details:
        raise ValidationError.from_exception_data("table", details)


def _detail(fault: FaultError) -> InitErrorDetails:
    return InitErrorDetails(type="value_error", loc=(), input=None, ctx={"error": fault})


def _to_plain(value: Any) -> Any:
    """Return NumPy's arrays and numbers as lists and numbers of Python."""
    if isinstance(value, list | tuple):
        return [_to_plain(item) for item in value]
    return value.tolist() if hasattr(value, "tolist") else value


def list_faults(error: ValidationError) -> list[Fault]:
    """List what is wrong with a table, each place once, in the order of its keys."""
    found: dict[KeyPath, ErrorDetails] = {}
    for detail in error.errors(include_url=False):
        path = _find_path(detail)
        # A quantity that may also be a word has a fault for each; that of the quantity is the better message.
        if path not in found or found[path]["type"] == "literal_error":
            found[path] = detail
    deeper = {path[:length] for path in found for length in range(len(path))}
    # A list with an item at fault is neither too short without it nor, where it may also be a text, no text.
    follow = ("string_type", "too_short")
    return [Fault(path, _write_mend(f)) for path, f in found.items() if path not in deeper or f["type"] not in follow]


def kinds_as_meant(error: ValidationError, tables: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return tables in which misspelt kinds are what is likely meant, so that what is wrong beside them is found, too.

    ``None`` if no kind is misspelt, or it isn't clear what is meant.
    """
    found = None
    for detail in error.errors(include_url=False):
        if detail["type"] == "union_tag_invalid" and (near := _near_kind(detail)):
            *path, key = _find_path(detail)
            found = deepcopy(dict(tables)) if found is None else found
            table: Any = found
            for part in path:
                if not (isinstance(part, int) and isinstance(table, Mapping)):  # a list's only table without brackets
                    table = table[part]
            table[key] = near
    return found


def _near_kind(error: ErrorDetails) -> str | None:
    """Return the kind of table that is likely meant by one that there isn't; of several the one that its keys fit."""
    context = error.get("ctx", {})
    near = _near(str(context["tag"]), re.findall("'([^']*)'", context["expected_tags"]))
    key, given = context["discriminator"].strip("'"), {str(name) for name in error["input"]}
    return min(near, key=lambda kind: _misfits(SceneTable, key, kind, given), default=None)


def _misfits(table: type[SceneTable], key: str, kind: str, given: set[str]) -> float:
    """Return how many keys are too many or missing for a kind, a subclass of a table; infinite if there is none."""
    fields = {field.alias or name: field for name, field in table.model_fields.items()}
    if key in fields and get_args(fields[key].annotation) == (kind,):
        return len(given - fields.keys()) + sum(
            field.is_required() for name, field in fields.items() if name not in given
        )
    return min((_misfits(each, key, kind, given) for each in table.__subclasses__()), default=math.inf)


def join_errors(
    faults: Sequence[Fault], tables: Mapping[str, Any], find_place: Callable[[KeyPath], Place]
) -> InputError:
    """Make one error of all faults, one at least, in the order of the lines that they stand on.

    Messages have values of the tables as they were given, and the file and line of each path of keys.
    """
    placed = sorted(((*find_place(fault.path), fault) for fault in faults), key=lambda item: item[1] or 0)
    errors = [
        InputError(file, _join_path(fault.path), fault.look_up(tables), fault.mend, line)
        for file, line, fault in placed
    ]
    first = errors[0]
    return InputError(first.file, first.key, first.value, first.mend, first.line, errors[1:])


def _join_path(path: KeyPath) -> str:
    return ".".join(str(k) if re.fullmatch(r"[\w-]{1,60}", str(k)) else reprlib.repr(k) for k in path)


def _find_path(detail: ErrorDetails) -> KeyPath:
    """Return the keys that lead to a fault, without what pydantic adds to them."""
    path: KeyPath = ()
    for part in detail["loc"]:
        if len(path) < 2 or not _ALTERNATIVE.search(str(part)):
            path += (part,)
    fault = detail.get("ctx", {}).get("error")
    if isinstance(fault, FaultError):
        path += fault.path
    if detail["type"].startswith("union_tag"):
        path += (detail["ctx"]["discriminator"].strip("'"),)
    return path


def _write_mend(error: ErrorDetails) -> str:
    match error["type"]:
        case "value_error":
            return str(error["ctx"]["error"])
        case "missing" | "union_tag_not_found":
            return "is missing"
        case "union_tag_invalid":
            near = _near_kind(error)
            return f"must be one of {error['ctx']['expected_tags']}" + (f"; did you mean {near!r}?" if near else "")
        case "model_type" | "model_attributes_type" | "dict_type":
            given, meant = error["input"], error.get("ctx", {}).get("class_name")
            wrong = f" or a {meant}, not a {type(given).__name__}" if isinstance(given, BaseModel) and meant else ""
            return f"must be a table{wrong}"
        case "tuple_type":
            return "must be a list"
        case _:
            said = re.sub(r"^\w+ should", "must", error["msg"]).replace(" after validation", "")
            return said.replace("a valid string", "a text").replace("a valid integer", "a whole number")


def find_caller() -> Place:
    """Find the name of the file outside this package, and the line in it, that called into it."""
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame = frame.f_back
    file = Path(frame.f_code.co_filename)
    return file.name if file.is_file() else "input", frame.f_lineno


def suggest_name(given: str, names: Iterable[str], what: str) -> str:
    """Write the names that exist for a message, the likeliest meaning of ``given`` first.

    ``suggest_name("hup", ["hub"], "the joints")`` is ``"did you mean 'hub'? the joints: hub"``.
    """
    names = list(names)
    near = _near(given, names)
    meant = f"did you mean {near[0]!r}? " if near else ""
    return f"{meant}{what}: {', '.join(names) or 'none'}"


def _near(given: str, names: Iterable[str]) -> list[str]:
    """Return the name that is most likely meant, if any: one with the same meaning, or one that is written alike."""
    names, word = list(names), re.sub(r"[\W_]", "", given.lower())
    meant = [name for name in names if word in SYNONYMS.get(name, "").split()]
    return meant or difflib.get_close_matches(given, names, n=1)
