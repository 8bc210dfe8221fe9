"""Shells in a scene file: flat plates and tubes by their midsurface and thickness."""

from typing import Any, ClassVar, Literal

from fmd.core.units import PositiveLength
from fmd.scene.bodies import scale_count
from fmd.scene.layers import Layerable
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import Count


class ShellMesh(SceneTable):
    """Division of a plate or tube into shell elements.

    Example:

        [body.plate.mesh]
        divisions = [40, 16]
    """

    order: ClassVar[int] = 1

    # Shape of the elements: MITC4 (``"quadrilateral"``), or MITC3+ (``"triangle"``), which bends as well in a plate but
    # is too stiff where a tube or a curved panel is stretched.
    element: Literal["quadrilateral", "triangle"] = "quadrilateral"
    # Numbers of quadrilaterals along a plate's x and y, or along and around a tube; two triangles in each.
    divisions: tuple[Count, Count]


class MeshedShell(Layerable):
    """Keys of shells whose mesh follows from their measures."""

    length: PositiveLength  # Extent along x [m].
    # Thickness, half of it on each side of the midsurface [m]; that of the ``layers`` if there are some.
    thickness: PositiveLength | None = None
    mesh: ShellMesh  # Division into elements.

    def _check(self) -> None:
        if (self.thickness is None) == (not self.layers):
            wrong = "has no effect beside layers, which have thicknesses" if self.layers else "is missing, e.g. '2 mm'"
            raise FaultError(wrong, "thickness")

    @property
    def wall(self) -> float:
        """Thickness of the shell [m]."""
        return self.layered_thickness if self.thickness is None else self.thickness

    @property
    def parts(self) -> tuple[str, ...]:
        """Name of the one part that the mesh has."""
        return (self.shape,)  # type: ignore[attr-defined]

    def resized(self, factor: float) -> dict[str, Any]:
        """Return the changes for a mesh with about ``factor`` times the elements each way."""
        divisions = tuple(
            max(scale_count(count, factor), self._fewest[k]) for k, count in enumerate(self.mesh.divisions)
        )
        return {"mesh": self.mesh.model_copy(update={"divisions": divisions})}

    def divided_more(self) -> dict[str, Any]:
        """Return the changes for four elements in place of one or two, which tell little of a strip's torsion."""
        divisions = tuple(4 if count <= 2 else count for count in self.mesh.divisions)
        return {"mesh": self.mesh.model_copy(update={"divisions": divisions})}

    _fewest: ClassVar[tuple[int, int]] = (1, 1)

    @property
    def divided_directions(self) -> int:
        """Number of directions with more than one element."""
        return max(1, sum(count > 1 for count in self.mesh.divisions))


class Plate(MeshedShell):
    """A flat rectangular plate of shell elements, along x from 0, centred on the x axis.

    Its faces are ``x-`` (where x is least), ``x+``, ``y-``, ``y+``, ``z-`` (the lower side) and ``z+``; its one part is
    ``plate``.

    Example:

        [body.plate]
        shape = "plate"
        length = "1 m"
        width = "0.4 m"
        thickness = "20 mm"
        E = "70 GPa"
        nu = 0.33
        rho = "2700 kg/m^3"
        mesh = { divisions = [40, 16] }
        modes = { count = 8 }
        marker = { root = { face = "x-" }, tip = { face = "x+" } }
    """

    faces: ClassVar[tuple[str, ...]] = ("x-", "x+", "y-", "y+", "z-", "z+")  # the four edges and the two sides
    shape: Literal["plate"]
    width: PositiveLength  # Extent along y [m].


class Tube(MeshedShell):
    """A straight round tube of shell elements, along x from 0, around the x axis.

    Its faces are ``x-`` (where x is least), ``x+``, ``inside`` and ``outside``; its one part is ``tube``.

    Example:

        [body.tower]
        shape = "tube"
        length = "2 m"
        radius = "100 mm"
        thickness = "4 mm"
        E = "210 GPa"
        nu = 0.3
        rho = "7850 kg/m^3"
        mesh = { divisions = [40, 32] }
        modes = { count = 8 }
        marker = { root = { face = "x-" }, tip = { face = "x+" } }
    """

    _fewest = (1, 13)  # around: with fewer the wall would have folds

    faces: ClassVar[tuple[str, ...]] = ("x-", "x+", "inside", "outside")  # the two ends and the two sides
    shape: Literal["tube"]
    radius: PositiveLength  # Radius of the middle of the wall [m].

    def _check(self) -> None:
        if not self.wall < 2 * (self.radius - abs(self.offset)):
            raise FaultError("must be below twice the radius, which is that of the wall's middle", "thickness")
        if self.mesh.divisions[1] < self._fewest[1]:
            raise FaultError(f"takes at least {self._fewest[1]} elements around", "mesh", "divisions")
