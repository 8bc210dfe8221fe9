"""Text of a scene for a part from CAD, with markers on two faces and a line for each other one that has a name."""

import json
import math
import os
import re
from importlib.resources import files
from pathlib import Path
from string import Template

from fmd.core.limits.scene import LONGEST_NAME, MOST_HELD, MOST_MARKERS, SPEED, STEEL, WEIGHTS
from fmd.stages.meshing.cad_files import FaceOutline, PartOutline, choose_element_size, describe_cad_file

_NUMBERED = re.compile(r"face-\d+")


def write_cad_scene(cad: Path, target: Path) -> str:
    """Return the text of a scene for the part in a CAD file.

    Parameters
    ----------
    cad : Path
        STEP, IGES or BREP.
    target : Path
        Where the scene will lie, which its files are relative to.

    Raises
    ------
    InputError
        The CAD file can't be read.
    """
    part = describe_cad_file(cad)
    markers = _name_markers(part)
    root, tip = _choose_ends(part, markers)
    extents = [high - low for low, high in zip(part.low, part.high, strict=True)]
    length = max(extents)
    weight = part.volume * STEEL * 9.81
    pulse = _round(length / SPEED)
    name = make_name(cad.stem) or "part"
    thin = min(range(3), key=lambda a: extents[a])
    unitless = " (BREP has no unit: metres)" if cad.suffix.lower() == ".brep" else ""
    values = {
        "cad": cad.name,
        "path": json.dumps(_path_from(target.parent, cad)),
        "title": re.sub(r'["\\]', "", cad.stem),
        "body": name,
        "size": f"{1e3 * choose_element_size(part):g} mm",
        "extent": " × ".join(_write_millimetres(extent) for extent in extents) + f" mm along x, y and z{unitless}",
        "solids": _count(part.solids, "solid"),
        "faces": _count(len(part.faces), "face"),
        "markers": "\n".join(_write_markers(part, markers, root, tip)),
        "root": root,
        "tip": tip,
        "direction": str([int(a == thin) for a in range(3)]),
        "force": f"{_round(WEIGHTS * weight):g}",
        "pulse": f"{pulse:g}",
        "duration": f"{1e3 * 20 * pulse:g} ms",
        "step": f"{1e3 * pulse / 20:g} ms",
    }
    template = (files("fmd.cli.templates") / "cad.toml").read_text(encoding="utf-8")
    return Template(template).substitute(values)


def _name_markers(part: PartOutline) -> dict[str, FaceOutline]:
    """Return the faces that markers may be on, by their names: the largest if fewer than two have one."""
    named = [face for face in part.faces if not _NUMBERED.fullmatch(face.name)]
    if len(named) < 2:
        named = sorted(part.faces, key=lambda face: -face.area)[:MOST_MARKERS]
    markers: dict[str, FaceOutline] = {}
    for face in named[:MOST_MARKERS]:
        name = base = make_name(face.name) or "face"
        number = 2
        while name in markers:
            name, number = f"{base[: LONGEST_NAME - 4]}-{number}", number + 1
        markers[name] = face
    return markers


def _choose_ends(part: PartOutline, markers: dict[str, FaceOutline]) -> tuple[str, str]:
    """Choose where the part is held, and the marker that is farthest from there.

    That is its first hole, else the face with the farthest other one; a face that is most of the part would leave
    little of it to vibrate.
    """
    most = MOST_HELD * sum(face.area for face in part.faces)
    small = sorted((name for name, face in markers.items() if face.area <= most), reverse=True)  # xmin, then xmax
    small = small or list(markers)

    def farthest(root: str) -> str:
        others = [name for name in markers if name != root] or [root]
        return max(others, key=lambda name: apart(name, root))

    def apart(one: str, other: str) -> float:
        return round(math.dist(markers[one].centre, markers[other].centre), 9)

    holes = [name for name in small if re.fullmatch(r"hole-\d+", name)]
    root = min(holes) if holes else max(small, key=lambda name: apart(name, farthest(name)))
    return root, farthest(root)


def _write_markers(part: PartOutline, markers: dict[str, FaceOutline], root: str, tip: str) -> list[str]:
    """Write a line for each face: those of the root, which is rigid, and the tip as markers, others as comments.

    Each marker takes six static responses, which a face that nothing uses needn't have.
    """
    lines = []
    for name, face in sorted(markers.items(), key=lambda item: [part.zfill(9) for part in re.split(r"(\d+)", item[0])]):
        rigid, unused = ', attachment = "rigid"' * (name == root), "# " * (name not in (root, tip))
        given = json.dumps(face.name, ensure_ascii=False)
        lines.append(f"{unused}{name} = {{ face = {given}{rigid} }} # {_describe(face)}")
    taken = {face.name for face in markers.values()}
    rest = [face for face in part.faces if face.name not in taken]
    lines += [f"# {face.name}: {_describe(face)}" for face in rest[:MOST_MARKERS]]
    more = len(rest) - MOST_MARKERS
    return lines + ([f"# and {more} more, which fmd mesh lists"] if more > 0 else [])


def _describe(face: FaceOutline) -> str:
    place = ", ".join(_write_millimetres(x) for x in face.centre)
    return f"{face.kind}, {1e6 * face.area:.4g} mm², about ({place}) mm"


def _write_millimetres(length: float) -> str:
    """Write a length with four digits or to the micrometre, never with an exponent."""
    size = 1e3 * length
    return f"{size:.0f}" if abs(size) >= 1e3 else f"{round(float(f'{size:.4g}'), 3) + 0.0:g}"


def make_name(text: str) -> str:
    """Return a text as a name of a scene: a letter, then letters, digits, ``_`` and ``-``; empty if nothing is left."""
    name = re.sub(r"[^A-Za-z0-9_]+", "-", text).strip("-_")
    name = re.sub(r"^[^A-Za-z]+", "", name)[:LONGEST_NAME]
    return "" if name == "ground" else name


def _path_from(folder: Path, file: Path) -> str:
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:  # on another drive
        return file.resolve().as_posix()


def _round(value: float) -> float:
    return float(f"{value:.0e}")


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
