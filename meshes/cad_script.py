"""Geometry as a script of Gmsh, with dimensions that a scene may set."""

import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fmd.meshes.cad_child import CadError

SUFFIX = ".geo"
# Words of Gmsh that a script may use: what makes geometry, computes or chooses. Others may run programs, read and write
# files, whose contents no key of a kept result has, or make a mesh, which is the scene's to say.
_GEOMETRY = frozenset(
    re.findall(
        r"\w+",
        """
    Abs Acos Affine Append ArcCos ArcSin ArcTan ArcTan2 Asin Atan Atan2 Ceil CombinedBoundary Boundary PointsOf Cos Cosh
    Exp Fabs Floor Fmod Hypot Log Log10 LinSpace LogSpace Max Min Modulo Pi Round Sin Sinh Sqrt Tan Tanh Unique
    For EndFor If Else ElseIf EndIf In Macro Function Return Call Sprintf Str StrCat StrCmp StrChoice
    SetFactory DefineConstant Name Label Help Units ReadOnly Visible Step SetMaxTag
    BSpline Bezier Spline Nurbs Knots Order Circle Ellipse Line Curve Point Loop Wire Plane Ruled Surface Using Volume
    Box Block Cone Cylinder Disk Rectangle Sphere Torus Wedge Extrude ThruSections ThickSolid Fillet Chamfer
    BooleanCoherence BooleanCommon BooleanCut BooleanDifference BooleanFragments BooleanFuse BooleanIntersection
    BooleanSection BooleanUnion Coherence Delete Recursive Variables Dilate Duplicata Rotate Symmetry Translate
    HealShapes Sewing Physical BoundingBox CenterOfMass Mass Parent MeshSize Characteristic Length
    """,
    )
)
# Texts, words, numbers and other signs. Gmsh ends a text that is long, and reads on in it.
_PIECES = re.compile(
    r"""("[^"\0-\x1f]{0,200}"|'[^'\0-\x1f]{0,200}')|([A-Za-z_]\w*)|[\d.]+(?:[eE][-+]?\d+)?|\S""", re.ASCII
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
    if word := _find_refused(text):
        raise CadError(
            f"{word} is refused: a script for a part holds its geometry alone, by Gmsh's commands for that; names of "
            "lists of its own begin with a small letter"
        )
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


def _find_refused(text: str) -> str | None:
    """Return the first word, if any, that is neither of geometry nor a name of the script's own, without comments.

    Gmsh's words begin with a capital, and a command that it doesn't know by its grammar is followed by its argument, or
    stands alone. A name that is followed by an operator is a number of the script's own.
    """
    before = ";"
    pieces = [*_PIECES.finditer(text)]
    for piece, following in zip(pieces, [*pieces[1:], None], strict=True):
        word, after = piece[2], following[0] if following else ";"
        is_named = before in ("For", "Macro", "Function", "Call")
        is_alone = after == ";" and before in (";", "}")
        before = piece[0]
        if before in ("'", '"'):
            return "a text without an end, or of more than 200 letters,"
        if not word or is_named or word in _GEOMETRY or (word == "Geometry" and after == "."):
            continue
        if is_alone or re.match(r"[\w.\"']", after) or (word[0].isupper() and after in "([{"):
            return word
    return None


def _keep_lines(comment: re.Match[str]) -> str:
    return " " + "\n" * comment[0].count("\n")


def _names(definitions: str) -> list[str]:
    """Return the names that a list of definitions, ``hole = 8, depth = {3, Name "Depth"}``, begins with."""
    outside = re.sub(r"\{[^}]*\}", "", definitions)
    return re.findall(r"(?:^|,)\s*([A-Za-z_]\w*)\s*=", outside)
