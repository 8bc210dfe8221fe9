"""A mesh as a file holds it: blocks of cells of any kind, sets by name; nothing is checked or mended yet."""

from __future__ import annotations

from dataclasses import dataclass, field

from pipeline.core.arrays import Array, IntArray


class MeshFileError(ValueError):
    """A mesh file can't be used; the message tells what is wrong and what would work."""


@dataclass
class RawMesh:
    """What a reader found.

    Attributes
    ----------
    points : ndarray, shape (n_points, 3)
        Positions in the file's unit.
    blocks : list of (str, ndarray)
        Kind of cells, by meshio's name and in its order of nodes, and the points of each, shape (n, n_local).
    cell_sets : dict of str to list of ndarray
        Of each named set, the cells that it holds of each block.
    point_sets : dict of str to ndarray
        Points of each named set.
    facet_sets : dict of str to list of ndarray
        Corners of solid cells' facets that make up a named surface, arrays (n, 3) or (n, 4).
    others : dict of str to int
        How many elements the file has that are no cells of a mesh, by their kind: springs, masses, rigid links.
    """

    points: Array
    blocks: list[tuple[str, IntArray]] = field(default_factory=list)
    cell_sets: dict[str, list[IntArray]] = field(default_factory=dict)
    point_sets: dict[str, IntArray] = field(default_factory=dict)
    facet_sets: dict[str, list[IntArray]] = field(default_factory=dict)
    others: dict[str, int] = field(default_factory=dict)
