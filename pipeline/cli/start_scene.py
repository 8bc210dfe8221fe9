"""A scene file to start from, written where the user wants it."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from pipeline.core.errors import InputError
from pipeline.scene.reading import list_ready_scenes, suggest_name


def start_scene(path: Path, ready: str | None = None) -> None:
    """Write a commented scene: one made for a start, or a copy of a ready one.

    Raises
    ------
    InputError
        The file exists, isn't a ``.toml`` or can't be written, or there is no such ready scene.
    """
    if ready is not None and ready not in list_ready_scenes():
        raise InputError("--from", "", ready, suggest_name(ready, list_ready_scenes(), "the ready scenes"))
    source = files("pipeline.cli.templates") / "part.toml" if ready is None else files("models") / f"{ready}.toml"
    if path.suffix != ".toml":
        raise InputError(str(path), "", None, f"must end in .toml, e.g. {path.stem or 'part'}.toml")
    if path.exists():
        raise InputError(str(path), "", None, "exists already and is left as it is; take another name")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as file:
            file.write(source.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(str(path), "", None, f"can't be written: {error.strerror or error}") from None
