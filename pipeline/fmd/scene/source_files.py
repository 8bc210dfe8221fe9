"""Files that flexible bodies come from, and their contents as part of a result's identity."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError, as_input_error
from fmd.core.files import digest_file
from fmd.scene.any_body import Flexible
from fmd.scene.controllers import FmuController
from fmd.scene.scene import Scene, load_scene


@dataclass(frozen=True)
class SourceFiles:
    """The files that one flexible body comes from."""

    # Path of each file by its key in the scene; of a geometric stiffness with ``*`` those of all its files by
    # ``key/name``.
    paths: dict[str, Path]
    digests: dict[str, str]  # digest of each file's content; results are kept by content, wherever the file lies

    @property
    def path(self) -> Path:
        """Path of the file, for a body that has only one."""
        (path,) = self.paths.values()
        return path

    @staticmethod
    def find(shape: Flexible, scene_file: str, body: str) -> SourceFiles | None:
        """Find the files of a body, relative to the scene's file; ``None`` if the body comes from no file.

        Raises
        ------
        InputError
            A file isn't there or can't be read.
        """
        if not shape.file_keys:
            return None
        table, *keys = shape.file_keys
        given = {key: getattr(getattr(shape, table), key) for key in keys}
        paths, digests = dict[str, Path](), dict[str, str]()
        for key, name in given.items():
            if name is None:
                continue
            with as_input_error(scene_file, f"body.{body}.{table}.{key}", name):
                found = _expand(key, Path(scene_file).parent / str(name))
                digests |= {own: digest_file(path) for own, path in found.items()}
            paths |= found
        return SourceFiles(paths, digests)

    def all_of(self, key: str) -> list[Path]:
        """Return the paths of a key, several if its name has a ``*``, none if it isn't given."""
        return [path for own, path in self.paths.items() if own.partition("/")[0] == key]

    def identity(self, part: dict[str, Any]) -> dict[str, Any]:
        """Return a body's table with the files' contents in place of their names, for hashing."""
        table = next(key for key in ("matrices", "body", "mesh") if key in part)
        named = {key.partition("/")[0] for key in self.paths}
        own = {key: value for key, value in part[table].items() if key not in named}
        kinds = [path.suffix.lower() for path in self.paths.values()]
        return part | {table: own, "content": self.digests, "kinds": kinds}


def _expand(key: str, path: Path) -> dict[str, Path]:
    """Return the file of a name by its key; of a geometric stiffness with ``*`` all, by key and name, in order."""
    if key != "geometric_stiffness" or "*" not in path.name:
        return {key: path}
    found = {f"{key}/{own.name}": own for own in sorted(path.parent.glob(path.name))}
    if not found:
        raise ValueError("no file has such a name")
    return found


def load_repaired(name_or_path: str, overrides: Sequence[str]) -> Scene:
    """Read a scene as `load_scene` does, with repair of the meshes that come from files.

    Raises
    ------
    InputError
        As `load_scene`, or no body has its mesh from a file.
    """
    read = [name for name, body in load_scene(name_or_path, overrides).flexible.items() if body.shape == "mesh"]
    if not read:
        raise InputError("--repair", "", None, "no body of the scene has its mesh from a file")
    return load_scene(name_or_path, [*overrides, *(f"body.{name}.mesh.repair=true" for name in read)])


def named_files(scene: Scene) -> list[Path]:
    """Return the scene's own file, and those that a value of it names, but for its outputs."""

    def texts(value: Any) -> Iterator[str]:
        if isinstance(value, str):
            yield value
        for item in value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ():
            yield from texts(item)

    own, found = Path(scene.file), list[Path]()
    for text in (own.name, *texts(scene.model_dump(exclude={"output"}))):
        with suppress(ValueError, OSError):  # of a text that can't be a file's name
            found += [own.parent / text] if (own.parent / text).is_file() else []
    return found


def digest_files(scene: Scene) -> dict[str, dict[str, str]]:
    """Return the digests of the files that bodies and FMUs come from; raises `SourceFiles.find`'s errors."""
    found = {name: SourceFiles.find(shape, scene.file, name) for name, shape in scene.flexible.items()}
    digests = {name: source.digests for name, source in found.items() if source is not None}
    for name, controller in scene.controller.items():
        if isinstance(controller, FmuController):
            with suppress(ValueError):  # a missing file is named where it is read
                digests[f"controller {name}"] = {"file": digest_file(Path(scene.file).parent / controller.file)}
    return digests


def collect_inputs(scene: Scene) -> dict[str, Any]:
    """Return all values of a scene that its results depend on, with its files' digests, for hashing.

    Raises
    ------
    InputError
        A file isn't there or can't be read.
    """
    shown_only: Any = {
        "title": True,
        "source": True,
        "reference": True,
        "output": True,
        "fit": True,
        "body": {"__all__": {"visual"}},
    }
    inputs: dict[str, Any] = scene.model_dump(mode="json", exclude=shown_only)
    return inputs | {"files": digest_files(scene)}
