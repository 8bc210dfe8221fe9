"""JSON schema of the scene file, by which editors complete and check it: ``python -m fmd.scene.schema``.

It is written from the types of the tables, their docstrings and their fields' comments. It knows keys, words and units,
also of scenes that build on others, but not the names that a scene gives and what fits together; a run checks these,
too. Fields' comments stand beside them or above them.
"""

import ast
import inspect
import json
import re
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import takewhile
from typing import Any, get_args

from pydantic.fields import FieldInfo
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from fmd.core.limits.scene import LONGEST_SYMBOL
from fmd.core.units import example_of, list_units
from fmd.scene.imported_bodies import CadPart, MatrixPart, MeshedPart
from fmd.scene.pictures import BodyPicture
from fmd.scene.reading import SceneTable
from fmd.scene.reduced_bodies import ReducedPart
from fmd.scene.scene import Scene

KNOWN_BY_FILES = (MeshedPart, CadPart, MatrixPart, ReducedPart)
"""Bodies whose kind a scene may leave out, since the keys of their files say it."""

TITLE = "fmd scene"
"""Title of the schema, by which a file is known as one."""

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_NUMBER = r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?"
_PREFIXES = (
    "da|[YZEPTGMkhdcmunpfazyµμ]|yotta|zetta|exa|peta|tera|giga|mega|kilo|hecto|deka|deca|deci|centi|milli|micro|nano|"
    "pico|femto|atto|zepto|yocto"
)


@cache
def write_schema() -> str:
    """Return the schema as JSON."""
    schema = Scene.model_json_schema(schema_generator=_Generator)
    schema["title"], properties = TITLE, schema["properties"]
    properties["base"] = {"type": "string", "description": "Ready scene, or path of a scene, that this one builds on."}
    properties["set"] = {"type": "array", "items": {"type": "string"}, "description": "Single values to replace."}
    # A scene that builds on another has its tables, and a body that is like another its keys.
    schema["anyOf"] = [{"required": ["base"]}, {"required": schema.pop("required")}]
    body = properties["body"]["patternProperties"]
    kinds = [schema["$defs"][kind["$ref"].rpartition("/")[2]] for kind in next(iter(body.values()))["oneOf"]]
    schema["$defs"]["like"] = _join_kinds(kinds)
    for name, table in body.items():
        body[name] = {"if": {"required": ["like"]}, "then": {"$ref": "#/$defs/like"}, "else": table}
    schema["$defs"] |= dict(_describe_quantities())
    return json.dumps({"$schema": _DIALECT} | _write_references(schema), indent=1, ensure_ascii=False) + "\n"


def is_known_by_scene(table: type[SceneTable], key: str) -> bool:
    """Return true for the body of a picture, which a scene with a single flexible body may leave out."""
    return key == "body" and issubclass(table, BodyPicture)


class _Generator(GenerateJsonSchema):
    """Writer of the tables' schemas as a file has them: without null, and with kinds and meanings."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        """Leave null out, which TOML doesn't have."""
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        """Leave defaults out, which are in SI units."""
        return self.generate_inner(schema["schema"])

    def field_title_should_be_set(self, schema: Any) -> bool:
        """Leave titles out, which repeat the keys."""
        return False

    def model_schema(self, schema: core_schema.ModelSchema) -> JsonSchemaValue:
        """Add the meanings of a table and of its keys, and its kind to what it needs."""
        table, found = schema["cls"], super().model_schema(schema)
        paragraphs, _ = read_docstring(table)
        found["description"] = paragraphs[0]
        for key, meaning in read_meanings(table).items():
            if key in found.get("properties", ()):
                found["properties"][key]["description"] = meaning
        kinds = [name for name, field in table.model_fields.items() if is_kind(name, field)]
        if table not in KNOWN_BY_FILES:
            needed = [key for key in found.get("required", ()) if not is_known_by_scene(table, key)]
            found["required"] = [*kinds, *needed]
        return found

    def dict_schema(self, schema: core_schema.DictSchema) -> JsonSchemaValue:
        """Allow no other names than those of the pattern."""
        return super().dict_schema(schema) | {"additionalProperties": False}


def _join_kinds(kinds: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the schema of a body that is like another: with keys of any kind, and none that it needs."""
    keys: dict[str, list[Any]] = {}
    for kind in kinds:
        for key, values in kind["properties"].items():
            keys[key] = [*keys.get(key, []), *([values] if values not in keys.get(key, []) else [])]
    properties = {key: values[0] if len(values) == 1 else {"anyOf": values} for key, values in keys.items()}
    return {
        "type": "object",
        "description": "A body that has the keys of another, and its own in place of them.",
        "properties": {"like": {"type": "string", "description": "Name of the other body."}, **properties},
        "additionalProperties": False,
    }


def _describe_quantities() -> Iterator[tuple[str, dict[str, Any]]]:
    """Describe units and quantities of each kind by patterns: units of its own, or any product of units."""
    units = list_units()
    any_unit = _name_pattern([name for names in units.values() for name in names])
    power = r"((\^|\*\*)-?[1-9]|[²³])"
    factor = f"{any_unit}{power}?"
    product = rf"({any_unit}{power}|{factor}((\s*[*/·]\s*|\s+){factor})+)"
    yield "unit", {"type": "string", "pattern": f"^({factor}|{product})$"}
    beside = rf"(\s*(±|\+/-|\+-)\s*{_NUMBER}\s*(%|{factor}|{product}))?"
    yield "product", {"type": "string", "pattern": rf"^\s*{_NUMBER}\s*{product}{beside}\s*$"}
    for kind, names in units.items():
        if kind:
            own = {"type": "string", "pattern": rf"^\s*{_NUMBER}\s*{_name_pattern(names)}{beside}\s*$"}
            alternatives = [own, {"$ref": "#/$defs/product"}] if names else [{"$ref": "#/$defs/product"}]
            yield kind, {"anyOf": alternatives, "examples": [example_of(kind)]}


def _name_pattern(names: list[str]) -> str:
    plurals = [f"{name}s?" if len(name) > LONGEST_SYMBOL else name for name in sorted(names)]
    return f"(({_PREFIXES})?({'|'.join(plurals)}))"


def _write_references(node: Any) -> Any:
    """Return a schema in which quantities and units refer to their definitions."""
    if isinstance(node, list):
        return [_write_references(item) for item in node]
    if not isinstance(node, dict):
        return node
    kind = "unit" if "$unit" in node else node.get("$quantity")
    rest = {key: _write_references(value) for key, value in node.items() if key not in ("$unit", "$quantity")}
    if kind is None:
        return rest
    return {"$ref": f"#/$defs/{kind.replace(' ', '%20')}"} | {key: rest[key] for key in rest if key != "type"}


def is_kind(name: str, field: FieldInfo) -> bool:
    """Return True for the key that says of which kind a table is; in Python the class says it."""
    return name in ("shape", "type", "integrator") and len(get_args(field.annotation)) == 1


def read_meanings(table: type[SceneTable]) -> dict[str, str]:
    """Read the meaning of each key of a table, as Markdown, off the comments in its class and in its bases."""
    meanings: dict[str, str] = {}
    for base in reversed(table.__mro__[: table.__mro__.index(SceneTable)]):
        meanings |= {name: to_markdown(text) for name, text in read_comments(base).items()}
    return meanings


def read_docstring(table: type[SceneTable]) -> tuple[list[str], str]:
    """Return the paragraphs at a docstring's beginning and the TOML of its example, empty if it has none."""
    text, _, example = inspect.cleandoc(table.__doc__ or "").partition("\n\nExample:\n")
    return [to_markdown(paragraph) for paragraph in text.split("\n\n")], inspect.cleandoc(example.lstrip("\n"))


def to_markdown(text: str) -> str:
    """Turn a docstring's text into one line of Markdown."""
    return re.sub(r"\s+", " ", text.replace("``", "`")).strip()


TO_TOOLS = ("type: ignore", "noqa", "pragma")


def read_comments(table: type) -> dict[str, str]:
    """Read what the comments of a class say of the fields that it defines.

    One above a field is also of those of the same type that follow it without any.
    """
    lines, classes = _read_source(table.__module__)
    meanings, shared, kind = dict[str, str](), "", ""
    for field, text, _ in comments_of_fields(classes[table.__name__], lines):
        before, kind = kind, ast.unparse(field.annotation)
        if text or kind != before:
            shared = text if lines[field.lineno - 2].lstrip().startswith("#") else ""
        meanings[field.target.id] = text or shared
    return {name: meaning for name, meaning in meanings.items() if meaning}


def comments_of_fields(node: ast.ClassDef, lines: Sequence[str]) -> Iterator[tuple[Any, str, bool]]:
    """Yield the annotated fields of a class, their comments, and whether the next field shares that.

    It does if it is of the same type and has none: then the text is neither's alone.
    """
    fields = [field for field in node.body if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)]
    texts = [_comment(field, lines) for field in fields]
    described = [text or _has_docstring(node, field) for field, text in zip(fields, texts, strict=True)]
    for k, (field, text) in enumerate(zip(fields, texts, strict=True)):
        after = fields[k + 1 : k + 2]
        alike = any(ast.unparse(each.annotation) == ast.unparse(field.annotation) for each in after)
        yield field, text, bool(text) and alike and not described[k + 1]


@cache
def _read_source(module: str) -> tuple[list[str], dict[str, ast.ClassDef]]:
    source = inspect.getsource(sys.modules[module])
    return source.splitlines(), {
        node.name: node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ClassDef)
    }


def _has_docstring(node: ast.ClassDef, field: ast.AnnAssign) -> bool:
    return any(isinstance(after, ast.Expr) for after in node.body[node.body.index(field) + 1 :][:1])


def _comment(field: ast.AnnAssign, lines: Sequence[str]) -> str:
    _, *beside = lines[(field.end_lineno or 0) - 1].split("  # ")
    above = takewhile(lambda line: line.startswith("# "), (x.strip() for x in lines[field.lineno - 2 :: -1]))
    told = [text for text in beside if not text.startswith(TO_TOOLS)]
    return " ".join(told or [line[2:] for line in [*above][::-1]])


if __name__ == "__main__":
    sys.stdout.write(write_schema())
