"""Tools of `fmd mcp` for an assistant, on the scenes of a folder: load, check, run, change, look."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import tomllib
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

from fmd.accuracy.error_budget import allowed_seconds
from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, InputError
from fmd.core.files import require_finite, write_text
from fmd.output.notebook import draw_inline
from fmd.output.result_figures import result_figures
from fmd.output.stated_errors import key_figures
from fmd.output.summary import summarise_solved
from fmd.scene.scene import Scene, load_scene
from fmd.scene.toml_files import find_scene, list_ready_scenes

Tool = TypeVar("Tool", bound=Callable[..., Any])


def _quietly(tool: Tool) -> Tool:
    """Have a tool work in its folder and print to standard error: standard output belongs to the protocol."""

    @wraps(tool)
    def run(self: SceneTools, *given: Any, **named: Any) -> Any:
        with contextlib.redirect_stdout(sys.stderr), contextlib.chdir(self.folder):
            return tool(self, *given, **named)

    return cast("Tool", run)


@dataclass(frozen=True)
class SceneTools:
    """Tools on the ready scenes and on the scene files of a folder, beyond which none is named or written.

    Scenes and values that are set may name other files, of meshes and of FMUs, which run.

    Each takes a scene's name or file, and values to set in it, ``["body.beam.length=300 mm"]``; none remembers anything
    but results in the cache.
    """

    folder: Path

    @_quietly
    def scenes(self) -> dict[str, Any]:
        """List the ready scenes, and the scene files in the folder."""
        paths = [path for path in Path().rglob("*.toml") if not any(part.startswith(".") for part in path.parts)]
        return {"ready": [*list_ready_scenes()], "files": sorted(str(path) for path in paths if _is_scene(path))}

    @_quietly
    def load(self, scene: str, set: Sequence[str] = ()) -> dict[str, Any]:
        """Return a scene's text and what is in it: bodies, joints, drives, controllers, simulation, outputs."""
        loaded = self._load(scene, set)
        tables = loaded.model_dump(mode="json", exclude_defaults=True)
        return {"title": loaded.title, "text": find_scene(scene).read_text(encoding="utf-8"), "as_read": tables}

    @_quietly
    def check(self, scene: str, set: Sequence[str] = ()) -> dict[str, Any]:
        """Say whether a scene can run, or all that is wrong with it, each with its key and a remedy."""
        try:
            solved = SolvedScene(self._load(scene, set))
            if solved.scene.moves:
                solved.given.system  # noqa: B018 - meshes, modes and the mechanism have faults of their own
            else:
                for part in solved.given.wholes.values():
                    part.modes  # noqa: B018 - so have they here
        except (InputError, AccuracyError) as error:
            return {"sound": False, "faults": [*str(error).splitlines(), *getattr(error, "__notes__", ())]}
        return {"sound": True, "faults": []}

    @_quietly
    def run(
        self, scene: str, set: Sequence[str] = (), results: Sequence[str] = (), errors: bool = False
    ) -> dict[str, Any]:
        """Run a scene and return its main figures, warnings, and results by name.

        Parameters
        ----------
        scene : str
            Name or file.
        set : sequence of str
            Values to set, ``key=value``.
        results : sequence of str
            Further results: tip, BODY.stress, BODY.life, BODY.frequency.1, JOINT.force.size, BODY.MARKER.position.x,
            "OUTPUT by INPUT", or "name = formula".
        errors : bool
            Estimate the errors, which takes up to three times as long.
        """
        solved = SolvedScene(self._load(scene, set))
        if errors and solved.scene.moves:
            solved.run.motions  # noqa: B018 - what it takes is what its budget may take
        summary = summarise_solved(solved, (), errors, allowed_seconds(solved.run) if solved.scene.moves else 0.0)
        found = {
            "figures": dict(key_figures(summary)),
            "warnings": [each["text"] for each in summary.get("warnings", ())],
            "results": result_figures(solved.run, results),
            "frequencies_hz": summary.get("frequencies_hz"),
            "final": summary.get("final"),
        }
        require_finite(found)
        return found

    @_quietly
    def change(self, scene: str, file: str, set: Sequence[str]) -> dict[str, Any]:
        """Write a scene file that is another scene with some values set, checked before; return its text."""
        target = self._inside(file)
        if target.suffix != ".toml" or target.exists():
            raise InputError("file", "", file, "must be a new file that ends in .toml")
        self._load(scene, set)
        base = scene if scene in list_ready_scenes() else os.path.relpath(self._inside(scene), target.parent)
        lines = [f"base = {json.dumps(base)}", "set = [", *(f"    {json.dumps(text)}," for text in set), "]"]
        text = "\n".join(lines) + "\n"
        target.parent.mkdir(parents=True, exist_ok=True)
        write_text(target, text)
        return {"file": file, "text": text}

    @_quietly
    def picture(
        self, scene: str, type: str = "mechanism", keys: dict[str, Any] | None = None, set: Sequence[str] = ()
    ) -> bytes:
        """Draw a scene as PNG.

        Parameters
        ----------
        scene : str
            Name or file.
        type : str
            "mechanism", "stress", "mesh", "modes", "chart", "history" or another picture among a scene's outputs.
        keys : dict
            The keys of that output: {"scale": 10}, {"quantity": "tip_deflection"}, {"quantities": ["joint_reaction"]}.
        set : sequence of str
            Values to set, ``key=value``.
        """
        if own := {"type", "file", "numbers"} & {*(keys or {})}:
            raise InputError(
                "picture", "keys", sorted(own), "aren't among them; give scale, camera, quantities and such"
            )
        return draw_inline(SolvedScene(self._load(scene, set)).run, type, **(keys or {}))[0].png

    def _load(self, scene: str, set: Sequence[str]) -> Scene:
        if scene not in list_ready_scenes():
            self._inside(scene)
        return load_scene(scene, set)

    def _inside(self, file: str) -> Path:
        """Return a path; raises ``InputError`` for one beyond the folder."""
        path = (self.folder / file).resolve()
        if not path.is_relative_to(self.folder.resolve()):
            raise InputError("file", "", file, f"lies outside {self.folder}, where `fmd mcp` was started")
        return path


def _is_scene(path: Path) -> bool:
    """Return true for a TOML file with bodies or with another scene as its base."""
    try:
        return not {"body", "base"}.isdisjoint(tomllib.loads(path.read_text(encoding="utf-8")))
    except ValueError:  # no text, or no TOML
        return False


TOOLS = ("scenes", "load", "check", "run", "change", "picture")
"""Names of the tools, which are those of the functions."""
