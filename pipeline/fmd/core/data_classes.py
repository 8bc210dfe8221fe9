"""Data classes whose methods are compiled when one is first called.

Python's own decorator compiles six methods of a class, one by one, while its module is loaded. A run loads 250 classes
and calls methods of a part of them: that took a fifth of a run whose results are all in the cache.
"""

from __future__ import annotations

import dataclasses
from dataclasses import FrozenInstanceError
from typing import TYPE_CHECKING, Any, TypeVar, cast

__all__ = ["dataclass", "with_values"]

D = TypeVar("D")

_METHODS = ("__init__", "__repr__", "__eq__", "__hash__")

if TYPE_CHECKING:
    from dataclasses import dataclass
else:

    def dataclass(cls=None, /, *, frozen=False, eq=True, slots=False):
        """Make a data class, as `dataclasses.dataclass` does, but compile its methods when one is first called."""
        if cls is None:
            return lambda own: dataclass(own, frozen=frozen, eq=eq, slots=slots)
        checked = frozen and any(map(dataclasses.is_dataclass, cls.__bases__))  # that its bases are frozen, too
        made = dataclasses.dataclass(init=False, repr=False, eq=False, frozen=checked, slots=slots)(cls)
        made.__dataclass_params__ = _PARAMETERS[frozen, eq]
        own = {name for name in _METHODS if name in vars(made)}
        if "__eq__" in own and made.__hash__ is None:  # Python's own doing
            own.discard("__hash__")
        for name in _METHODS[: 4 if frozen and eq else 3 if eq else 2]:
            if name not in own:
                setattr(made, name, _Late(made, name))
        if eq and not frozen and "__hash__" not in own:
            made.__hash__ = None
        if frozen and not checked:
            _freeze(made)
        if frozen and slots:
            made.__getstate__, made.__setstate__ = _state, _set_state
        return made


def with_values(instance: D, **values: Any) -> D:
    """Return a copy of an instance without slots with other values of some fields, which is not checked again."""
    made: D = object.__new__(type(instance))
    own = vars(instance)
    vars(made).update({each.name: own[each.name] for each in dataclasses.fields(cast(Any, instance))} | values)
    return made


def _parameters(frozen: bool, eq: bool) -> Any:
    """Return what Python's decorator writes down of a class, by which it checks those that inherit from it."""
    return vars(dataclasses.dataclass(frozen=frozen, eq=eq)(type("Any", (), {})))["__dataclass_params__"]


_PARAMETERS = {(frozen, eq): _parameters(frozen, eq) for frozen in (False, True) for eq in (False, True)}


class _Late:
    """Method of a data class that is compiled when it is first looked up."""

    def __init__(self, cls: type[Any], name: str) -> None:
        self._cls, self._name = cls, name

    def __get__(self, instance: object, owner: type[Any]) -> Any:
        if vars(self._cls)[self._name] is self:
            setattr(self._cls, self._name, _compile_method(self._cls, self._name))
        return vars(self._cls)[self._name].__get__(instance, owner)


def _compile_method(cls: type[Any], name: str) -> Any:
    """Return the method that Python's decorator gives a class of the same fields."""
    fields = dataclasses.fields(cls)
    space: dict[str, Any] = {"__module__": cls.__module__, "__qualname__": cls.__qualname__, "__doc__": cls.__doc__}
    space |= {"__annotations__": {each.name: each.type for each in fields}} | {each.name: each for each in fields}
    if hasattr(cls, "__post_init__"):
        space["__post_init__"] = None  # that it is there is all that counts
    frozen = name == "__hash__" or (name == "__init__" and vars(cls)["__dataclass_params__"].frozen)
    make = dataclasses.dataclass(
        init=name == "__init__", repr=name == "__repr__", eq=name in ("__eq__", "__hash__"), frozen=frozen
    )
    return vars(make(type(cls.__name__, (), space)))[name]


def _freeze(cls: Any) -> None:
    """Refuse values of a class's fields, and all of its own instances': a plain class that inherits may have others."""
    names = {each.name for each in dataclasses.fields(cls)}

    def set_value(self: object, name: str, value: object) -> None:
        if type(self) is cls or name in names:
            raise FrozenInstanceError(f"cannot assign to field {name!r}")
        super(cls, self).__setattr__(name, value)

    def delete(self: object, name: str) -> None:
        if type(self) is cls or name in names:
            raise FrozenInstanceError(f"cannot delete field {name!r}")
        super(cls, self).__delattr__(name)

    cls.__setattr__, cls.__delattr__ = set_value, delete


def _state(self: Any) -> list[Any]:
    return [getattr(self, each.name) for each in dataclasses.fields(self)]


def _set_state(self: Any, state: list[Any]) -> None:
    for each, value in zip(dataclasses.fields(self), state, strict=True):
        object.__setattr__(self, each.name, value)
