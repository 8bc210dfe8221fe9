"""Options that several commands share, and results as JSON."""

import json as json_format
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from fmd.core.files import require_finite

SceneName = Annotated[str, Parameter(help="Name of a ready scene, or path of a TOML file.")]
Folder = Annotated[Path | None, Parameter(help="Folder for the results; out/SCENE by default.")]
Names = Annotated[list[str], Parameter(negative=())]
Several = Annotated[list[str] | None, Parameter(negative=())]
Set = Annotated[
    list[str] | None,
    Parameter(name="--set", negative=(), help="Override a value: key=value, e.g. body.beam.length=300mm."),
]
Flag = Annotated[bool, Parameter(negative=())]
Json = Annotated[bool, Parameter(name="--json", negative=(), help="Print one JSON object and nothing else.")]
NoCache = Annotated[bool, Parameter(name="--no-cache", negative=(), help="Compute all, keep nothing.")]
Repair = Annotated[bool, Parameter(name="--repair", negative=(), help="Mend meshes from files where that is safe.")]


def print_json(result: dict[str, Any]) -> None:
    """Print one JSON object.

    Raises
    ------
    AccuracyError
        A number in it isn't finite; the message names the first.
    """
    require_finite(result)
    print(json_format.dumps(result, indent=1, allow_nan=False))
