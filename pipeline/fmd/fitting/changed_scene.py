"""Scene files that are another scene with other numbers."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from fmd.core.errors import AccuracyError
from fmd.core.files import write_text
from fmd.core.limits.round_off import SOLVED
from fmd.fitting.parameters import Parameter, change_parameters, find_parameter, list_settings
from fmd.scene.bodies import Deformable
from fmd.scene.scene import Scene, load_scene
from fmd.scene.toml_files import list_ready_scenes


def write_changed_scene(
    scene: Scene,
    values: Mapping[Parameter, float],
    path: Path,
    given: str,
    comments: Sequence[str],
    overrides: Sequence[str] = (),
) -> None:
    """Write a scene that is the given one with other numbers [SI], and check that it reads back so.

    Comments are its first lines, which say from what the numbers came; overrides are values ``key=value`` that were
    used instead of the scene's own.

    Raises
    ------
    OSError
        The file can't be written.
    AccuracyError
        A number reads back as another one.
    """
    base = given if given in list_ready_scenes() else os.path.relpath(given, path.parent)
    settings = [text for parameter, value in values.items() for text in list_settings(scene, parameter, value)]
    settings += _list_kept_elements(scene, change_parameters(scene, values))
    lines = [*(f"# {text}" for text in comments), "", f"base = {json.dumps(base)}", "set = ["]
    lines += [f"    {json.dumps(text)}," for text in [*overrides, *settings]]
    write_text(path, "\n".join([*lines, "]"]) + "\n")
    again = load_scene(path)
    for parameter, value in values.items():
        found = find_parameter(again, parameter.key)
        if not parameter.is_factor and not abs(found.value - value) <= SOLVED * abs(value):
            raise AccuracyError(f"{path}: {parameter.key} reads back as {found.value!r}, not {value!r}")


def _list_kept_elements(scene: Scene, changed: Scene) -> list[str]:
    """Return what sets at which dimensions bodies were meshed, of those that keep the elements of another scene."""
    bodies = {name: body for name, body in changed.body.items() if isinstance(body, Deformable)}
    kept = {name: body.kept_elements for name, body in bodies.items() if body != scene.body[name]}
    return [f"body.{name}.{text}" for name, text in kept.items() if text]
