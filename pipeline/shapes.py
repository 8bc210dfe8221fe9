"""From a flexible body's table in the scene to its mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.fem.mesh import SolidMesh
from pipeline.sources import Source
from pipeline.units import unit_ratio

if TYPE_CHECKING:
    from meshes.gmsh_session import MeshArrays
    from pipeline.scene import Bar, Flexible, Propeller


def mesh_of(shape: Flexible, source: Source | None) -> SolidMesh:
    """Mesh a body, or read its mesh from the file that it comes from."""
    if shape.shape == "mesh":
        from pipeline.fem.mesh_file import read_mesh

        assert source is not None
        return read_mesh(source.path, unit_ratio(shape.mesh.unit, "m"), shape.mesh.repair)
    return SolidMesh(*_mesh_arrays(shape))


def _mesh_arrays(part: Bar | Propeller) -> MeshArrays:
    if part.shape == "propeller":
        from meshes.propeller import PropellerCounts, PropellerShape, propeller

        mesh = part.mesh
        shape = PropellerShape(
            part.blades,
            bore=part.bore / 2,
            hub=part.hub / 2,
            root=part.root / 2,
            tip=part.diameter / 2,
            length=part.length,
            chord=part.chord,
            thickness=part.thickness,
            pitch=part.pitch,
            camber=part.camber,
            edge=part.edge,
        )
        return propeller(shape, PropellerCounts(*mesh.sleeve, *mesh.joint[1:], mesh.blade[2], mesh.growth))
    from meshes.bar import hexahedral_bar, tetrahedral_bar

    size = (part.length, part.depth, part.width)
    if part.mesh.element == "hexahedron":
        assert part.mesh.divisions is not None  # the scene's own check
        return hexahedral_bar(*size, part.mesh.divisions)
    assert part.mesh.size is not None
    return tetrahedral_bar(*size, part.mesh.size)
