"""``fmd export``: a flexible body, or the whole mechanism, for another program."""

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from fmd.cli.inputs import DEFAULTS, Options, settle
from fmd.cli.options import SceneName, print_json
from fmd.cli.tables import print_files
from fmd.core.errors import InputError
from fmd.core.files import refusing
from fmd.output.formats import left_out, write_format
from fmd.scene.outputs import EXPORT_FORMATS, MECHANISM_FORMATS
from fmd.scene.scene import Scene

_Format = Annotated[str, Parameter(name="--to", help=f"Format: {', '.join(EXPORT_FORMATS)}.")]


def export(
    scene: SceneName,
    *,
    to: _Format,
    body: str | None = None,
    out: Path | None = None,
    options: Options = DEFAULTS,
) -> None:
    """Write a flexible body, or the whole mechanism, in the format of another program.

    Parameters
    ----------
    body
        Flexible body to write; needed if there are several.
    out
        File to write; by default in out/SCENE, under the scene's or the body's name.
    """
    if to not in EXPORT_FORMATS:
        raise InputError("--to", "", to, f"no such format; there are {', '.join(EXPORT_FORMATS)}")
    solved = options.open(scene)
    chosen = _choose_body(solved.scene, to, body)
    suffixes = EXPORT_FORMATS[to]
    path = out or Path("out") / solved.scene.name / f"{chosen or solved.scene.name}{suffixes[0]}"
    if not path.name.endswith(suffixes):
        raise InputError("--out", "", str(path), f"a file of format {to} ends in {' or '.join(suffixes)}")
    with refusing("--out", path):
        path.parent.mkdir(parents=True, exist_ok=True)
        run = settle(solved)
        files = write_format(run, to, chosen, path)
    if text := left_out(run, to, chosen):
        print(f"warning: {text}", file=sys.stderr)
    platforms = _platforms(files) if to == "fmu" else {}
    if options.json:
        print_json({"format": to, "files": [str(file) for file in files]} | platforms)
        return
    print_files(path.parent, [file.name for file in files])
    if platforms:
        print(f"binaries: {', '.join(platforms['platforms']) or 'none'}, and C sources for the others")
        if len(platforms["platforms"]) <= 1:
            print("pip install 'fmd-pipeline[fmu]' compiles for Linux, Windows and macOS on any of them")


def _platforms(files: list[Path]) -> dict[str, list[str]]:
    """Return for which systems an export has binaries."""
    from fmd.output.fmu.write import list_platforms

    return {"platforms": list_platforms(files[-1])}


def _choose_body(scene: Scene, to: str, body: str | None) -> str | None:
    """Return the name of the body that is written, or None for the whole mechanism.

    Raises
    ------
    InputError
        There is no such flexible body, or it isn't clear which is meant.
    """
    names = list(scene.flexible)
    if to in MECHANISM_FORMATS:
        if body is not None:
            raise InputError("--body", "", body, f"format {to} holds the whole mechanism; leave it out")
        return None
    if body is not None and body not in names:
        raise InputError("--body", "", body, f"no such flexible body; there are {', '.join(names) or 'none'}")
    if not names:
        raise InputError(scene.file, "body", sorted(scene.body), f"no flexible body, which format {to} holds")
    if body is None and len(names) > 1:
        raise InputError("--body", "", None, f"is missing; the flexible bodies are {', '.join(names)}")
    return body or names[0]
