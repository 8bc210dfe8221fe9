"""From the shape of a flexible part to its stress in motion.

Beside the names below every table of a scene is here as a class, such as ``fmd.Rod``, ``fmd.Revolute`` and
``fmd.Simulation``; docs/scene.md has their keys.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fmd.core.errors import AccuracyError, InputError
from fmd.core.version import __version__

if TYPE_CHECKING:
    from fmd.fitting.result_function import ResultFunction
    from fmd.fitting.sensitivities import jacobian
    from fmd.output.result import Result, load, solve
    from fmd.output.stepped import SteppedScene
    from fmd.scene.scene import Scene, load_scene
    from fmd.stages.pipeline import Pipeline

__all__ = [
    "AccuracyError",
    "InputError",
    "Pipeline",
    "Result",
    "ResultFunction",
    "Scene",
    "SteppedScene",
    "__version__",
    "jacobian",
    "load",
    "load_scene",
    "solve",
]


def __getattr__(name: str) -> Any:
    """Load the public names when first used: ``import fmd`` alone stays free of heavy modules."""
    if name in ("Scene", "load_scene"):
        from fmd.scene import scene

        return getattr(scene, name)
    if name in ("Result", "load", "solve"):
        from fmd.output import result

        return getattr(result, name)
    if name == "SteppedScene":
        from fmd.output.stepped import SteppedScene

        return SteppedScene
    if name == "ResultFunction":
        from fmd.fitting.result_function import ResultFunction

        return ResultFunction
    if name == "jacobian":
        from fmd.fitting.sensitivities import jacobian

        return jacobian
    if name == "Pipeline":
        from fmd.stages.pipeline import Pipeline

        return Pipeline
    if name[:1].isupper():
        from fmd.scene.scene import list_tables

        if name in (tables := list_tables()):
            return tables[name]
    raise AttributeError(f"module 'fmd' has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the public names, those of the tables of a scene, too."""
    from fmd.scene.scene import list_tables

    return sorted({*__all__, *list_tables()})
