"""Shapes of a robot's links in pictures of its scene, and those that pictures can't have."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fmd.cli.robot import Pose, RobotLink, Shape
from fmd.core.arrays import Array
from fmd.core.limits.scene import NAMED_SHAPES
from fmd.scene.visuals import VISUAL_FILES


class ShapeWriter:
    """Writes the shapes of links as tables of a scene, and gathers what it leaves out.

    Meshes are looked for beside and above the robot's file; paths are relative to the scene's, the target.
    """

    def __init__(self, file: Path, target: Path) -> None:
        self.file, self.target = file, target
        self.left_out: dict[str, list[str]] = {}  # shapes by why
        self.by_collision: list[str] = []
        self.balls: list[str] = []

    def draw(self, link: RobotLink, place: Callable[[Shape], Pose]) -> list[dict[str, Any]]:
        """Return tables of a link's visual shapes, or of its collision geometry where pictures have none of those.

        Parameters
        ----------
        place : callable
            Gives the pose of a shape in the link's body.
        """
        for shapes in (link.visuals, link.collisions):
            drawn = [table for shape in shapes if (table := self._draw(link.name, shape, place(shape)))]
            if drawn:
                if shapes is not link.visuals and link.visuals:
                    self.by_collision.append(link.name)
                return drawn
        return []

    def list_notes(self) -> list[str]:
        """Return what differs from the file, a line for each reason."""
        notes = [f"shapes that pictures leave out, {why}: {_some(names)}" for why, names in self.left_out.items()]
        notes += [f"drawn by collision geometry: {_some(self.by_collision)}"] if self.by_collision else []
        return notes + ([f"spheres, drawn as cylinders of their sizes: {_some(self.balls)}"] if self.balls else [])

    def _draw(self, link: str, shape: Shape, pose: Pose) -> dict[str, Any] | None:
        if not all(shape.size):
            self.left_out.setdefault("of no size", []).append(f"{shape.kind} of {link}")
            return None
        if shape.kind == "box":
            size = write_lengths(np.array(shape.size))
            return {"type": "box", "size": size, "at": write_lengths(pose.at), **_rotation(pose)}
        if shape.kind in ("cylinder", "sphere"):
            radius = shape.size[0]
            half = 0.5 * shape.size[1] if shape.kind == "cylinder" else radius
            ends = [write_lengths(pose.at + sign * half * pose.axes[:, 2]) for sign in (-1, 1)]
            if shape.kind == "sphere":
                self.balls.append(link)
            return {"type": "cylinder", "start": ends[0], "end": ends[1], "radius": f"{radius:.9g} m"}
        file = self._find(shape.file) if shape.kind == "mesh" else None
        unit = {1.0: "m", 1e-3: "mm"}.get(shape.scale[0]) if len(set(shape.scale)) == 1 else None
        if shape.kind != "mesh":
            why, what = "of kinds that they don't have", f"{shape.kind} of {link}"
        elif file is None:
            why, what = "whose files aren't there", Path(shape.file).name
        elif file.suffix.lower() not in VISUAL_FILES:
            why, what = f"whose files aren't {', '.join(VISUAL_FILES)}", Path(shape.file).name
        elif unit is None:
            why, what = "whose files are scaled otherwise than to m or mm", file.name
        else:
            path = Path(os.path.relpath(file, self.target.parent)).as_posix()
            return {"type": "file", "file": path, "unit": unit, "at": write_lengths(pose.at), **_rotation(pose)}
        self.left_out.setdefault(why, []).append(what)
        return None

    def _find(self, name: str) -> Path | None:
        """Return the file of a mesh; those of packages are looked for in the folders above the robot's file."""
        inside = name.removeprefix("file://")
        places = [self.file.parent / inside]
        if name.startswith("package://"):
            package, _, inside = name.removeprefix("package://").partition("/")
            for folder in self.file.parents:
                places += [folder / package / inside, folder / inside]
        return next((place for place in places if place.is_file()), None)


def write_lengths(at: Array) -> list[str]:
    """Return lengths (n,) [m] as a scene has them."""
    return [f"{x + 0.0:.12g} m" for x in np.where(np.abs(at) < 1e-12, 0.0, at)]


def write_turn(pose: Pose) -> list[str]:
    """Return the rotation vector of a pose as a scene has it; none for a pose that isn't turned."""
    vector = Rotation.from_matrix(pose.axes).as_rotvec()
    return [f"{x + 0.0:.15g} rad" for x in vector] if np.abs(vector).max() > 1e-12 else []


def _rotation(pose: Pose) -> dict[str, Any]:
    return {"rotation": turn} if (turn := write_turn(pose)) else {}


def _some(names: Sequence[str]) -> str:
    """Return different names in their order, the first of many."""
    different = list(dict.fromkeys(names))
    more = f" and {len(different) - NAMED_SHAPES} more" if len(different) > NAMED_SHAPES else ""
    return ", ".join(different[:NAMED_SHAPES]) + more
