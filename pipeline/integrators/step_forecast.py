"""Forecast of the steps that a march takes: one that would never come to an end is given up with the reason."""

from __future__ import annotations

from pipeline.core.errors import StabilityError
from pipeline.dynamics.system import System

_TELLING = 20_000  # steps, by which a march tells how many it will take
MOST_STEPS = 1e10  # some hours at least


def require_an_end(
    name: str,
    system: System,
    steps: int,
    done: float,
    duration: float,
    most: float = MOST_STEPS,
    telling: int = _TELLING,
) -> None:
    """Check that a march which has covered a time ``done`` of a duration [s] by some steps comes to an end.

    Parameters
    ----------
    most : float
        Steps that still come to an end.
    telling : int
        Steps after which that is told.

    Raises
    ------
    StabilityError
        It would take more than ``most`` steps; the message names what acts so fast.
    """
    if steps < telling or not steps * duration > most * done:
        return
    describe = getattr(system, "describe_fastest", None)
    because = f", because of {describe()}" if describe else ""
    total = f"{steps * duration / done:.1g}" if done > 0.0 else "countless"
    raise StabilityError(
        f"{name} would take {total} steps{because}; make that softer or heavier, put a joint in place of what is to be "
        "rigid, or shorten the duration"
    )
