"""A row of the stage graph: name, inputs, sources and computation of one kind of result.

Bodies and whole scenes have stages of this one kind, which are attributes of their classes, in their order. Running,
caching, forecasting and logging are all derived from them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any, Generic, Protocol, TypeVar, overload

from fmd.core.cache import stage_key
from fmd.core.data_classes import dataclass
from fmd.stages.store import StageStore

T = TypeVar("T")

ALL_SOURCES = ("fmd", "fmd/meshes")
"""Sources of a result that everything in a scene may change."""
ALL_PACKAGES = ("numpy", "scipy", "scikit-fem", "gmsh")
"""Packages that make such a result."""


class Staged(Protocol):
    """An object whose results are stages: each is computed on first use and remembered."""

    store: StageStore
    results: dict[str, Any]  # results by the name of their stage, as far as they are there


@dataclass(frozen=True)
class Stage(Generic[T]):
    """One stage of a graph, read as an attribute of the object that it belongs to."""

    name: str
    # Makes the result for an object; ``"module:function"`` of this package is loaded when it is first called, which a
    # result that is kept never needs.
    compute: Callable[[Any], T] | str
    # Stages that are needed to compute it: of the same object, or of each flexible body of the scene.
    reads: tuple[str, ...] = ()
    # Everything that the result depends on, as plain data for its key; without, or where it is ``None``, the result is
    # never kept.
    inputs: Callable[[Any], Any] | None = None
    sources: tuple[str, ...] = ()  # Python sources that make the result, named from the project's root
    packages: tuple[str, ...] = ()  # installed packages that make the result
    # Stages whose results are among ``inputs``: while they aren't known, neither is the key.
    in_key: tuple[str, ...] = ()
    # As ``inputs``, for a result that is never kept but that bodies of one part have in common.
    shared_inputs: Callable[[Any], Any] | None = None
    # Whether an object has such a result: a body without a mesh has no stress.
    applies: Callable[[Any], bool] = lambda owner: True
    lasts: Callable[[T], bool] = lambda result: True  # whether a result may be kept: one that is not whole may not

    @property
    def all_sources(self) -> tuple[str, ...]:
        """Sources that make the result: those that are named, and the module that computes it where that is named."""
        if not isinstance(self.compute, str):
            return self.sources
        return (*self.sources, f"fmd/stages/{self.compute.partition(':')[0]}.py")

    def key(self, owner: Staged) -> str:
        """Return the key that an object's result is kept under; empty if it never is."""
        inputs = None if self.inputs is None else self.inputs(owner)
        return "" if inputs is None else stage_key(self.name, inputs, self.all_sources, self.packages)

    def of(self, owner: Staged, compute: Callable[[Any], T] | None = None) -> T:
        """Return an object's result, computed or read on first use; ``compute`` is used in place of the stage's own."""
        if self.name not in owner.results:
            owner.results[self.name] = self._find(owner, lambda: (compute or self._load())(owner))
        result: T = owner.results[self.name]
        return result

    def _load(self) -> Callable[[Any], T]:
        if not isinstance(self.compute, str):
            return self.compute
        module, _, function = self.compute.partition(":")
        found: Callable[[Any], T] = getattr(import_module(f"fmd.stages.{module}"), function)
        return found

    def _find_kind(self, owner: Staged) -> str:
        """Return the annotation of the result: that of its computation, or of the attribute while this isn't loaded."""
        if not isinstance(self.compute, str):
            return str(self.compute.__annotations__.get("return", ""))
        attributes, declared = vars(type(owner)), type(owner).__annotations__
        kinds = [str(kind) for name, kind in declared.items() if attributes.get(name) is self]
        return kinds[0].removeprefix("Stage[").removesuffix("]") if kinds else ""

    def _find(self, owner: Staged, compute: Callable[[], T]) -> T:
        """Compute a result, unless another body has it or it is kept."""
        if self.shared_inputs is not None:
            key = stage_key(self.name, self.shared_inputs(owner), self.all_sources, self.packages)
            return owner.store.share_or_compute(self.name, key, compute)
        if key := self.key(owner):
            return owner.store.read_or_compute(self.name, key, compute, self.lasts, self._find_kind(owner))
        return owner.store.compute(self.name, compute)

    @overload
    def __get__(self, owner: None, kind: type) -> Stage[T]: ...
    @overload
    def __get__(self, owner: Staged, kind: type) -> T: ...
    def __get__(self, owner: Staged | None, kind: type) -> Stage[T] | T:
        """Return the result of an object's stage, or of a class the stage itself."""
        return self if owner is None else self.of(owner)


def stages_of(kind: type) -> Iterator[Stage[Any]]:
    """Iterate over the stages of a class in the order of their definition."""
    return (value for value in vars(kind).values() if isinstance(value, Stage))


def forget(owner: Staged, name: str) -> None:
    """Drop an object's result of a stage, and all of its results that were made of it."""
    lost = {name}
    for stage in stages_of(type(owner)):  # in their order, so that what a stage reads comes first
        if lost.intersection(stage.reads):
            lost.add(stage.name)
    for stage_name in lost:
        owner.results.pop(stage_name, None)
