"""CAD files as meshes and as descriptions of their faces, by Gmsh in a process of its own."""

from __future__ import annotations

import json
import math
import re
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError, as_input_error
from fmd.core.limits.mesh import CAD_DIGITS, CAD_ELEMENTS
from fmd.core.limits.patience import CAD_SECONDS, CAD_SECONDS_PER_ELEMENT, READING_BYTES, READING_SECONDS
from fmd.core.limits.scene import LONGEST_NAME, LOST_FACES, MIDSURFACE_COUNTS
from fmd.core.memory import available_memory
from fmd.core.processes import ChildError, run_child
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh
from fmd.fem.mesh import SolidMesh

if TYPE_CHECKING:
    from fmd.meshes.cad import ScriptValues
    from fmd.meshes.cad_places import WholeCylinder

UNLIKE_SOLID = ", by ribs, fillets or corners, and so does its mass; what they do for stiffness isn't there"
_TETRAHEDRON = 0.117851  # volume of the regular tetrahedron of unit edge


@dataclass(frozen=True)
class FaceOutline:
    """A face of a CAD part."""

    name: str  # its name in the file, else that by its place, ``xmin`` or ``hole-1``, else its number, ``face-7``
    kind: str  # kind of surface: ``plane``, ``cylinder``, ``cone``, ``sphere``, ``torus`` or ``free-form``
    area: float  # [m²]
    centre: tuple[float, float, float]  # its centroid [m]


@dataclass(frozen=True)
class PartOutline:
    """A CAD part before it is meshed."""

    solids: int
    volume: float  # [m³]
    low: tuple[float, float, float]  # lowest corner of the box around it [m]
    high: tuple[float, float, float]  # highest corner of the box around it [m]
    faces: tuple[FaceOutline, ...]  # its faces, in the file's order


@dataclass(frozen=True)
class AssemblyPart:
    """A solid of an assembly, where it stands."""

    name: str  # its name in the file as scenes may have it, or its number
    volume: float  # [m³]
    centre: Array  # (3,): centre of mass [m]
    inertia: Array  # (3, 3): about the centre of mass, for a density of 1 [m⁵]
    round_faces: tuple[WholeCylinder, ...]  # its bores and pins


def cad_suffixes() -> tuple[str, ...]:
    """Return the suffixes of CAD files that are read."""
    from fmd.meshes.cad import SUFFIXES

    return SUFFIXES


def is_cad_file(path: Path) -> bool:
    """Return true if a file's suffix is that of a CAD file."""
    return path.suffix.lower() in cad_suffixes()


def mesh_cad_file(
    path: Path,
    size: float,
    order: int,
    sector: tuple[int, str, str] | None = None,
    script: ScriptValues | None = None,
) -> SolidMesh:
    """Mesh a CAD file (STEP, IGES, BREP, or a script of Gmsh) with tetrahedra, and check it as a mesh from a file.

    Edges have a size [m], elements order 1 or 2. A sector has the number of those in the whole body, and the faces of
    this one that are meshed alike; a script its unit and dimensions.

    Raises
    ------
    InputError
        The file isn't there, is no CAD file, or can't be meshed.
    """
    from fmd.fem.formats.import_mesh import solid_mesh
    from fmd.meshes.cad_mesh import load

    with tempfile.TemporaryDirectory(prefix="fmd-") as folder:
        arrays = Path(folder) / "arrays.npz"
        _run_gmsh(path, arrays, json.dumps({"size": size, "order": order, "sector": sector, "script": script}))
        mesh = load(arrays)
    cell_type = {1: "tetra", 2: "tetra10"}[order]
    raw = RawMesh(mesh.points, [(cell_type, mesh.cells)], {name: [cells] for name, cells in mesh.parts.items()})
    raw.facet_sets = {name: [corners] for name, corners in mesh.faces.items()}
    with as_input_error(str(path), of=MeshFileError):
        return replace(solid_mesh(raw, 1.0, repair=True), centres=mesh.centres, geometry_volume=mesh.volume)


def mesh_cad_sheet(
    path: Path, size: float, thickness: float, offset: float = 0.0, by_part: Mapping[str, float] = MappingProxyType({})
) -> SolidMesh:
    """Mesh the surfaces of a CAD file, or the midsurface of its solid, as shells of a thickness, all lengths in m.

    Single parts of surfaces may have a thickness of their own.

    Raises
    ------
    InputError
        As `mesh_cad_file`, or the solid has no midsurface of this thickness.
    """
    from fmd.fem.formats.import_joined import read_structure
    from fmd.fem.formats.import_shell import GivenSections

    with tempfile.TemporaryDirectory(prefix="fmd-") as folder:
        sheet = Path(folder) / "sheet.msh"
        _run_gmsh(path, sheet, json.dumps({"size": size, "thickness": thickness}))
        try:
            mesh = read_structure(sheet, 1.0, GivenSections(thickness, offset, by_part))
        except InputError as error:
            raise InputError(str(path), "", None, error.mend) from error
        assert isinstance(mesh, SolidMesh)  # of shells alone
        if not (about := sheet.with_suffix(".json")).exists():
            return mesh
        if by_part:
            what = "is of surfaces; a solid has a midsurface by walls of one thickness, mesh.shell"
            raise InputError(str(path), "mesh.thickness", None, what)
        solid = json.loads(about.read_text(encoding="utf-8"))
        more = mesh.volume / solid["volume"] - 1
        note = f"the volume of the midsurface with its thickness differs from the solid's by {100 * more:+.2g} %"
        if lost := solid["lost"]:
            further = f" and {len(lost) - LOST_FACES} more" if len(lost) > LOST_FACES else ""
            note += f" (no shell is half a thickness from its faces {', '.join(lost[:LOST_FACES])}{further})"
        if abs(more) > MIDSURFACE_COUNTS:
            note += UNLIKE_SOLID
        return replace(mesh, notes=(*mesh.notes, note))


def describe_cad_file(path: Path) -> PartOutline:
    """Describe the part in a CAD file by its faces, without meshing it; raises as `mesh_cad_file`."""
    with tempfile.TemporaryDirectory(prefix="fmd-") as folder:
        description = Path(folder) / "part.json"
        _run_gmsh(path, description)
        found = json.loads(description.read_text(encoding="utf-8"))
    faces = tuple(FaceOutline(**face | {"centre": tuple(face["centre"])}) for face in found["faces"])
    return PartOutline(found["solids"], found["volume"], tuple(found["low"]), tuple(found["high"]), faces)


def describe_assembly_file(path: Path, folder: Path) -> list[AssemblyPart]:
    """Describe the solids of a CAD file as parts of an assembly, and write each to a STEP file in a folder.

    Raises
    ------
    InputError
        As `mesh_cad_file`, the file has one solid, or the folder has a file of a part's name.
    """
    from fmd.meshes.cad_places import WholeCylinder

    with tempfile.TemporaryDirectory(prefix="fmd-") as temporary:
        description = Path(temporary) / "parts.json"
        _run_gmsh(path, description, temporary, entry="fmd.meshes.cad_assembly:main")
        found = json.loads(description.read_text(encoding="utf-8"))
        if len(found) == 1:
            raise InputError(str(path), "", None, "has one solid: leave --assembly out")
        names = _own_names([part.pop("name") for part in found])
        targets = [folder / f"{name}.step" for name in names]
        for target in targets:
            if target.exists():
                raise InputError(str(target), "", None, "exists already and is left as it is; take another name")
        folder.mkdir(parents=True, exist_ok=True)
        for number, target in enumerate(targets):
            shutil.copyfile(Path(temporary) / f"{number}.step", target)
    return [
        AssemblyPart(
            name,
            part["volume"],
            np.array(part["centre"]),
            np.array(part["inertia"]),
            tuple(
                WholeCylinder(**own | {key: np.array(own[key]) for key in ("middle", "axis")})
                for own in part["cylinders"]
            ),
        )
        for name, part in zip(names, found, strict=True)
    ]


def _own_names(given: list[str]) -> list[str]:
    """Return a name for each part, as scenes and files may have it; no two are alike, also without regard to case."""
    names: dict[str, str] = {}
    for number, text in enumerate(given, start=1):
        name = re.sub(r"^[^A-Za-z]+", "", re.sub(r"[^A-Za-z0-9_]+", "-", text).strip("-_"))[: LONGEST_NAME - 4]
        name = name if name and name != "ground" else f"part-{number}"
        alike = (f"{name}-{k}" for k in count(number))
        own = next(own for own in chain([name], alike) if own.casefold() not in names)
        names[own.casefold()] = own
    return [*names.values()]


def choose_element_size(part: PartOutline) -> float:
    """Return an edge length that gives a part some 4000 elements or more, rounded [m]."""
    size = math.cbrt(part.volume / (_TETRAHEDRON * CAD_ELEMENTS))
    return float(f"{size:.{CAD_DIGITS - 1}e}")


def _run_gmsh(path: Path, target: Path, *wanted: str, entry: str = "fmd.meshes.cad:main") -> None:
    """Let the mesher read a CAD file and write what it makes of it."""
    from fmd.meshes.cad_script import SUFFIX

    if not is_cad_file(path) and path.suffix.lower() != SUFFIX:
        raise InputError(str(path), "", None, f"is no CAD file that is read; these are: {' '.join(cad_suffixes())}")
    if not path.is_file():
        raise InputError(str(path), "", None, "no such file")
    limits = f"{READING_SECONDS:g}", f"{CAD_SECONDS_PER_ELEMENT:g}"
    memory = READING_BYTES + int(available_memory())
    try:
        run_child(entry, str(path.resolve()), str(target), *limits, *wanted, seconds=CAD_SECONDS, memory=memory)
    except ChildError as error:
        said = f"Gmsh's OpenCASCADE stopped on it ({error}); is it damaged?" if "died" in str(error) else str(error)
        if error.late:
            said = "Gmsh took longer than any sound file of its size does; is it damaged, or the elements too small?"
        raise InputError(str(path), "", None, said) from None
