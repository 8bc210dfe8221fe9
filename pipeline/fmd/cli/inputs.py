"""Values given to commands: a scene with its overrides, an angular rate."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress

from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.cache import Cache
from fmd.core.errors import InputError
from fmd.core.progress import bars
from fmd.core.units import to_si
from fmd.scene.scene import load_scene
from fmd.scene.source_files import load_repaired
from fmd.stages.pipeline import Pipeline


def open_scene(
    scene: str, overrides: list[str] | None, no_cache: bool = False, repair: bool = False, keep_all: bool = False
) -> SolvedScene:
    """Load a scene with a command's options, to be solved with progress bars on the terminal."""
    loaded = load_repaired(scene, overrides or ()) if repair else load_scene(scene, overrides or ())
    return SolvedScene(loaded, Cache(None) if no_cache else None, bars, keep_all)


def solve_scene(scene: str, overrides: list[str] | None, no_cache: bool = False) -> Pipeline:
    """Return the stages of a scene as it is computed; an accuracy that isn't met is told on standard error."""
    return settle(open_scene(scene, overrides, no_cache))


def settle(solved: SolvedScene) -> Pipeline:
    """Return the stages of a solved, for commands that print no summary; tells of an accuracy that isn't met."""
    if solved.settings.unmet:
        print(f"warning: {solved.settings.unmet}", file=sys.stderr)
    return solved.run


def solve_as_far_as_sound(
    scene: str, overrides: list[str] | None, no_cache: bool, repair: bool, spare: Sequence[Sequence[str]]
) -> Pipeline:
    """Solve a scene as `solve_scene` does; a fault in tables that a command can spare is told, and is no obstacle.

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
        solved = open_scene(scene, overrides, no_cache, repair)
    except InputError as fault:
        for tables in () if repair else spare:
            with suppress(InputError):
                loaded = load_scene(scene, overrides or (), tables)
                print(f"fmd: left out, since this doesn't need it: {fault}", file=sys.stderr)
                solved = SolvedScene(loaded, Cache(None) if no_cache else None, bars)
                break
        else:
            raise
    return settle(solved)


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
