"""Geometry as a script of Gmsh, with dimensions that a scene may set."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fmd.meshes.cad_child import CadError

SUFFIX = ".geo"
# Commands that run programs, write files, or read others, whose contents no key of a kept result has.
_REFUSED = (
    "SystemCall|NonBlockingSystemCall|OnelabRun|Include|Merge|MergeWithBoundingBox|ShapeFromFile|Save|Print|Printf|"
    "CreateDir|Plugin|PostView|View|SetName|OnelabMerge|ReadTable|Sleep|Exit|Abort"
)


def run_script(gmsh: Any, path: Path, values: Mapping[str, float]) -> None:
    """Run a script in the current model, with values of its parameters in its own unit.

    Raises
    ------
    CadError
        It isn't of OpenCASCADE, has commands other than of geometry, or has no such parameter.
    """
    text = re.sub(
        r"//[^\n]*|/\*.*?\*/", _keep_lines, path.read_text(encoding="utf-8", errors="replace"), flags=re.DOTALL
    )
    if found := re.search(rf"\b({_REFUSED})\b", text):
        raise CadError(f"{found[0]} is refused: a script for a part holds its geometry alone")
    if not re.search(r'SetFactory\s*\(\s*"OpenCASCADE"\s*\)', text):
        raise CadError('must begin with SetFactory("OpenCASCADE"); other geometry of Gmsh is not read')
    defined = {name for each in re.findall(r"\bDefineConstant\s*\[([^\]]*)\]", text) for name in _names(each)}
    gmsh.parser.clear()
    for name, value in values.items():
        if name not in defined:
            known = ", ".join(sorted(defined)) or "none"
            raise CadError(f"has no parameter {name!r}, by DefineConstant[ {name} = 8 ]; it has: {known}")
        gmsh.parser.setNumber(name, [value])
    with tempfile.TemporaryDirectory(prefix="fmd-") as folder:
        copy = Path(folder) / path.name
        copy.write_text(text + "\n", encoding="utf-8")  # statements of a last line without an end would be left out
        try:
            gmsh.merge(str(copy))
        except Exception as error:  # Gmsh's own
            raise CadError(f"Gmsh can't run it: {error}".replace(f"'{copy}', ", "")) from error
    gmsh.model.occ.synchronize()
    for name, value in values.items():
        if list(gmsh.parser.getNumber(name)) != [value]:
            raise CadError(f"sets the parameter {name!r} to another value itself")
    gmsh.model.mesh.clear()


def _keep_lines(comment: re.Match[str]) -> str:
    return " " + "\n" * comment[0].count("\n")


def _names(definitions: str) -> list[str]:
    """Return the names that a list of definitions, ``hole = 8, depth = {3, Name "Depth"}``, begins with."""
    outside = re.sub(r"\{[^}]*\}", "", definitions)
    return re.findall(r"(?:^|,)\s*([A-Za-z_]\w*)\s*=", outside)
