"""Thickness and offset of the shells of a deck, by element, and what of its sections isn't read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.fortran import read_field, read_real
from fmd.fem.formats.raw_mesh import MeshFileError, ShellSection


@dataclass
class NastranShells:
    """Sections of Nastran's shells, as their cards come."""

    sections: dict[str, ShellSection] = field(default_factory=dict)
    offsets: dict[str, list[float]] = field(default_factory=dict)
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
        if name in ("PCOMP", "PCOMPG", "PCOMPP", "PSHEAR"):
            self.faults.append(f"{name} {fields[0]}")
            return True
        return False

    def add(self, kind: str, n_local: int, fields: list[str]) -> None:
        """Take the offset of an element."""
        given = fields[3 + n_local] if len(fields) > 3 + n_local else ""
        self.offsets.setdefault(kind, []).append(read_field(given))
        if any(fields[8 + 2 :]):
            self.faults.append(f"element {fields[0]} has thicknesses of its own")

    def of_blocks(self, properties: Mapping[str, list[str]]) -> list[tuple[Array, Array]]:
        """Return thickness, NaN where there is none, and offset of the elements of each block."""
        found = []
        for kind, own in properties.items():
            t = np.array([self.sections[p].thickness if p in self.sections else np.nan for p in own])
            found.append((t, np.array(self.offsets.get(kind, [0.0] * len(own)))))
        return found


def abaqus_section(options: Mapping[str, str], data: list[list[str]]) -> ShellSection:
    """Return the section of Abaqus' ``*SHELL SECTION``.

    Raises
    ------
    MeshFileError
        Its thickness isn't one number for the whole of a layer.
    """
    name = options.get("ELSET", "")
    for word in ("COMPOSITE", "NODAL THICKNESS", "SHELL THICKNESS", "STACK DIRECTION"):
        if word in options:
            return ShellSection(np.nan, fault=f"*SHELL SECTION of {name} with {word}")
    if not data or not data[0][0]:
        raise MeshFileError(f"*SHELL SECTION of {name} has no thickness")
    thickness = read_real(data[0][0])
    given = options.get("OFFSET", "0").upper()
    words = {"SPOS": 0.5, "SNEG": -0.5}
    try:
        share = words[given] if given in words else float(given)
    except ValueError:
        raise MeshFileError(
            f"*SHELL SECTION of {name} with OFFSET = {given}, which is neither a share nor SPOS or SNEG"
        ) from None
    return ShellSection(thickness, -share * thickness)  # of the nodes from the middle, over the thickness


def of_sets(
    sections: Mapping[str, ShellSection], cell_sets: Mapping[str, list[IntArray]], sizes: list[int]
) -> list[tuple[Array, Array]]:
    """Return thickness, NaN where there is none, and offset of the elements of each block from sections of sets."""
    found = [(np.full(size, np.nan), np.zeros(size)) for size in sizes]
    for name, section in sections.items():
        for (thickness, offset), cells in zip(found, cell_sets.get(name, []), strict=False):
            thickness[cells], offset[cells] = section.thickness, section.offset
    return found
