"""A mechanism from an assembly in a CAD file: its solids as rigid bodies, and joints that bores and pins suggest."""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fmd.cli.robot import Pose, Robot, RobotJoint, RobotLink, Shape
from fmd.core.arrays import Array
from fmd.core.limits.scene import BORE_CLEARANCE, COAXIAL, STEEL
from fmd.stages.meshing.cad_files import AssemblyPart, describe_assembly_file

if TYPE_CHECKING:
    from fmd.meshes.cad_places import WholeCylinder


class Suggestion(NamedTuple):
    """A joint of two parts that round faces on one axis suggest: a hinge, or fixed by several axes."""

    kind: str
    parts: tuple[str, str]
    place: Array
    axis: Array
    why: str


def read_assembly(file: Path, folder: Path) -> Robot:
    """Read an assembly, whose largest part stands on the ground.

    A hinge is suggested where a pin of one part is in a bore of another, or two bores are side by side on one axis;
    where two parts share several axes they are fixed together. Of parts that no suggestion joins to the largest, the
    largest of each group is fixed to the ground.

    Parameters
    ----------
    file : Path
        STEP, IGES or BREP.
    folder : Path
        Where a STEP file of each part is written, for pictures and for parts that become flexible.

    Raises
    ------
    InputError
        The file can't be read, or has one solid.
    """
    parts = {part.name: part for part in describe_assembly_file(file, folder)}
    by_size = sorted(parts, key=lambda name: -parts[name].volume)
    root = by_size[0]
    suggested = [found for pair in combinations(parts.values(), 2) if (found := suggest_joint(*pair))]
    suggested.sort(key=lambda found: "pin" not in found.why)
    notes = [f"{root} is the largest part: it stands on the ground", *_of_materials(file)]
    joints, places, moves_with = {}, {root: np.zeros(3)}, {root: root}
    while len(places) < len(parts):
        at = next((found for found in suggested if len(places.keys() & set(found.parts)) == 1), None)
        if at is None:
            alone = next(name for name in by_size if name not in places)
            at = Suggestion("fixed", (root, alone), np.zeros(3), np.eye(3)[2], "")
            notes.append(
                f"{alone} shares no axis with {root} or what hangs on it: fixed to the ground, give it a joint"
            )
        else:
            suggested.remove(at)
        parent, child = at.parts if at.parts[0] in places else at.parts[::-1]
        if at.why:
            notes.append(f"suggested, to be confirmed: {child} on {parent} by {at.why}")
        joints[f"{parent}-{child}"] = RobotJoint(
            f"{parent}-{child}", at.kind, parent, child, Pose(at.place - places[parent]), at.axis, {}
        )
        places[child], moves_with[child] = at.place, moves_with[parent] if at.kind == "fixed" else child
    for found in suggested:
        one, other = found.parts
        if moves_with[one] != moves_with[other]:
            notes.append(f"suggested, not in the scene: {one} on {other} by {found.why}; as in docs/loops.md")
    links = {name: _link(part, places[name], folder) for name, part in parts.items()}
    return Robot(file.stem, links, joints, root, tuple(notes))


def suggest_joint(one: AssemblyPart, other: AssemblyPart) -> Suggestion | None:
    """Return the joint that the round faces of two parts suggest; ``None`` if none are on one axis."""
    shared = [(a, b, at) for a in one.round_faces for b in other.round_faces if (at := _shared_place(a, b)) is not None]
    if not shared:
        return None
    first, second, place = shared[0]
    axis = first.axis * np.sign(first.axis[np.abs(first.axis).argmax()])
    others = sum(_off_axis(first, at) > first.radius for _, _, at in shared)
    where = ", ".join(f"{round(1e3 * x, 3) + 0.0:g}" for x in place)
    why = f"{'two bores' if first.what == second.what else 'a pin in a bore'} at ({where}) mm"
    if others:
        why += f", fixed by {others} more beside it"
    return Suggestion("fixed" if others else "revolute", (one.name, other.name), place, axis, why)


def _shared_place(a: WholeCylinder, b: WholeCylinder) -> Array | None:
    """Return the middle of what two round faces share of one axis; ``None`` if they aren't a bearing."""
    if a.what == b.what == "pin" or np.linalg.norm(np.cross(a.axis, b.axis)) > COAXIAL:
        return None
    apart = b.middle - a.middle
    along = float(apart @ a.axis)
    smaller, larger = sorted((a.radius, b.radius))
    if _off_axis(a, b.middle) > COAXIAL * larger or larger - smaller > BORE_CLEARANCE * larger:
        return None
    low, high = max(-0.5 * a.length, along - 0.5 * b.length), min(0.5 * a.length, along + 0.5 * b.length)
    gap = COAXIAL * larger if a.what == b.what else 0.0  # of bores side by side
    return None if low > high + gap else a.middle + 0.5 * (low + high) * a.axis


def _off_axis(face: WholeCylinder, place: Array) -> float:
    return float(np.linalg.norm(np.cross(face.axis, place - face.middle)))


def _link(part: AssemblyPart, origin: Array, folder: Path) -> RobotLink:
    shape = Shape("mesh", Pose(-origin), file=str(folder / f"{part.name}.step"))
    return RobotLink(part.name, STEEL * part.volume, part.centre - origin, STEEL * part.inertia, (shape,))


def _of_materials(file: Path) -> list[str]:
    text = file.read_text(encoding="utf-8", errors="replace") if file.suffix.lower() in (".step", ".stp") else ""
    found = sorted(set(re.findall(r"MATERIAL_DESIGNATION\s*\(\s*'([^']+)'", text)))
    named = f"the file's materials ({', '.join(found)}) aren't read" if found else "materials aren't read"
    return [f"{named}: masses are those of steel, {STEEL:g} kg/m^3"]
