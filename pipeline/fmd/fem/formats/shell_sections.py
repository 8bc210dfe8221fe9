"""Thickness, offset and layers of the shells of a deck, by element, and what of its sections isn't read."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.fortran import read_field, read_real
from fmd.fem.formats.raw_mesh import BlockShells, MeshFileError, ShellSection, at_all_nodes
from fmd.fem.midsurface import DeckPly

_ALONG_X = np.array([1.0, 0.0, 0.0])
_NO_SECTION = ShellSection(np.nan)


@dataclass
class NastranShells:
    """Sections of Nastran's shells, as their cards come."""

    sections: dict[str, ShellSection] = field(default_factory=dict)
    offsets: dict[str, list[float]] = field(default_factory=dict)
    turns: dict[str, list[str]] = field(default_factory=dict)
    nodal: dict[str, dict[int, list[str]]] = field(default_factory=dict)  # TFLAG, T1, T2 … of elements that have them
    faults: list[str] = field(default_factory=list)

    def takes(self, name: str, fields: list[str]) -> bool:
        """Take the card of a shell's property; return False for another."""
        if name == "PSHELL":
            of = f"PSHELL {fields[0]}"
            t, bending, shear, mass = (fields[k] if len(fields) > k else "" for k in (2, 4, 6, 7))
            if not t:
                self.faults.append(f"{of} has no thickness")
                return True
            others = {"12I/T**3": (bending, 1.0), "TS/T": (shear, 5 / 6), "NSM": (mass, 0.0)}  # homogeneous
            for what, (given, usual) in others.items():
                if given and abs(read_field(given) - usual) > 1e-3:
                    self.faults.append(f"{of} has {what} = {given}")
            if len(fields) <= 3 or fields[3] != fields[1]:
                self.faults.append(f"{of} bends by another material than it stretches by, MID2")
            self.sections[fields[0]] = ShellSection(read_field(t))
            return True
        if name == "PCOMP":
            self.sections[fields[0]] = _composite(fields, self.faults)
            return True
        if name in ("PCOMPG", "PCOMPP", "PSHEAR", "SNORM"):  # the last: a normal at a grid point
            self.faults.append(f"{name} {fields[0]}")
            return True
        return False

    def add(self, kind: str, n_local: int, fields: list[str]) -> None:
        """Take an element's offset, THETA or MCID, and thicknesses from its card, which has room for n_local nodes."""
        # Fields of THETA, before ZOFFS, and of TFLAG.
        turn, flag = {6: (8, 13), 8: (14, 16)}.get(n_local, (2 + n_local, 9))
        fields = fields + [""] * 17
        self.turns.setdefault(kind, []).append(fields[turn])
        self.offsets.setdefault(kind, []).append(read_field(fields[turn + 1]))
        t = fields[10 : 10 + _corners(n_local)]
        if any(t):
            self.nodal.setdefault(kind, {})[len(self.offsets[kind]) - 1] = [fields[flag], *t]

    @property
    def stacks(self) -> list[tuple[DeckPly, ...]]:
        """Layers of all sections."""
        return [section.plies for section in self.sections.values()]

    def of_blocks(
        self,
        properties: Mapping[str, list[str]],
        blocks: Sequence[tuple[str, IntArray]],
        points: Array,
        axes: Callable[[str], Array | None],
    ) -> list[BlockShells]:
        """Return the sections of the elements of each block, by systems' axes (3, 3), ``None`` if these bend."""
        place = {name: k for k, name in enumerate(self.sections)}
        found = []
        for (kind, own), (_, cells) in zip(properties.items(), blocks, strict=True):
            sections = [self.sections.get(p, _NO_SECTION) for p in own]
            t = np.repeat([[section.thickness] for section in sections], cells.shape[1], axis=1)
            for number, (flag, *given) in self.nodal.get(kind, {}).items():
                section = sections[number]
                if section.plies:
                    self.faults.append(f"PCOMP {own[number]} is of elements with thicknesses of their own")
                unit = section.thickness if flag == "1" else 1.0
                at_corners = np.array([unit * read_field(each) if each else section.thickness for each in given])
                t[number] = at_all_nodes(at_corners, t.shape[1])
            offset = np.array(self.offsets.get(kind, [0.0] * len(own))) + [section.offset for section in sections]
            stack = np.array([place[p] if section.plies else -1 for p, section in zip(own, sections, strict=True)])
            direction = np.tile(_ALONG_X, (len(own), 1))
            for k in np.flatnonzero(stack >= 0):
                direction[k] = self._direction(self.turns[kind][k], points[cells[k][: _corners(cells.shape[1])]], axes)
            found.append(BlockShells(t, offset, stack.astype(np.int64), direction))
        return found

    def _direction(self, turn: str, x: Array, axes: Callable[[str], Array | None]) -> Array:
        """Return a vector along an element's material axis: its first side turned by THETA, or the x axis of MCID."""
        if turn.isdigit():
            system = axes(turn)
            if system is None:
                self.faults.append(f"layers along a round system, MCID {turn}")
            return _ALONG_X if system is None else system[:, 0]
        side = x[1] - x[0]
        normal = np.cross(side if len(x) == 3 else x[2] - x[0], x[-1] - x[len(x) - 3])
        side, normal = side / np.linalg.norm(side), normal / np.linalg.norm(normal)
        angle = np.radians(read_field(turn))
        return np.asarray(np.cos(angle) * side + np.sin(angle) * np.cross(normal, side))


def _corners(n_local: int) -> int:
    """Return the number of corners of a shell by that of its nodes."""
    return n_local if n_local < 6 else n_local // 2


def _composite(fields: list[str], faults: list[str]) -> ShellSection:
    """Return the section of a PCOMP, whose plies are four fields each from the tenth on."""
    of = f"PCOMP {fields[0]}"
    given = (fields + [""] * 8)[:8]
    if read_field(given[2]):
        faults.append(f"{of} has NSM = {given[2]}")
    if given[7] not in ("", "SYM"):
        faults.append(f"{of} has LAM = {given[7]}")
    plies: list[DeckPly] = []
    name, t = "", 0.0
    for k in range(8, len(fields), 4):
        own = (fields[k : k + 4] + [""] * 4)[:4]
        if not any(own):
            continue
        name, t = own[0] or name, read_field(own[1]) if own[1] else t
        plies.append((name, t, float(np.radians(read_field(own[2])))))
    if given[7] == "SYM":
        plies += reversed(plies)
    whole = sum(ply[1] for ply in plies)
    offset = read_field(given[1]) + whole / 2 if given[1] else 0.0
    return ShellSection(whole or np.nan, offset, plies=tuple(plies))


def orientation_direction(options: Mapping[str, str], data: list[list[str]]) -> Array | str:
    """Return the vector along local direction 1 of shells by Abaqus' ``*ORIENTATION``, or why it isn't read."""
    if options.get("SYSTEM", "RECTANGULAR").upper() != "RECTANGULAR" or "DEFINITION" in options:
        return "a system that isn't rectangular, or isn't by coordinates"
    try:
        numbers = [[read_real(item) if item else 0.0 for item in row] for row in data[:2]]
    except ValueError as error:  # no fault of a deck whose shells don't name it
        return f"which isn't by numbers: {error}"
    axis, angle = (numbers[1] + [0.0, 0.0])[:2] if len(numbers) > 1 else (1.0, 0.0)
    if angle or len(numbers) < 1 or len(numbers[0]) < 6:
        return "a turn about an axis, or no two points"
    a, b, c = (np.array((numbers[0] + [0.0] * 3)[k : k + 3]) for k in (0, 3, 6))
    x, z = a - c, np.cross(a - c, b - c)
    axes = np.stack([x, np.cross(z, x), z])
    return np.asarray(axes[int(axis or 1) % 3])


def abaqus_section(
    options: Mapping[str, str], data: list[list[str]], directions: Mapping[str, Array | str]
) -> ShellSection:
    """Return the section of Abaqus' ``*SHELL SECTION``; orientations above it are by their names in small letters.

    Raises
    ------
    MeshFileError
        Its thickness isn't one number for the whole of a layer.
    """
    name = options.get("ELSET", "")
    of = f"*SHELL SECTION of {name} with"
    for word in ("SHELL THICKNESS", "STACK DIRECTION"):
        if word in options:
            return ShellSection(np.nan, fault=f"{of} {word}")
    if "NODAL THICKNESS" in options:
        other = next((f"{of} NODAL THICKNESS and {word}" for word in ("COMPOSITE", "OFFSET") if word in options), "")
        return ShellSection(np.nan, fault=other, nodal=True)
    if not data or not data[0][0]:
        raise MeshFileError(f"*SHELL SECTION of {name} has no thickness")
    plies: list[DeckPly] = []
    direction: Array | str = _ALONG_X
    if "COMPOSITE" in options:
        for row in data:
            t, _, material, angle = (row + [""] * 4)[:4]
            if angle and not angle.lstrip("+-").replace(".", "", 1).isdigit():
                return ShellSection(np.nan, fault=f"{of} a layer along orientation {angle}; its angle is read")
            plies.append((material, read_real(t), float(np.radians(read_real(angle or "0")))))
        plies += reversed(plies) if "SYMMETRIC" in options else []
        if "ORIENTATION" in options:
            direction = directions.get(options["ORIENTATION"].casefold(), "no *ORIENTATION above it")
            if isinstance(direction, str):
                return ShellSection(np.nan, fault=f"{of} ORIENTATION = {options['ORIENTATION']}, {direction}")
    thickness = sum(ply[1] for ply in plies) if plies else read_real(data[0][0])
    given = options.get("OFFSET", "0").upper()
    words = {"SPOS": 0.5, "SNEG": -0.5}
    try:
        share = words[given] if given in words else float(given)
    except ValueError:
        raise MeshFileError(
            f"*SHELL SECTION of {name} with OFFSET = {given}, which is neither a share nor SPOS or SNEG"
        ) from None
    offset = -share * thickness  # of the nodes from the middle, over the thickness
    x, y, z = (float(each) for each in direction)
    return ShellSection(thickness, offset, plies=tuple(plies), direction=(x, y, z))


def of_sets(
    sections: Mapping[str, ShellSection],
    cell_sets: Mapping[str, list[IntArray]],
    blocks: Sequence[tuple[str, IntArray]],
    nodal: Array,
) -> list[BlockShells]:
    """Return the sections of the elements of each block from those of sets, and from thicknesses of points."""
    sizes = [(len(own), own.shape[1]) for _, own in blocks]
    found = [
        BlockShells(np.full((n, m), np.nan), np.zeros(n), np.full(n, -1), np.tile(_ALONG_X, (n, 1))) for n, m in sizes
    ]
    for k, (name, section) in enumerate(sections.items()):
        for block, cells, (_, own) in zip(found, cell_sets.get(name, []), blocks, strict=False):
            block.thickness[cells] = nodal[own[cells]] if section.nodal else section.thickness
            block.offset[cells] = section.offset
            block.stack[cells], block.direction[cells] = k if section.plies else -1, section.direction
    return found
