"""``fmd new``: a scene file to start from, written where the user wants it, also for a part from CAD."""

import json
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from fmd.cli.options import Flag
from fmd.cli.tables import open_console
from fmd.core.errors import InputError
from fmd.core.files import write_text
from fmd.scene.inheritance import list_files
from fmd.scene.reading import suggest_name
from fmd.scene.schema import TITLE, write_schema
from fmd.scene.toml_files import list_ready_scenes, read_tables
from fmd.stages.meshing.cad_files import cad_suffixes, is_cad_file

SCHEMA_FILE = "scene.schema.json"
"""Name of the schema beside a new scene, which its first line names as Taplo and VS Code read it."""


def new(
    path: Path,
    *,
    from_: Annotated[str | None, Parameter(name="--from")] = None,
    flexible: tuple[str, ...] = (),
    assembly: Flag = False,
) -> None:
    """Write a commented scene to start from; a file that exists is left alone.

    Parameters
    ----------
    path
        The file to write, e.g. part.toml.
    from_
        Make it of this part, e.g. bracket.step, with a line for each face, or of this robot, e.g. arm.urdf or arm.xml
        (MJCF); or copy this ready scene, e.g. beam.
    flexible
        Links of the robot that become flexible bars by their boxes; as often as needed.
    assembly
        Make bodies of the solids of a CAD file, with the joints that their bores and pins suggest.
    """
    if assembly and not (from_ and is_cad_file(Path(from_))):
        raise InputError("--assembly", "", from_, "takes the solids of a CAD file: give one, --from machine.step")
    if flexible and not _is_robot(from_ or ""):
        raise InputError("--flexible", "", flexible[0], "names a link of a robot: give one, --from arm.urdf")
    if from_ is None:
        _write_scene(path, (files("fmd.cli.templates") / "part.toml").read_text(encoding="utf-8"))
    elif from_ in list_ready_scenes():
        _copy_ready_scene(path, from_)
    else:
        _write_scene(path, _make_scene(from_, path, flexible, assembly))
    open_console().print(f"{path} is written; fmd run {path} computes it", soft_wrap=True)


def _make_scene(part: str, path: Path, flexible: tuple[str, ...], assembly: bool) -> str:
    """Return the text of a scene for the file of a part, an assembly or a robot."""
    from fmd.cli.cad_scenes import write_cad_scene
    from fmd.cli.robot_scenes import READERS, write_assembly_scene, write_robot_scene

    _require_free(path)  # before the file is read
    file = Path(part)
    if assembly or _is_robot(part):
        text, notes = write_assembly_scene(file, path) if assembly else write_robot_scene(file, path, flexible)
        for note in notes:
            open_console().print(note if assembly else f"not in the scene: {note}", soft_wrap=True)
        return text
    if is_cad_file(file):
        return write_cad_scene(file, path)
    if file.suffix and file.is_file():
        table = f'mesh = {{ file = "{file.name}", unit = "mm" }}'
        mend = f"is no CAD file and no robot; a body has a mesh by {table}, whose faces fmd mesh {part} --unit mm names"
        raise InputError("--from", "", part, mend)
    mend = suggest_name(part, list_ready_scenes(), "the ready scenes")
    raise InputError(
        "--from",
        "",
        part,
        f"is no CAD file ({' '.join(cad_suffixes())}), no robot ({' '.join(READERS)}) and no ready scene; {mend}",
    )


def _is_robot(part: str) -> bool:
    from fmd.cli.robot_scenes import READERS

    return Path(part).suffix.lower() in READERS


def _copy_ready_scene(path: Path, name: str) -> None:
    """Write a ready scene, with the files that it reads beside it."""
    source = files("fmd.models") / f"{name}.toml"
    _write_scene(path, source.read_text(encoding="utf-8"))
    for file in list_files(read_tables(source)):
        copy = path.parent / file
        if not copy.exists():
            copy.write_bytes((files("fmd.models") / file).read_bytes())


def _write_scene(path: Path, text: str) -> None:
    """Write a scene's text to a new file, and beside it the schema by which editors complete and check it.

    Raises
    ------
    InputError
        The file exists, isn't a ``.toml``, or it or the schema can't be written.
    """
    _require_free(path)
    schema = writing = path.parent / SCHEMA_FILE
    head = f"#:schema ./{SCHEMA_FILE}\n"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if schema.exists() and not _is_schema(schema):
            head = ""
            open_console().print(f"{schema} is another's and left as it is: the scene names no schema", soft_wrap=True)
        else:
            write_text(schema, write_schema())
        writing = path
        with path.open("x", encoding="utf-8") as file:
            file.write(head + text.replace("THIS-FILE", path.name))
    except OSError as error:
        raise InputError(str(writing), "", None, f"can't be written: {error.strerror or error}") from None


def _is_schema(file: Path) -> bool:
    """Return true if a file is a schema of scenes that this command has written, perhaps that of another version."""
    try:
        return bool(json.loads(file.read_text(encoding="utf-8"))["title"] == TITLE)
    except (OSError, ValueError, LookupError, TypeError):
        return False


def _require_free(path: Path) -> None:
    if path.suffix != ".toml":
        raise InputError(str(path), "", None, f"must end in .toml, e.g. {path.stem or 'part'}.toml")
    if path.exists():
        raise InputError(str(path), "", None, "exists already and is left as it is; take another name")
