"""What commands have in common: options, a scene's pipeline, and results as text."""

from __future__ import annotations

import json as json_format
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

if TYPE_CHECKING:
    from pipeline.stages.pipeline import Pipeline

SceneName = Annotated[str, Parameter(help="Name of a ready scene, or path of a TOML file.")]
Set = Annotated[
    list[str] | None,
    Parameter(name="--set", negative=(), help="Override a value: key=value, e.g. body.beam.length=300mm."),
]
Json = Annotated[bool, Parameter(name="--json", negative=(), help="Print one JSON object and nothing else.")]
NoCache = Annotated[bool, Parameter(name="--no-cache", negative=(), help="Compute all, keep nothing.")]
Repair = Annotated[bool, Parameter(name="--repair", negative=(), help="Mend meshes from files where that is safe.")]


def open_pipeline(
    scene: str, overrides: list[str] | None, no_cache: bool, repair: bool = False, keep_all: bool = False
) -> Pipeline:
    """Open a scene as a command's options want it, with progress on the terminal."""
    from pipeline.core.cache import Cache
    from pipeline.core.progress import bars
    from pipeline.scene.scene import load_scene
    from pipeline.scene.source_files import load_repaired
    from pipeline.stages.pipeline import Pipeline

    loaded = load_repaired(scene, overrides or ()) if repair else load_scene(scene, overrides or ())
    return Pipeline(loaded, Cache(None) if no_cache else None, bars, keep_all)


def rate_of(option: str, text: str) -> float:
    """Read an angular rate from the command line [rad/s]."""
    from pipeline.core.errors import InputError
    from pipeline.core.units import to_si

    try:
        return to_si(text, "angular rate")
    except ValueError as error:
        raise InputError(option, "", text, str(error)) from None


def print_figures(result: dict[str, Any], json: bool) -> None:
    """Print figures line by line, or as JSON."""
    if json:
        print_json(result)
        return
    for key, value in result.items():
        print(f"{key.replace('_', ' '):15s} {value}")


def print_json(result: dict[str, Any]) -> None:
    """Print one JSON object."""
    print(json_format.dumps(result, indent=1, allow_nan=False))
