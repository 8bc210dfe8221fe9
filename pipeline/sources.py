"""The files that a flexible body comes from: where they are, and what they hold as part of a result's identity."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.checks import InputError

if TYPE_CHECKING:
    from pipeline.scene import Flexible, Scene


@dataclass(frozen=True)
class Source:
    """A file that a body comes from.

    Attributes
    ----------
    path : Path
        Where it is.
    digest : str
        Of its content: results are kept for what a file holds, wherever it lies.
    """

    path: Path
    digest: str

    @staticmethod
    def of(shape: Flexible, scene_file: str, body: str) -> Source | None:
        """Find the file of a body that comes from one; its place is relative to the scene's.

        Raises
        ------
        InputError
            It isn't there or can't be read.
        """
        if shape.shape != "mesh":
            return None
        path = Path(scene_file).parent / shape.mesh.file
        try:
            with path.open("rb") as stream:
                return Source(path, hashlib.file_digest(stream, "blake2b").hexdigest())
        except (OSError, ValueError) as error:
            what = getattr(error, "strerror", None) or error
            mend = f"can't be read: {what}; it is looked for at {path}"
            raise InputError(scene_file, f"body.{body}.mesh.file", shape.mesh.file, mend) from None

    def identity(self, part: dict[str, Any]) -> dict[str, Any]:
        """What a body's result depends on: the scene's values, the file's content in place of its name."""
        mesh = {key: value for key, value in part["mesh"].items() if key != "file"}
        return part | {"mesh": mesh, "content": self.digest, "suffix": self.path.suffix.lower()}


def contents(scene: Scene) -> dict[str, str]:
    """Digests of the files that bodies come from, by body; raises what `Source.of` does."""
    found = {name: Source.of(shape, scene.file, name) for name, shape in scene.flexible.items()}
    return {name: source.digest for name, source in found.items() if source is not None}
