"""Meshes, matrices and materials of flexible bodies, from their tables in the scene."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.errors import InputError, as_input_error
from fmd.core.units import unit_ratio
from fmd.fem.joined import AnyMesh
from fmd.fem.laminate import Lamina, Laminate, Ply
from fmd.fem.layered import Layered
from fmd.fem.material import AnyMaterial, Material, MaterialOfElements
from fmd.fem.mesh import SolidMesh
from fmd.fem.midsurface import Layup
from fmd.fem.sectors import repeat_sector
from fmd.scene.beams import MeshedBeam
from fmd.scene.bodies import SectorMesh
from fmd.scene.imported_bodies import CadFile, CadPart, MatrixPart, MeshedPart
from fmd.scene.layers import LaminaTable, Layerable
from fmd.scene.reading import suggest_name
from fmd.scene.reduced_bodies import ReducedPart
from fmd.scene.shells import Plate, Tube
from fmd.scene.source_files import SourceFiles
from fmd.stages.meshing.beams import mesh_beams
from fmd.stages.meshing.cad_files import mesh_cad_file, mesh_cad_sheet

if TYPE_CHECKING:
    from fmd.fem.model import FEModel
    from fmd.meshes.cad import ScriptValues
    from fmd.scene.any_body import Flexible


def make_mesh(shape: Flexible, source: SourceFiles | None) -> AnyMesh:
    """Mesh a body, or read its mesh from the file that it comes from."""
    if shape.shape == "mesh":
        from fmd.fem.formats.import_joined import read_structure
        from fmd.fem.formats.import_mesh import read_mesh
        from fmd.fem.formats.import_shell import GivenSections

        assert source is not None
        given, unit = shape.mesh, unit_ratio(shape.mesh.unit, "m")
        mass = None if given.mass_unit is None else unit_ratio(given.mass_unit, "kg")
        force = None if given.force_unit is None else unit_ratio(given.force_unit, "N")
        ties = [(tie.face, tie.onto, tie.within) for tie in given.tie]
        if given.beam is not None or given.shell is not None:
            sections = GivenSections(shape.shell_thickness, shape.offset, given.thickness, given.halvings)
            shell = None if given.shell is None else sections
            return read_structure(source.path, unit, shell, given.beam is not None, given.repair, (mass, force), ties)
        return _complete(read_mesh(source.path, unit, given.repair, mass, force, ties), given, source)
    if shape.shape == "cad":
        assert source is not None
        table = shape.mesh
        if table.shell is not None:
            assert shape.shell_thickness is not None  # which decks alone may have
            return mesh_cad_sheet(source.path, table.size, shape.shell_thickness, shape.offset, table.thickness)
        sector = None if table.cyclic is None or table.cuts is None else (table.cyclic, *table.cuts)
        return _complete(mesh_cad_file(source.path, table.size, table.order, sector, _script(table)), table, source)
    assert not isinstance(shape, MatrixPart | ReducedPart)
    if isinstance(shape, MeshedBeam):
        return mesh_beams(shape)
    module = import_module(f"fmd.meshes.{shape.shape.replace('-', '_')}")
    if not isinstance(shape, Plate | Tube):
        return SolidMesh(*module.mesh(shape))
    from fmd.fem.thicken import Sheet, thicken

    points, cells, edges, sides = module.sheet(shape)
    thickness, offset = (np.full(len(cells), each) for each in (shape.wall, shape.offset))
    return thicken(Sheet(points, cells, thickness, {shape.shape: np.arange(len(cells))}, edges, {}, sides, offset))


def _script(table: CadFile) -> ScriptValues | None:
    """Return the unit and the dimensions of a script, ``None`` for other files."""
    if not table.is_script:
        return None
    from fmd.meshes.cad import ScriptValues

    unit = unit_ratio(table.unit or "m", "m")
    values, made_at = ({name: x / unit for name, x in each.items()} for each in (table.parameter, table.first))
    return ScriptValues(unit, values, made_at)


def _complete(mesh: SolidMesh, table: SectorMesh, source: SourceFiles) -> SolidMesh:
    """Return a mesh as it is or, of a sector, that of the whole body."""
    if table.cyclic is None or table.cuts is None:
        return mesh
    file = str(source.path)
    low, high = (find_name(mesh.faces, name, file, "mesh.cuts") for name in table.cuts)
    with as_input_error(file, "mesh.cuts", [low, high]):
        return repeat_sector(mesh, table.cyclic, (low, high))


def read_body_matrices(shape: Flexible, source: SourceFiles | None) -> FEModel:
    """Read a body that is given by its matrices."""
    from fmd.fem.formats.matrices import read_matrices

    assert shape.shape == "matrices"
    assert source is not None
    given, paths = shape.matrices, source.paths
    units = unit_ratio(given.unit, "m"), unit_ratio(given.stiffness_unit, "N/m"), unit_ratio(given.mass_unit, "kg")
    model = read_matrices(paths["stiffness"], paths["mass"], paths["nodes"], units, given.unknowns)
    if not (given.stress or given.geometric_stiffness):
        return model
    from fmd.fem.formats.program_answers import read_geometric_stiffness, read_stress

    if given.stress:
        model = read_stress(model, paths["stress"], paths["nodes"], (units[0], units[1] / units[0]))
    if stiffened := source.all_of("geometric_stiffness"):
        model = read_geometric_stiffness(model, stiffened, (units[0], units[1]))
    return model


def find_material(shape: Flexible, mesh: AnyMesh, file: str, body: str) -> AnyMaterial:
    """Return a body's material: of the whole, or of each part of its mesh that has one of its own.

    Raises
    ------
    InputError
        The mesh has no part of a name that the scene gives a material to.
    """
    assert not isinstance(shape, MatrixPart | ReducedPart)
    if isinstance(shape, Layerable) and shape.layers:
        plies = ((layer.material, layer.thickness, layer.angle) for layer in shape.layers)
        return Layered(_laminate(shape, plies), np.tile(shape.layer_direction, (mesh.n_cells, 1)))
    layup = mesh.layup
    if layup is not None or (isinstance(shape, MeshedPart) and shape.mesh.shell == "deck" and shape.lamina):
        return _material_of_deck(shape, layup, file, body)
    whole = _whole(shape, file, body)
    if not isinstance(shape, MeshedPart | CadPart) or not shape.material:
        return whole
    numbers = np.zeros(mesh.n_cells, dtype=np.int64)
    names = [find_name(mesh.parts, name, file, f"body.{body}.material.{name}.part", "part") for name in shape.material]
    cells = {k: mesh.parts[name] for k, name in enumerate(names, start=1)}
    for k in sorted(cells, key=lambda k: -len(cells[k])):  # of parts within parts the smallest counts
        numbers[cells[k]] = k
    own = (Material(table.E, table.nu, table.rho) for table in shape.material.values())
    return MaterialOfElements((whole, *own), numbers)


def _whole(shape: Any, file: str, body: str) -> Material:
    """Return the one isotropic material of a body, which one with layers may lack."""
    for key in ("E", "nu", "rho"):
        if getattr(shape, key) is None:
            raise InputError(file, f"body.{body}.{key}", None, "is missing: some of the shells have no layers")
    return Material(shape.E, shape.nu, shape.rho)


def _material_of_deck(shape: Any, layup: Layup | None, file: str, body: str) -> AnyMaterial:
    """Return the material of shells some of which have layers by their deck."""
    if layup is None:
        problem = "has no effect: no shells have layers by the deck, and pieces of a body don't keep them; pieces = 1"
        raise InputError(file, f"body.{body}.lamina", None, problem)
    if shape.material:
        raise InputError(file, f"body.{body}.material", None, "can't stand beside layers of the deck")
    names = {name.casefold(): name for name in shape.lamina}
    materials: list[Material | Layered] = []
    used, numbers = np.unique(layup.numbers, return_inverse=True)
    for number in used:
        plies = layup.stacks[number] if number >= 0 else ()
        if missing := next((name for name, _, _ in plies if name.casefold() not in names), None):
            problem = "is missing: it is a material of the deck's layers; E1, E2, nu12, G12 and rho are needed"
            raise InputError(file, f"body.{body}.lamina.{missing}", None, problem)
        own = ((names[name.casefold()], t, angle) for name, t, angle in plies)
        materials.append(Layered(_laminate(shape, own), layup.directions) if plies else _whole(shape, file, body))
    return MaterialOfElements(tuple(materials), numbers.ravel())


def _laminate(shape: Layerable, plies: Iterable[tuple[str, float, float]]) -> Laminate:
    """Return the laminate of plies by material, thickness [m] and angle [rad], from the lower face on."""
    return Laminate(tuple(Ply(lamina_of(shape.lamina[name]), t, angle, name) for name, t, angle in plies))


def lamina_of(table: LaminaTable) -> Lamina:
    """Return the material of a ply."""
    G12, G13, G23 = table.G12, table.G13 or table.G12, table.G23 or table.G12
    return Lamina(table.E1, table.E2, table.nu12, G12, G13, G23, table.rho)


def find_name(names: Collection[str], given: str, file: str, key: str, what: str = "face") -> str:
    """Return the name of a face, or of what else is said, as the mesh has it; upper and lower case may differ.

    Raises
    ------
    InputError
        There is none of that name.
    """
    alike = [known for known in names if known.casefold() == given.casefold()]
    if given not in names and len(alike) != 1:
        raise InputError(file, key, given, f"no such {what}; {suggest_name(given, names, f'the {what}s')}")
    return given if given in names else alike[0]
