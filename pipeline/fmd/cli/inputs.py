"""Values given to commands: a scene with its overrides, an angular rate."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress

from fmd.core.cache import Cache
from fmd.core.errors import InputError
from fmd.core.progress import bars
from fmd.core.units import to_si
from fmd.scene.scene import load_scene
from fmd.scene.source_files import load_repaired
from fmd.stages.pipeline import Pipeline


def open_pipeline(
    scene: str, overrides: list[str] | None, no_cache: bool = False, repair: bool = False, keep_all: bool = False
) -> Pipeline:
    """Load a scene with a command's options, and make its pipeline with progress bars on the terminal."""
    loaded = load_repaired(scene, overrides or ()) if repair else load_scene(scene, overrides or ())
    return Pipeline(loaded, Cache(None) if no_cache else None, bars, keep_all)


def open_as_far_as_sound(
    scene: str, overrides: list[str] | None, no_cache: bool, repair: bool, spare: Sequence[Sequence[str]]
) -> Pipeline:
    """Open a scene as `open_pipeline` does; a fault in tables that a command can spare is told, and is no obstacle.

    Parameters
    ----------
    spare : sequence of sequence of str
        Tables of the first level to leave out, one set after the other until the rest is sound.

    Raises
    ------
    InputError
        Something that the command needs is wrong, too.
    """
    try:
        return open_pipeline(scene, overrides, no_cache, repair)
    except InputError as fault:
        for tables in () if repair else spare:
            with suppress(InputError):
                loaded = load_scene(scene, overrides or (), tables)
                print(f"fmd: left out, since this doesn't need it: {fault}", file=sys.stderr)
                return Pipeline(loaded, Cache(None) if no_cache else None, bars)
        raise


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
