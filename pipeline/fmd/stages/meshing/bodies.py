"""Meshes, matrices and materials of flexible bodies, from their tables in the scene."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import IntArray
from fmd.core.errors import InputError, blaming
from fmd.core.units import unit_ratio
from fmd.fem.material import AnyMaterial, Material, MaterialOfElements
from fmd.fem.mesh import SolidMesh
from fmd.fem.sectors import repeat_sector
from fmd.scene.beams import MeshedBeam
from fmd.scene.imported_bodies import CadPart, MatrixPart, MeshedPart
from fmd.scene.reading import suggest_name
from fmd.scene.reduced_bodies import ReducedPart
from fmd.scene.sectors import SectorMesh
from fmd.scene.shells import Plate, Tube
from fmd.scene.source_files import SourceFiles
from fmd.stages.meshing.beams import mesh_beams
from fmd.stages.meshing.cad_files import mesh_cad_file, mesh_cad_sheet

if TYPE_CHECKING:
    from fmd.fem.model import FEModel
    from fmd.scene.any_body import Flexible


def make_mesh(shape: Flexible, source: SourceFiles | None) -> SolidMesh:
    """Mesh a body, or read its mesh from the file that it comes from."""
    if shape.shape == "mesh":
        from fmd.fem.formats.import_beam import read_beams
        from fmd.fem.formats.import_mesh import read_mesh
        from fmd.fem.formats.import_shell import read_shell

        assert source is not None
        given, unit = shape.mesh, unit_ratio(shape.mesh.unit, "m")
        mass = None if given.mass_unit is None else unit_ratio(given.mass_unit, "kg")
        force = None if given.force_unit is None else unit_ratio(given.force_unit, "N")
        if given.beam is not None:
            return read_beams(source.path, unit, mass, force)
        if given.shell is not None:
            return read_shell(source.path, unit, None if given.shell == "deck" else given.shell, mass, force)
        ties = [(tie.face, tie.onto, tie.within) for tie in given.tie]
        return _complete(read_mesh(source.path, unit, given.repair, mass, force, ties), given, source)
    if shape.shape == "cad":
        assert source is not None
        table = shape.mesh
        if table.shell is not None:
            return mesh_cad_sheet(source.path, table.size, table.shell)
        sector = None if table.cyclic is None or table.cuts is None else (table.cyclic, *table.cuts)
        return _complete(mesh_cad_file(source.path, table.size, table.order, sector), table, source)
    assert not isinstance(shape, MatrixPart | ReducedPart)
    if isinstance(shape, MeshedBeam):
        return mesh_beams(shape)
    module = import_module(f"fmd.meshes.{shape.shape.replace('-', '_')}")
    if not isinstance(shape, Plate | Tube):
        return SolidMesh(*module.mesh(shape))
    from fmd.fem.thicken import Sheet, thicken

    points, cells, edges, sides = module.sheet(shape)
    thickness = np.full(len(cells), shape.thickness)
    return thicken(Sheet(points, cells, thickness, {shape.shape: np.arange(len(cells))}, edges, {}, sides))


def _complete(mesh: SolidMesh, table: SectorMesh, source: SourceFiles) -> SolidMesh:
    """Return a mesh as it is or, of a sector, that of the whole body."""
    if table.cyclic is None or table.cuts is None:
        return mesh
    file = str(source.path)
    low, high = (find_name(mesh.faces, name, file, "mesh.cuts") for name in table.cuts)
    with blaming(file, "mesh.cuts", [low, high]):
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
        model = read_geometric_stiffness(model, stiffened, given.unknowns, units[1])
    return model


def find_material(shape: Flexible, mesh: SolidMesh, file: str, body: str) -> AnyMaterial:
    """Return a body's material: of the whole, or of each part of its mesh that has one of its own.

    Raises
    ------
    InputError
        The mesh has no part of a name that the scene gives a material to.
    """
    assert not isinstance(shape, MatrixPart | ReducedPart)
    whole = Material(shape.E, shape.nu, shape.rho)
    if not isinstance(shape, MeshedPart | CadPart) or not shape.material:
        return whole
    numbers = np.zeros(len(mesh.cells), dtype=np.int64)
    names = [find_name(mesh.parts, name, file, f"body.{body}.material.{name}.part") for name in shape.material]
    cells = {k: mesh.parts[name] for k, name in enumerate(names, start=1)}
    for k in sorted(cells, key=lambda k: -len(cells[k])):  # of parts within parts the smallest counts
        numbers[cells[k]] = k
    own = (Material(table.E, table.nu, table.rho) for table in shape.material.values())
    return MaterialOfElements((whole, *own), numbers)


def find_name(names: Mapping[str, IntArray], given: str, file: str, key: str) -> str:
    """Return a face's or a part's name as the mesh has it; upper and lower case may differ.

    Parameters
    ----------
    file, key : str
        Where the scene gives it; the key of a part ends with ``part``.

    Raises
    ------
    InputError
        There is none of that name.
    """
    alike = [known for known in names if known.casefold() == given.casefold()]
    if given not in names and len(alike) != 1:
        what = "part" if key.endswith("part") else "face"
        raise InputError(file, key, given, f"no such {what}; {suggest_name(given, names, f'the {what}s')}")
    return given if given in names else alike[0]
