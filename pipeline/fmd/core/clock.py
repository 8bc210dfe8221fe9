"""Time that work takes, by which what comes next is decided."""

import os
import time


def read_clocks() -> tuple[float, float]:
    """Return the seconds of the clock, and those that this process and its children have worked."""
    return time.perf_counter(), time.process_time() + sum(os.times()[2:4])


def seconds_since(start: tuple[float, float]) -> float:
    """Return the seconds since clocks were read: by the clock, or of the processor where others use the machine."""
    return min(now - then for now, then in zip(read_clocks(), start, strict=True))
