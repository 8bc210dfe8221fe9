"""``fmd new``: a scene file to start from, written where the user wants it."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from pipeline.core.errors import InputError
from pipeline.scene.reading import list_ready_scenes, suggest_name


def new(path: Path, *, from_: Annotated[str | None, Parameter(name="--from")] = None) -> None:
    """Write a commented scene to start from; a file that exists is left alone.

    Parameters
    ----------
    path
        The file to write, e.g. part.toml.
    from_
        Copy this ready scene, e.g. beam, instead of the one made for a start.
    """
    if from_ is not None and from_ not in list_ready_scenes():
        raise InputError("--from", "", from_, suggest_name(from_, list_ready_scenes(), "the ready scenes"))
    source = files("pipeline.cli.templates") / "part.toml" if from_ is None else files("models") / f"{from_}.toml"
    _write_scene(path, source.read_text(encoding="utf-8"))
    Console(soft_wrap=True).print(f"{path} is written; fmd run {path} computes it", markup=False)


def _write_scene(path: Path, text: str) -> None:
    """Write a scene's text to a new file.

    Raises
    ------
    InputError
        The file exists, isn't a ``.toml`` or can't be written.
    """
    if path.suffix != ".toml":
        raise InputError(str(path), "", None, f"must end in .toml, e.g. {path.stem or 'part'}.toml")
    if path.exists():
        raise InputError(str(path), "", None, "exists already and is left as it is; take another name")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise InputError(str(path), "", None, f"can't be written: {error.strerror or error}") from None
