"""The files that a flexible body comes from: where they are, and what they hold as part of a result's identity."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.core.errors import InputError
from pipeline.scene.scene import Scene, load_scene

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pipeline.scene.any_body import Flexible


@dataclass(frozen=True)
class SourceFiles:
    """The files that a body comes from.

    Attributes
    ----------
    paths : dict of str to Path
        Where each is, by its key in the scene.
    digests : dict of str to str
        Of their contents: results are kept for what a file holds, wherever it lies.
    """

    paths: dict[str, Path]
    digests: dict[str, str]

    @property
    def path(self) -> Path:
        """The file, if there is one."""
        (path,) = self.paths.values()
        return path

    @staticmethod
    def find(shape: Flexible, scene_file: str, body: str) -> SourceFiles | None:
        """Find the files of a body that comes from such; their places are relative to the scene's.

        Raises
        ------
        InputError
            One isn't there or can't be read.
        """
        match shape.shape:
            case "mesh":
                table, names = "mesh", {"file": shape.mesh.file}
            case "cad":
                table, names = "mesh", {"cad": shape.mesh.cad}
            case "matrices":
                given = shape.matrices
                table, names = "matrices", {"stiffness": given.stiffness, "mass": given.mass, "nodes": given.nodes}
            case _:
                return None
        source = SourceFiles({key: Path(scene_file).parent / name for key, name in names.items()}, {})
        for key, path in source.paths.items():
            try:
                with path.open("rb") as stream:
                    source.digests[key] = hashlib.file_digest(stream, "blake2b").hexdigest()
            except (OSError, ValueError) as error:
                what = getattr(error, "strerror", None) or error
                mend = f"can't be read: {what}; it is looked for at {path}"
                raise InputError(scene_file, f"body.{body}.{table}.{key}", names[key], mend) from None
        return source

    def identity(self, part: dict[str, Any]) -> dict[str, Any]:
        """What a body's result depends on: the scene's values, the files' contents in place of their names."""
        table = "matrices" if "matrices" in part else "mesh"
        own = {key: value for key, value in part[table].items() if key not in self.paths}
        kinds = [path.suffix.lower() for path in self.paths.values()]
        return part | {table: own, "content": self.digests, "kinds": kinds}


def load_repaired(name_or_path: str, overrides: Sequence[str]) -> Scene:
    """Read a scene as `pipeline.load_scene` does, its bodies' meshes to be mended where that is safe.

    Raises
    ------
    InputError
        What that raises, and if no body has its mesh from a file.
    """
    read = [name for name, body in load_scene(name_or_path, overrides).flexible.items() if body.shape == "mesh"]
    if not read:
        raise InputError("--repair", "", None, "no body of the scene has its mesh from a file")
    return load_scene(name_or_path, [*overrides, *(f"body.{name}.mesh.repair=true" for name in read)])


def digest_files(scene: Scene) -> dict[str, dict[str, str]]:
    """Digests of the files that bodies come from, by body; raises what `SourceFiles.find` does."""
    found = {name: SourceFiles.find(shape, scene.file, name) for name, shape in scene.flexible.items()}
    return {name: source.digests for name, source in found.items() if source is not None}


def collect_inputs(scene: Scene) -> dict[str, Any]:
    """All of a scene that its results depend on, with what its files hold; raises what `SourceFiles.find` does."""
    inputs: dict[str, Any] = scene.model_dump(mode="json", exclude={"title", "source", "reference", "output"})
    return inputs | {"files": digest_files(scene)}
