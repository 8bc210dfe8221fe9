"""Stages that run once and are kept: what was computed, what came from the cache, and how long each took."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from pipeline.core.cache import Cache
from pipeline.core.progress import Monitor

T = TypeVar("T")
STAGES = (
    *("mesh", "assembly", "modes", "body", "stiffening", "motion"),
    *("surface", "stress", "nodal stress", "inertia", "error budget", "files", "pictures"),
)


def name_of(stage: str, key: str) -> str:
    """Name that a stage's result of a key has in the cache."""
    return f"{stage}-{key}"


@dataclass
class Log:
    """What has happened to each stage, in order.

    Attributes
    ----------
    seconds : dict of str to float
        Time that each stage took, whether it ran or was read from the cache [s]; of all bodies together.
    run, cached : list of str
        Stages that were computed and stages that were read.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    run: list[str] = field(default_factory=list)
    cached: list[str] = field(default_factory=list)

    @property
    def skipped(self) -> list[str]:
        """Stages that nothing asked for."""
        return [stage for stage in STAGES if stage not in self.seconds]

    def add(self, stage: str, seconds: float, names: list[str]) -> None:
        """Note a stage's time, and its name among those run or those cached."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        if stage not in names:
            names.append(stage)


@dataclass(frozen=True)
class Keeper:
    """Runs stages and keeps their results.

    Parameters
    ----------
    cache : Cache
        Where results are kept.
    monitor : Monitor
        Is told of each stage's progress.
    log : Log
        Is told what was done.
    """

    cache: Cache
    monitor: Monitor
    log: Log = field(default_factory=Log)

    def kept(self, stage: str, key: str, make: Callable[[], T]) -> T:
        """Read a stage's result, or compute and keep it; of several processes that want it, one computes."""
        key = name_of(stage, key)
        tick = time.perf_counter()
        value: T | None = self.cache.load(key)
        if value is None:
            with self.cache.lock(key):
                value = self.cache.load(key)
                if value is None:
                    value = self.timed(stage, make)
                    self.cache.save(key, value)
                    return value
        self.log.add(stage, time.perf_counter() - tick, self.log.cached)
        return value

    def timed(self, stage: str, make: Callable[[], T]) -> T:
        """Compute a stage; stages that it asks for in turn don't count as its own time."""
        from threadpoolctl import threadpool_limits

        others = sum(self.log.seconds.values())
        tick = time.perf_counter()
        with (
            self.monitor(stage),
            threadpool_limits(1),
        ):  # the products here are small: two BLAS threads only spin
            value = make()
        spent = time.perf_counter() - tick
        self.log.add(stage, spent - (sum(self.log.seconds.values()) - others), self.log.run)
        return value
