"""Bars in a scene file: their shape and how they are divided into elements."""

import json
from typing import Any, ClassVar, Literal, Self

from fmd.core.units import PositiveLength
from fmd.scene.bodies import DividedMesh, Solid, scale_count
from fmd.scene.reading import FaultError
from fmd.scene.values import Count, Order


class BarMesh(DividedMesh):
    """Division of a bar into elements: hexahedra by their numbers, tetrahedra by their size.

    Example:

        [body.beam.mesh]
        element = "hexahedron"
        divisions = [30, 3, 1]
    """

    element: Literal["hexahedron", "tetrahedron"] = "hexahedron"  # Shape of the elements.
    order: Order = 2  # Polynomial order of the displacement in an element; linear tetrahedra are too stiff in bending.
    # Numbers of hexahedra along x, y and z; required for hexahedra.
    divisions: tuple[Count, Count, Count] | None = None
    size: PositiveLength | None = None  # Edge length of a tetrahedron [m]; required for tetrahedra.
    # Length, depth and width [m] of the bar whose tetrahedra are stretched to these; by default those of the bar.
    made_at: tuple[PositiveLength, PositiveLength, PositiveLength] | None = None

    def _check(self) -> None:
        if self.element == "hexahedron":
            if self.size is not None:
                raise FaultError("belongs to tetrahedra; hexahedra take divisions, e.g. [48, 4, 2]", "size")
            if self.divisions is None:
                raise FaultError("is missing: hexahedra along x, y and z, e.g. [48, 4, 2]", "divisions")
            if self.made_at is not None:
                raise FaultError("belongs to tetrahedra; divisions keep hexahedra as they are", "made_at")
        else:
            if self.divisions is not None:
                raise FaultError("belongs to hexahedra; tetrahedra take a size, e.g. '5 mm'", "divisions")
            if self.size is None:
                raise FaultError("is missing: the edge length of a tetrahedron, e.g. '5 mm'", "size")


class Bar(Solid):
    """A straight bar with a rectangular section, along x, centred on the x axis.

    Its faces are ``x-`` (where x is least), ``x+``, ``y-``, ``y+``, ``z-`` and ``z+``; its one part is ``bar``.

    Example:

        [body.beam]
        shape = "bar"
        length = "340 mm"
        depth = "25 mm"
        width = "10 mm"
        E = "722 MPa"
        nu = 0.34
        rho = "2000 kg/m^3"
        mesh = { divisions = [30, 3, 1] }
        modes = { count = 5 }
        marker = { root = { face = "x-" }, tip = { face = "x+" } }
    """

    parts: ClassVar[tuple[str, ...]] = ("bar",)
    faces: ClassVar[tuple[str, ...]] = ("x-", "x+", "y-", "y+", "z-", "z+")  # ``"x-"`` is where x is least
    shape: Literal["bar"]
    length: PositiveLength  # Extent along x [m].
    depth: PositiveLength  # Extent along y [m].
    width: PositiveLength  # Extent along z [m].
    mesh: BarMesh  # Division into elements.

    @property
    def extents(self) -> tuple[float, float, float]:
        """Length, depth and width [m]."""
        return self.length, self.depth, self.width

    def with_elements_of(self, first: Self) -> Self:
        """Return the bar with the elements of another one, which differs in its dimensions."""
        if self.mesh.divisions is not None or self.extents == first.extents:
            return self
        made_at = first.mesh.made_at or first.extents
        return self.model_copy(update={"mesh": self.mesh.model_copy(update={"made_at": made_at})})

    @property
    def kept_elements(self) -> str:
        """Key and value, ``mesh.made_at=...``, that keep its elements at other dimensions; empty if none has to."""
        return f"mesh.made_at={json.dumps([f'{x!r} m' for x in self.mesh.made_at])}" if self.mesh.made_at else ""

    def of_order(self, order: int) -> dict[str, Any]:
        """Return the changes for elements of another order."""
        return {"mesh": self.mesh.model_copy(update={"order": order})}

    def resized(self, factor: float) -> dict[str, Any]:
        """Return the changes for a mesh with about ``factor`` times the elements each way.

        Pieces of as many elements each have fewer in all of them alike: a coarser mesh is cut at the same places.
        """
        if self.mesh.divisions is None:
            assert self.mesh.size is not None
            return {"mesh": self.mesh.model_copy(update={"size": self.mesh.size / factor})}
        sizes, own, n = (self.length, self.depth, self.width), self.mesh.divisions, self.pieces
        counts, along = [scale_count(count, factor) for count in own], sizes.index(max(sizes))
        if isinstance(n, int) and n <= counts[along] < own[along] and own[along] % n == 0:
            counts[along] -= counts[along] % n
        return self._divided(tuple(counts))

    def divided_more(self) -> dict[str, Any]:
        """Return the changes for two elements in place of one quadratic, or of two linear ones, which bend alike.

        Tetrahedra are halved each way.
        """
        order = self.mesh.order
        if self.mesh.size is not None:
            size = min(self.mesh.size, *self.extents)
            few = round(min(self.extents) / size) * order <= 2
            return {"mesh": self.mesh.model_copy(update={"size": size / 2})} if few else {}
        assert self.mesh.divisions is not None
        return self._divided(tuple(4 // order if count * order <= 2 else count for count in self.mesh.divisions))

    @property
    def divided_directions(self) -> int:
        """Number of directions with more than one element."""
        return 3 if self.mesh.divisions is None else max(1, sum(count > 1 for count in self.mesh.divisions))

    def _divided(self, divisions: tuple[int, ...]) -> dict[str, Any]:
        return {"mesh": self.mesh.model_copy(update={"divisions": divisions})}
