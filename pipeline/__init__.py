"""From the shape of a flexible part to its stress in motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.core.version import __version__

if TYPE_CHECKING:
    from pipeline.output.notebook import load
    from pipeline.scene.scene import Scene, load_scene
    from pipeline.stages.pipeline import Pipeline

__all__ = ["Pipeline", "Scene", "__version__", "load", "load_scene"]


def __getattr__(name: str) -> object:
    """Load the public names when first used: ``import pipeline`` alone stays free of heavy modules."""
    if name in ("Scene", "load_scene"):
        from pipeline.scene import scene

        return getattr(scene, name)
    if name == "load":
        from pipeline.output.notebook import load

        return load
    if name == "Pipeline":
        from pipeline.stages.pipeline import Pipeline

        return Pipeline
    raise AttributeError(f"module 'pipeline' has no attribute {name!r}")
