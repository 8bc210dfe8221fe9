"""Runs in a notebook: a scene in a few lines, its pictures inline."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter, ValidationError

from pipeline.accuracy.error_budget import Budget, state_errors
from pipeline.core.errors import InputError
from pipeline.core.progress import bars
from pipeline.output.pictures import DRAWINGS, draw_modes
from pipeline.scene.outputs import Output
from pipeline.scene.reading import suggest_name
from pipeline.scene.scene import load_scene
from pipeline.stages.pipeline import Pipeline

if TYPE_CHECKING:
    from pipeline.stages.linear_model import LinearModel

_PICTURES = ("chart", "mesh", "modes", "mode sheet", "stress")


@dataclass(frozen=True)
class Picture:
    """A picture that a notebook shows inline.

    Parameters
    ----------
    png : bytes
        The file's content.
    """

    png: bytes

    def _repr_png_(self) -> bytes:
        return self.png

    def save(self, path: str | Path) -> None:
        """Write the picture to a file; raises ``OSError``."""
        Path(path).write_bytes(self.png)


class NotebookRun(Pipeline):
    """A pipeline whose pictures and error budget are at hand in a notebook."""

    @property
    def budget(self) -> Budget:
        """Error budget of the scene's first run."""
        return state_errors(self)

    def linearise(self, inputs: Sequence[str], outputs: Sequence[str], about: str = "start") -> LinearModel:
        """Linearise the scene about a state, with inputs and outputs by the names that docs/responses.md lists.

        Raises
        ------
        InputError, AccuracyError
            As `pipeline.stages.linear_model.linearise_scene`.
        """
        from pipeline.stages.linear_model import linearise_scene

        return linearise_scene(self, inputs, outputs, about)

    def picture(self, type: str, mode: int = 1, **settings: Any) -> Picture:
        """Draw the picture of an ``[[output]]`` of this type, to be shown inline: ``picture("stress", scale=10)``.

        Parameters
        ----------
        type : str
            ``"chart"``, ``"mesh"``, ``"modes"``, ``"mode sheet"`` or ``"stress"``.
        mode : int
            Number of the mode, from 1.
        settings
            The output's other keys; ``body`` is the first flexible one by default.

        Raises
        ------
        InputError
            There is no such output or mode, or the scene lacks what it shows.
        """
        drawn = draw_inline(self, type, [mode], **settings)
        if not drawn:
            raise InputError("picture", "mode", mode, f"must be 1 … {len(self.modes.omega)}")
        return drawn[0]


def load(scene: str | Path, *overrides: str) -> NotebookRun:
    """Load a scene, ready to be computed: ``load("beam", "body.beam.length=300mm")``.

    Parameters
    ----------
    scene : str or Path
        A ready scene's name or the path of a TOML file.
    overrides : str
        As for ``--set``.

    Raises
    ------
    InputError
        As `pipeline.load_scene`.
    """
    return NotebookRun(load_scene(scene, overrides), monitor=bars)


def draw_inline(run: Pipeline, type: str, numbers: Iterable[int] | None = None, **settings: Any) -> tuple[Picture, ...]:
    """Draw the pictures of an ``[[output]]`` that the scene could have, without leaving files.

    Parameters
    ----------
    type : str
        ``"chart"``, ``"mesh"``, ``"modes"``, ``"mode sheet"`` or ``"stress"``.
    numbers : iterable of int, optional
        Numbers of the modes, from 1; all by default.
    settings
        The output's other keys; ``body`` is the first flexible one by default.

    Raises
    ------
    InputError
        There is no such output, or the scene lacks what it shows.
    """
    if type not in _PICTURES:
        raise InputError("picture", "type", type, suggest_name(type, _PICTURES, "the pictures"))
    given = {"type": type, "file": "mode-{mode}.png" if type == "modes" else "picture.png", **settings}
    if type != "chart":
        given.setdefault("body", run.part.name)
    try:
        output = TypeAdapter[Any](Output).validate_python(given)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"] if part != type)
        mend = first["msg"].removeprefix("Value error, ")
        raise InputError("picture", key, given.get(key), mend) from None
    with tempfile.TemporaryDirectory(prefix="fmd-") as name:
        folder = Path(name)
        files = (
            draw_modes(run, output, folder, numbers=numbers)
            if type == "modes"
            else DRAWINGS[output.type].draw(run, output, folder)
        )
        return tuple(Picture((folder / file).read_bytes()) for file in files)
