"""A row of the stage graph: name, inputs, sources and computation of one kind of result.

The stages of a class are its attributes of this type, in their order; running, caching, forecasting and logging are all
derived from them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar, overload

from fmd.core.cache import stage_key
from fmd.stages.store import StageStore

T = TypeVar("T")


class Staged(Protocol):
    """An object whose results are stages: each is computed on first use and remembered.

    Attributes
    ----------
    store : StageStore
        Computes and keeps results.
    results : dict of str to object
        Results by the name of their stage, as far as they are there.
    """

    store: StageStore
    results: dict[str, Any]


@dataclass(frozen=True)
class Stage(Generic[T]):
    """One stage of a graph, read as an attribute of the object that it belongs to.

    Parameters
    ----------
    name : str
        Name in the log, in forecasts and in the cache.
    compute : callable
        Makes the result for an object.
    reads : tuple of str
        Stages of the same object that are needed to compute it.
    inputs : callable, optional
        Everything that the result depends on, as plain data for its key; without, the result is never kept.
    sources, packages : tuple of str
        Python sources, named from the project's root, and installed packages that make the result.
    in_key : tuple of str
        Stages whose results are among ``inputs``: while they aren't known, neither is the key.
    shared_inputs : callable, optional
        As ``inputs``, for a result that is never kept but that bodies of one part have in common.
    """

    name: str
    compute: Callable[[Any], T]
    reads: tuple[str, ...] = ()
    inputs: Callable[[Any], Any] | None = None
    sources: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()
    in_key: tuple[str, ...] = ()
    shared_inputs: Callable[[Any], Any] | None = None

    def key(self, owner: Staged) -> str:
        """Return the key that an object's result is kept under; empty if it never is."""
        return "" if self.inputs is None else stage_key(self.name, self.inputs(owner), self.sources, self.packages)

    def of(self, owner: Staged) -> T:
        """Return an object's result, computed or read on first use."""
        if self.name not in owner.results:
            if self.shared_inputs is not None:
                key = stage_key(self.name, self.shared_inputs(owner), self.sources, self.packages)
                owner.results[self.name] = owner.store.share_or_compute(self.name, key, lambda: self.compute(owner))
            elif self.inputs is None:
                owner.results[self.name] = owner.store.compute(self.name, lambda: self.compute(owner))
            else:
                owner.results[self.name] = owner.store.read_or_compute(
                    self.name, self.key(owner), lambda: self.compute(owner)
                )
        result: T = owner.results[self.name]
        return result

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
