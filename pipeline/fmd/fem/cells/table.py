"""All solid cells, and the layers of shells, by meshio's names."""

from fmd.fem.cells import hexahedron, pyramid, tetrahedron, wedge
from fmd.fem.cells.cell import SolidCell

CELLS: dict[str, SolidCell] = {
    cell.name: cell for cell in (*tetrahedron.CELLS, *hexahedron.CELLS, *wedge.CELLS, *pyramid.CELLS)
}
# Beginnings of meshio's names of solids, of which some aren't computed.
_SOLID = (*{cell.shape.name for cell in CELLS.values()}, "penta_prism", "hexa_prism", "polyhedron")


def solid_cell(name: str) -> SolidCell:
    """Return the cell of a name of meshio's.

    Raises
    ------
    ValueError
        It isn't among those that are computed; the message lists them.
    """
    if name not in CELLS:
        raise ValueError(f"cell_type is {name!r}, expected one of {', '.join(CELLS)}")
    return CELLS[name]


def complete_dimensions(dimensions: dict[str, int]) -> None:
    """Add the solids that are missing in meshio 5.3's table of dimensions by cell, without which it refuses them."""
    for name in CELLS:
        dimensions.setdefault(name, 3)


def is_solid(name: str) -> bool:
    """Return True if a cell of this name is a solid, computed or not."""
    return name.startswith(_SOLID) or "HEXA" in name or "TETRA" in name or "WEDGE" in name
