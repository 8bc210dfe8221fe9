"""Values given to commands: a scene with its overrides, an angular rate."""

from __future__ import annotations

from pipeline.core.cache import Cache
from pipeline.core.errors import InputError
from pipeline.core.progress import bars
from pipeline.core.units import to_si
from pipeline.scene.scene import load_scene
from pipeline.scene.source_files import load_repaired
from pipeline.stages.pipeline import Pipeline


def open_pipeline(
    scene: str, overrides: list[str] | None, no_cache: bool = False, repair: bool = False, keep_all: bool = False
) -> Pipeline:
    """Load a scene with a command's options, and make its pipeline with progress bars on the terminal."""
    loaded = load_repaired(scene, overrides or ()) if repair else load_scene(scene, overrides or ())
    return Pipeline(loaded, Cache(None) if no_cache else None, bars, keep_all)


def read_rate(option: str, text: str) -> float:
    """Read an angular rate from the command line [rad/s].

    Raises
    ------
    InputError
        The text isn't an angular rate.
    """
    try:
        return to_si(text, "angular rate")
    except ValueError as error:
        raise InputError(option, "", text, str(error)) from None
