"""Results of a scene that were found beside others like it, for its own stages to take."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from fmd.integrators.protocol import Trajectory
    from fmd.stability.operating_points import OperatingPoints
    from fmd.stages.stiffening_check import RigidLoads

FINE = "finely"  # label of the first run's second march among those that have been integrated


class HasResults(Protocol):
    """A scene's stages, with their results by name."""

    results: dict[str, Any]


def keep_known_loads(run: HasResults, loads: RigidLoads) -> None:
    """Keep the loads by a scene's rigid bodies for its check of loads to take."""
    run.results["rigid loads"] = loads


def take_known_loads(run: HasResults) -> RigidLoads | None:
    """Return the loads by a scene's rigid bodies if they have been found, which aren't kept any longer."""
    found: RigidLoads | None = run.results.pop("rigid loads", None)
    return found


def known_points(run: HasResults) -> list[OperatingPoints]:
    """Return the operating points of a scene's systems that have been found, to which others are added."""
    points: list[OperatingPoints] = run.results.setdefault("operating points", [])
    return points


def known_marches(run: HasResults) -> dict[str, Trajectory]:
    """Return a scene's runs, by their labels, that have been integrated beside those of other scenes."""
    marches: dict[str, Trajectory] = run.results.setdefault("marches", {})
    return marches
