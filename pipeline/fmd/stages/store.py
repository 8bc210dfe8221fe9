"""Runs stages, keeps their results, and logs which were computed, which came from the cache, and for how long."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import field, replace
from typing import Any, TypeVar

from fmd.core.cache import Cache
from fmd.core.clock import read_clocks, seconds_since
from fmd.core.data_classes import dataclass
from fmd.core.progress import Advance, Monitor, silent
from fmd.core.threads import one_thread

T = TypeVar("T")


@dataclass
class Log:
    """Time and origin of each stage's results, in the order in which they came."""

    # Time that each stage took, computed or read from the cache, of all bodies together [s].
    seconds: dict[str, float] = field(default_factory=dict)
    run: list[str] = field(default_factory=list)  # stages that were computed
    cached: list[str] = field(default_factory=list)  # stages that were read

    def add(self, stage: str, seconds: float, names: list[str]) -> None:
        """Add a stage's time, and its name to those run or those cached."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        if stage not in names:
            names.append(stage)


@dataclass(frozen=True)
class StageStore:
    """Computes results of stages, or reads them from a cache."""

    cache: Cache
    monitor: Monitor = silent  # reports each stage's progress
    # Finds what is unusual about the scene, which an error of a stage has as its notes.
    remarks: Callable[[], Iterable[str]] = tuple
    log: Log = field(default_factory=Log)  # records what was done
    # Results by their keys, which bodies of one part have in common.
    shared: dict[str, Any] = field(default_factory=dict)
    computing: list[Advance] = field(default_factory=list)  # progress of each stage that is being computed

    @property
    def advance(self) -> Advance:
        """Take the part that is done of the stage that is being computed, the innermost one."""
        return self.computing[-1]

    def alone(self) -> StageStore:
        """Return a store that shares no results by their keys, for results that their keys don't describe."""
        return replace(self, shared={})

    def share_or_compute(self, stage: str, key: str, compute: Callable[[], T]) -> T:
        """Return the result that another body has under the same key, or compute it; nothing is kept on disk."""
        if key not in self.shared:
            self.shared[key] = self.compute(stage, compute)
        value: T = self.shared[key]
        return value

    def read_or_compute(
        self,
        stage: str,
        key: str,
        compute: Callable[[], T],
        keep: Callable[[T], bool] = lambda result: True,
        kind: str = "",
    ) -> T:
        """Take a stage's result from another body with the same key, read it, or compute it and ``keep`` it.

        Of several processes that need it, one computes. ``kind`` is the annotation of the result: what is kept but
        doesn't fit it is computed again.
        """
        if key not in self.shared:
            self.shared[key] = self._read_or_compute(stage, key, compute, keep, kind)
        value: T = self.shared[key]
        return value

    def _read_or_compute(
        self, stage: str, key: str, compute: Callable[[], T], keep: Callable[[T], bool], kind: str
    ) -> T:
        tick = read_clocks()
        value: T | None = self.cache.load(key, kind)
        if value is None:
            with self.cache.lock(key):
                value = self.cache.load(key, kind)
                if value is None:
                    value = self.compute(stage, compute)
                    if keep(value):
                        self.cache.save(key, value)
                    return value
        self.log.add(stage, seconds_since(tick), self.log.cached)
        return value

    def read_or_keep(self, key: str, compute: Callable[[], T], kind: str) -> T:
        """Read a result that is a part of another stage, or compute and keep it; the log doesn't have it."""
        value: T | None = self.cache.load(key, kind)
        if value is None:
            value = compute()
            self.cache.save(key, value)
        return value

    def compute(self, stage: str, compute: Callable[[], T]) -> T:
        """Compute a stage, and log its time, also if it fails: that of stages that it needs in turn isn't its own."""
        others = sum(self.log.seconds.values())
        tick = read_clocks()
        try:
            with self.monitor(stage) as advance, nullcontext() if self.computing else one_thread():
                self.computing.append(advance)
                try:
                    return compute()
                finally:
                    self.computing.pop()
        except Exception as error:
            for text in self.remarks():
                if text not in getattr(error, "__notes__", ()):  # of a stage that this one needs
                    error.add_note(text)
            raise
        finally:
            spent = seconds_since(tick)
            self.log.add(stage, spent - (sum(self.log.seconds.values()) - others), self.log.run)
