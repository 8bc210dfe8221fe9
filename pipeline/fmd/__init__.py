"""From the shape of a flexible part to its stress in motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fmd.core.version import __version__

if TYPE_CHECKING:
    from fmd.output.result import Result, load, solve
    from fmd.scene.scene import Scene, load_scene
    from fmd.stages.pipeline import Pipeline

__all__ = ["Pipeline", "Result", "Scene", "__version__", "load", "load_scene", "solve"]


def __getattr__(name: str) -> object:
    """Load the public names when first used: ``import fmd`` alone stays free of heavy modules."""
    if name in ("Scene", "load_scene"):
        from fmd.scene import scene

        return getattr(scene, name)
    if name in ("Result", "load", "solve"):
        from fmd.output import result

        return getattr(result, name)
    if name == "Pipeline":
        from fmd.stages.pipeline import Pipeline

        return Pipeline
    raise AttributeError(f"module 'fmd' has no attribute {name!r}")
