"""Pictures, films and the figures of a summary, as a notebook shows them inline."""

import base64
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.html import facts
from fmd.output.output_kinds import kind_of, kinds_that
from fmd.output.pictures import draw_modes
from fmd.output.stated_errors import key_figures
from fmd.scene.outputs import OUTPUT_MODELS, Output
from fmd.scene.reading import join_errors, list_faults, suggest_name
from fmd.stages.pipeline import Pipeline


@dataclass(frozen=True)
class Picture:
    """A picture that a notebook shows inline."""

    png: bytes  # the file's content

    def __repr__(self) -> str:
        width, height = (int.from_bytes(self.png[at : at + 4]) for at in (16, 20))  # of the PNG's header
        return f"Picture({width} × {height} pixels, {len(self.png) / 1e3:.0f} kB)"

    def _repr_png_(self) -> bytes:
        return self.png

    def save(self, path: str | Path) -> None:
        """Write the picture to a file; raises ``OSError``."""
        Path(path).write_bytes(self.png)


@dataclass(frozen=True)
class Animation:
    """A film that a notebook plays inline."""

    mp4: bytes  # the file's content

    def __repr__(self) -> str:
        return f"Animation({len(self.mp4) / 1e3:.0f} kB)"

    def _repr_html_(self) -> str:
        content = base64.b64encode(self.mp4).decode()
        return f'<video controls loop style="max-width:100%" src="data:video/mp4;base64,{content}"></video>'

    def save(self, path: str | Path) -> None:
        """Write the film to a file; raises ``OSError``."""
        Path(path).write_bytes(self.mp4)


class Summary(dict[str, Any]):
    """Figures of a run, with the keys of ``summary.json``; a notebook shows the most wanted ones."""

    def __repr__(self) -> str:
        figures = ", ".join(f"{name} {text}" for name, text in key_figures(self))
        return f"Summary({figures}; {len(self)} keys)"

    def _repr_html_(self) -> str:
        return facts(key_figures(self), f"keys: {', '.join(self)}")


def draw_inline(run: Pipeline, type: str, numbers: Iterable[int] | None = None, **settings: Any) -> tuple[Picture, ...]:
    """Draw the pictures of an ``[[output]]`` that the scene could have, without leaving files.

    Its type is ``"chart"``, ``"history"``, ``"mesh"``, ``"modes"``, ``"mode sheet"``, ``"stress"``, ``"mechanism"`` or
    another that is a picture, ``numbers`` are those of the modes, from 1, all by default, and ``settings`` its other
    keys; ``body`` is the first flexible one by default.

    Raises
    ------
    InputError
        There is no such output, or the scene lacks what it shows.
    """
    pictures = kinds_that(lambda kind: kind.draw is not None and kind.section != "motion")
    if type not in pictures:
        raise InputError("picture", "type", type, suggest_name(type, pictures, "the pictures"))
    given = {"type": type, "file": "mode-{mode}.png" if type == "modes" else "picture.png", **settings}
    if (body := OUTPUT_MODELS[type].model_fields.get("body")) is not None and body.is_required():
        given.setdefault("body", run.part.name)
    output = read_output(given)
    with tempfile.TemporaryDirectory(prefix="fmd-") as name:
        folder = Path(name)
        files = (
            draw_modes(run, output, folder, numbers=numbers)
            if type == "modes"
            else kind_of(output).make(run, output, folder)
        )
        return tuple(Picture((folder / file).read_bytes()) for file in files)


def read_output(given: dict[str, Any]) -> Any:
    """Check the keys of an output; raise ``InputError`` with all that is wrong."""
    try:
        return TypeAdapter[Any](Output).validate_python(given)
    except ValidationError as error:
        raise join_errors(list_faults(error), given, lambda _: ("picture", None)) from None
