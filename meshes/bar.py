"""Straight bars of rectangular section along x from 0, centred on y = z = 0."""

from typing import Any

import numpy as np

from fmd.meshes.gmsh_session import MeshArrays, gmsh_model, read_out

_SMALLEST, _LARGEST = 1e-5, 1e4  # m: Gmsh takes lengths near its fixed tolerances for none


def mesh(bar: Any) -> MeshArrays:
    """Mesh the bar of a scene's table ``Bar``; a tiny or huge one is meshed as one of 1 m."""
    size = np.array(bar.mesh.made_at or bar.extents)
    unit = 1.0 if size.min() > _SMALLEST and size.max() < _LARGEST else float(size[0])
    length, depth, width = (size / unit).tolist()
    if bar.mesh.element == "hexahedron":
        arrays = hexahedral_bar(length, depth, width, bar.mesh.divisions)
    else:
        arrays = tetrahedral_bar(length, depth, width, bar.mesh.size / unit)
    stretch = unit * np.array(bar.extents) / size
    return arrays if (stretch == 1.0).all() else arrays._replace(points=stretch * arrays.points)


def hexahedral_bar(length: float, depth: float, width: float, divisions: tuple[int, int, int]) -> MeshArrays:
    """Mesh a bar of extents along x, y and z [m] with a regular grid of hexahedra, by numbers of cells along these."""
    with gmsh_model("bar") as gmsh:
        geo = gmsh.model.geo
        corner = geo.addPoint(0.0, -depth / 2, -width / 2)
        line = geo.extrude([(0, corner)], length, 0, 0, numElements=[divisions[0]])
        face = geo.extrude([line[1]], 0, depth, 0, numElements=[divisions[1]], recombine=True)
        volume = geo.extrude([face[1]], 0, 0, width, numElements=[divisions[2]], recombine=True)
        geo.synchronize()
        return _generate(gmsh, volume[1][1], length, depth, width)


def tetrahedral_bar(length: float, depth: float, width: float, size: float) -> MeshArrays:
    """Mesh a bar with tetrahedra of edge length ``size`` [m]; other arguments as in `hexahedral_bar`."""
    with gmsh_model("bar") as gmsh:
        volume = gmsh.model.occ.addBox(0, -depth / 2, -width / 2, length, depth, width)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        return _generate(gmsh, volume, length, depth, width)


def _generate(gmsh: Any, volume: int, length: float, depth: float, width: float) -> MeshArrays:
    """Mesh the current model, a bar of one volume, and name its faces by the signs of their normals."""
    gmsh.model.addPhysicalGroup(3, [volume], name="bar")
    gmsh.model.mesh.generate(3)
    centres = {
        "x-": (0.0, 0.0, 0.0),
        "x+": (length, 0.0, 0.0),
        "y-": (length / 2, -depth / 2, 0.0),
        "y+": (length / 2, depth / 2, 0.0),
        "z-": (length / 2, 0.0, -width / 2),
        "z+": (length / 2, 0.0, width / 2),
    }
    faces = {}
    for _, surface in gmsh.model.getEntities(2):
        box = gmsh.model.getBoundingBox(2, surface)
        middle = [(box[i] + box[i + 3]) / 2 for i in range(3)]
        name = min(centres, key=lambda face: sum((a - b) ** 2 for a, b in zip(middle, centres[face], strict=True)))
        faces[name] = [surface]
    return read_out(gmsh, faces)
