"""Results as bytes and back, without pickle: a tree as JSON, its arrays as NumPy's ``.npy``.

What is read may come from anywhere: no function is called by its name, and the only objects that are made are data
classes and named tuples of this package, with the fields and the kinds of values that they declare.
"""

import io
import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

_PACKAGE = "fmd."
_LENGTH_BYTES = 8
_PLAIN = (type(None), bool, int, float, str)
# Kinds of values by the first word of an annotation; a class of this package is known by its name.
_KINDS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("Array", "IntArray", "NDArray", "ndarray"), ("ndarray",)),
    **dict.fromkeys(("dict", "Dict", "Mapping"), ("dict", "mappingproxy")),
    **dict.fromkeys(("Sequence", "Iterable"), ("list", "tuple", "ndarray", "range")),
    **{name: (name,) for name in ("bool", "str", "bytes", "tuple", "list", "set", "frozenset", "csr_array")},
    "int": ("int", "int64", "int32"),
    "float": ("float", "int", "float64", "float32"),
    "None": ("NoneType",),
}


def encode(value: Any) -> bytes:
    """Write a value as bytes that `decode` reads; an object that stands at several places is written once.

    Raises
    ------
    TypeError
        The value holds an object of a kind that isn't kept; the message names it.
    """
    writer = _Writer()
    tree = json.dumps(writer.tree(value), separators=(",", ":")).encode()
    return len(tree).to_bytes(_LENGTH_BYTES, "little") + tree + b"".join(writer.blobs)


def decode(content: bytes) -> Any:
    """Return the value that `encode` has written.

    Raises
    ------
    ValueError
        The content isn't such a value, or one of another version of its classes.
    """
    start = _LENGTH_BYTES + int.from_bytes(content[:_LENGTH_BYTES], "little")
    try:
        tree = json.loads(content[_LENGTH_BYTES:start])
        return _Reader(memoryview(content)[start:]).value(tree)
    except Exception as error:  # what JSON's and NumPy's readers raise on damaged bytes is of many kinds
        raise ValueError(f"no value of this version: {type(error).__name__}: {error}") from error


def conforms(value: Any, kind: str) -> bool:
    """Return True unless a value is of another kind than an annotation, such as ``Mapping[str, Array] | None``, says.

    Of what an annotation names, this package's classes and the most common types are known; the rest is accepted.
    """
    for choice in _split(kind, "|"):
        name, _, inner = choice.removesuffix("]").partition("[")
        head = name.rpartition(".")[2]
        known = _KINDS.get(head, (head,))
        if any(c.__name__ in known for c in type(value).__mro__):
            items, inner_kind = _items(value, _split(inner, ",")[-2:])
            return all(conforms(item, inner_kind) for item in items)
        if not (head in _KINDS or _is_class(head)):
            return True
    return False


def _items(value: Any, kinds: list[str]) -> tuple[Iterable[Any], str]:
    """Return the items of a container that are of one kind, and the kind, by the last two words in its brackets."""
    if isinstance(value, Mapping) and len(kinds) == 2:
        return value.values(), kinds[1]
    if isinstance(value, list | set | frozenset):
        return value, kinds[-1]
    if isinstance(value, tuple) and kinds[-1] == "...":
        return value, kinds[0]
    return (), ""


def _split(text: str, mark: str) -> list[str]:
    """Return the parts of an annotation between marks that stand outside of brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter == "[") - (letter == "]")
        if letter == mark and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


@cache
def _is_class(name: str) -> bool:
    """Return True if a loaded module of this package has a class of this name that is no protocol."""
    found = [vars(module).get(name) for key, module in list(sys.modules.items()) if key.startswith(_PACKAGE)]
    own = [one for one in found if isinstance(one, type) and one.__module__.startswith(_PACKAGE)]
    return any(not getattr(one, "_is_protocol", False) for one in own)


def _is_kept(kind: type) -> bool:
    """Return True for this package's data classes, named tuples and tables of scenes."""
    return kind.__module__.startswith(_PACKAGE) and (
        is_dataclass(kind) or hasattr(kind, "_fields") or hasattr(kind, "model_fields")
    )


def _names(kind: Any) -> tuple[str, ...]:
    """Return the names of a class's fields."""
    if hasattr(kind, "model_fields"):
        return tuple(kind.model_fields)
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else tuple(kind._fields)


class _Writer:
    """Turns values into a tree of plain lists, and gathers the bytes beside it."""

    def __init__(self) -> None:
        self.blobs: list[bytes] = []
        self._place = 0
        self._seen: dict[int, int] = {}
        self._alive: list[Any] = []  # so that no two of them have one number

    def tree(self, value: Any) -> Any:
        """Return a value as a tree: plain ones as they are, others as a list that begins with their kind."""
        if type(value) in _PLAIN:
            return value
        if isinstance(value, list | tuple | set | frozenset) and not hasattr(value, "_fields"):
            return [type(value).__name__, *map(self.tree, value)]
        if type(value).__name__ in ("dict", "mappingproxy"):
            return ["dict", *([self.tree(key), self.tree(item)] for key, item in value.items())]
        if id(value) in self._seen:
            return ["again", self._seen[id(value)]]
        self._seen[id(value)] = len(self._seen)
        self._alive.append(value)
        return self._object(value)

    def _object(self, value: Any) -> Any:
        """Return the tree of an object that may stand at several places."""
        kind = type(value)
        if kind.__module__ == "numpy":
            return [("array" if kind.__name__ == "ndarray" else "scalar"), *self._array(value)]
        if kind.__module__.startswith("scipy.sparse") and value.format == "csr":
            return [
                "csr",
                list(value.shape),
                *(self.tree(getattr(value, name)) for name in ("data", "indices", "indptr")),
            ]
        if isinstance(value, bytes):
            return ["bytes", *self._blob(value)]
        if isinstance(value, Path):
            return ["path", str(value)]
        if isinstance(value, complex):
            return ["complex", value.real, value.imag]
        if isinstance(value, range | slice):
            return [kind.__name__, value.start, value.stop, value.step]
        if isinstance(value, Enum) and kind.__module__.startswith(_PACKAGE):
            return ["enum", kind.__module__, kind.__qualname__, value.name]
        if _is_kept(kind):
            own = [[name, self.tree(getattr(value, name))] for name in _names(kind)]
            return ["object", kind.__module__, kind.__qualname__, *own]
        raise TypeError(f"a {kind.__module__}.{kind.__qualname__} isn't kept")

    def _array(self, array: Any) -> tuple[int, int]:
        if array.dtype.hasobject:
            raise TypeError("an array of objects isn't kept")
        stream = io.BytesIO()
        np.lib.format.write_array(stream, np.asanyarray(array), allow_pickle=False)
        return self._blob(stream.getvalue())

    def _blob(self, content: bytes) -> tuple[int, int]:
        """Put bytes behind those that are there; return their place and their number."""
        self.blobs.append(content)
        self._place += len(content)
        return self._place - len(content), len(content)


class _Reader:
    """Makes values of a tree, in the order in which it was written."""

    def __init__(self, blobs: memoryview) -> None:
        self._blobs = blobs
        self._made: list[Any] = []

    def value(self, tree: Any) -> Any:
        """Return the value of a tree."""
        if not isinstance(tree, list):
            return tree
        kind, *rest = tree
        match kind:
            case "list" | "tuple" | "set" | "frozenset":
                made = map(self.value, rest)
                return {"list": list, "tuple": tuple, "set": set, "frozenset": frozenset}[kind](made)
            case "dict":
                return {self.value(key): self.value(item) for key, item in rest}
            case "again":
                return self._made[rest[0]]
        place = len(self._made)
        self._made.append(None)
        self._made[place] = self._object(kind, rest)
        return self._made[place]

    def _object(self, kind: str, rest: list[Any]) -> Any:
        match kind, rest:
            case (("array" | "scalar"), [start, length]):
                array = np.lib.format.read_array(io.BytesIO(self._blob(start, length)), allow_pickle=False)
                return array if kind == "array" else array[()]
            case "csr", [shape, *parts]:
                from scipy.sparse import csr_array

                found = csr_array(tuple(map(self.value, parts)), shape=tuple(shape))
                found.check_format(full_check=True)
                return found
            case "bytes", [start, length]:
                return bytes(self._blob(start, length))
            case "path", [name]:
                return Path(name)
            case "complex", [real, imaginary]:
                return complex(real, imaginary)
            case (("range" | "slice"), [start, stop, step]):
                return {"range": range, "slice": slice}[kind](start, stop, step)
            case "enum", [module, name, member]:
                return _own_class(module, name, Enum)[member]
            case "object", [module, name, *own]:
                return self._own_object(_own_class(module, name, object), own)
        raise ValueError(f"{kind!r} is no kind of value")

    def _own_object(self, kind: Any, own: list[Any]) -> Any:
        """Make an object of its fields, as it was: nothing of its class is run."""
        if [name for name, _ in own] != list(_names(kind)):
            raise ValueError(f"{kind.__qualname__} has other fields")
        values = {name: self.value(tree) for name, tree in own}
        kinds = {
            name: text for c in reversed(kind.__mro__) for name, text in vars(c).get("__annotations__", {}).items()
        }
        for name, value in values.items():
            if isinstance(text := kinds.get(name, ""), str) and not conforms(value, text):
                raise ValueError(f"{kind.__qualname__}.{name} is no {text}")
        if hasattr(kind, "model_fields"):
            return kind.model_construct(**values)
        if not is_dataclass(kind):
            return tuple.__new__(kind, values.values())
        made: Any = object.__new__(kind)  # type: ignore[arg-type]
        for name, value in values.items():
            object.__setattr__(made, name, value)
        return made

    def _blob(self, start: int, length: int) -> memoryview:
        if not 0 <= start <= start + length <= len(self._blobs):
            raise ValueError("its arrays are cut off")
        return self._blobs[start : start + length]


def _own_class(module: str, name: str, base: type) -> Any:
    """Return a data class, a named tuple or an enumeration of this package by its name."""
    if not module.startswith(_PACKAGE):
        raise ValueError(f"{module} is none of this package's modules")
    found: Any = import_module(module)
    for part in name.split("."):
        found = getattr(found, part)
    own = isinstance(found, type) and found.__module__ == module and issubclass(found, base)
    if not (own and (_is_kept(found) or base is Enum)):
        raise ValueError(f"{module}.{name} isn't kept")
    return found
