"""Beams in a scene file: stepped round shafts, and bars of a standard section."""

from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from fmd.core.arrays import Array
from fmd.core.limits.mesh import FACE_IN_PLANE
from fmd.core.units import PositiveLength
from fmd.scene.bodies import Solid, scale_count
from fmd.scene.kinds import KindBy
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import Count, Name

_ENDS = ("x-", "x+")


class BeamMesh(SceneTable):
    """Division of a shaft or profile into beams.

    Example:

        [body.rotor.mesh]
        size = "20 mm"
    """

    order: ClassVar[int] = 1

    size: PositiveLength | None = None  # Largest length of a beam [m].
    # In place of ``size``: number of beams between each two neighbours among the ends, the ends of segments and the
    # stations.
    divisions: Annotated[tuple[Count, ...], Field(min_length=1)] | None = None

    def _check(self) -> None:
        if self.size is None and self.divisions is None:
            raise FaultError("is missing: largest length of a beam, e.g. '20 mm'", "size")
        if self.size is not None and self.divisions is not None:
            raise FaultError("stands in place of size; give one of both", "divisions")


class MeshedBeam(Solid):
    """Keys of bodies that are beams in a line."""

    divided_directions: ClassVar[int] = 1
    is_beam: ClassVar[bool] = True
    mesh: BeamMesh  # Division into elements.
    # Distances from the start [m] at which there is a section that markers and links may name as their ``face``.
    station: dict[Name, PositiveLength] = Field(default_factory=dict)

    @property
    def section_tables(self) -> tuple[SceneTable, ...]:
        """Tables of the sections, from the start on."""
        raise NotImplementedError

    @property
    def lengths(self) -> tuple[float, ...]:
        """Lengths of the pieces of one section [m]."""
        raise NotImplementedError

    @property
    def whole_length(self) -> float:
        """Length of all beams [m]."""
        return sum(self.lengths)

    @property
    def fixed_sections(self) -> Array:
        """Distances from the start [m] at which beams end however they are divided, rising."""
        fixed = np.sort([0.0, *np.cumsum(self.lengths), *self.station.values()])
        return np.asarray(fixed[np.append(True, np.diff(fixed) > FACE_IN_PLANE * self.whole_length)])

    @property
    def divisions(self) -> tuple[int, ...]:
        """Numbers of beams between neighbours among `fixed_sections`."""
        if self.mesh.divisions is not None:
            return self.mesh.divisions
        assert self.mesh.size is not None
        return tuple(int(n) for n in np.ceil(np.diff(self.fixed_sections) / self.mesh.size - 1e-9))

    def with_elements_of(self, first: Self) -> Self:
        """Return the body with the elements of another one, which differs in its dimensions."""
        if len(self.fixed_sections) != len(first.fixed_sections) or self.divisions == first.divisions:
            return self
        return self.model_copy(update={"mesh": BeamMesh(divisions=first.divisions)})

    @property
    def kept_elements(self) -> str:
        """Key and value, ``mesh={ divisions = ... }``, that keep its elements at other dimensions."""
        return f"mesh={{ divisions = {[*self.divisions]} }}"

    @property
    def faces(self) -> tuple[str, ...]:
        """Names of both ends and of the stations."""
        return (*_ENDS, *self.station)

    def resized(self, factor: float) -> dict[str, Any]:
        """Return the changes for a mesh with about ``factor`` times the elements."""
        if self.mesh.size is not None:
            return {"mesh": BeamMesh(size=self.mesh.size / factor)}
        return {"mesh": BeamMesh(divisions=tuple(scale_count(count, factor) for count in self.divisions))}

    def _check(self) -> None:
        for name, at in self.station.items():
            if name in _ENDS:
                raise FaultError("is the name of an end; give the station another", "station", name)
            if not at < self.whole_length:
                raise FaultError(f"must be below the length, {self.whole_length:.6g} m", "station", name)
        spans = len(self.fixed_sections) - 1
        if len(self.divisions) != spans:
            mend = (
                f"has {len(self.divisions)} numbers for the {spans} lengths between ends, ends of segments and stations"
            )
            raise FaultError(mend, "mesh", "divisions")


class ShaftSegment(SceneTable):
    """A piece of a shaft of one diameter.

    Example:

        [[body.rotor.segment]]
        length = "100 mm"
        diameter = "50 mm"
        bore = "20 mm"
    """

    length: PositiveLength  # Extent along x [m].
    diameter: PositiveLength  # Outer diameter [m].
    bore: PositiveLength | None = None  # Diameter of the hole along it [m].

    def _check(self) -> None:
        if self.bore is not None and not self.bore < self.diameter:
            raise FaultError("must be below the diameter", "bore")


class Shaft(MeshedBeam):
    """A stepped round shaft of Timoshenko beams, along x from 0.

    Its faces are ``x-`` (where x is least), ``x+`` and its stations; its parts are ``segment-1``, ``segment-2`` …

    Example:

        [body.rotor]
        shape = "shaft"
        segment = [
            { length = "200 mm", diameter = "30 mm" },
            { length = "100 mm", diameter = "50 mm", bore = "20 mm" },
        ]
        station = { disc = "250 mm" }
        E = "210 GPa"
        nu = 0.3
        rho = "7850 kg/m^3"
        mesh = { size = "10 mm" }
        modes = { count = 8 }
        link.disc = { face = "disc", type = "rigid" }
        mass.disc = { at = "disc", mass = "5 kg", inertia = ["0.04 kg m^2", "0.02 kg m^2", "0.02 kg m^2"] }
        marker = { left = { face = "x-" }, right = { face = "x+" } }
    """

    shape: Literal["shaft"]
    # Its pieces, one behind the other.
    segment: Annotated[tuple[ShaftSegment, ...], Field(min_length=1, max_length=1000)]

    @property
    def section_tables(self) -> tuple[ShaftSegment, ...]:
        """Tables of the sections, from the start on."""
        return self.segment

    @property
    def lengths(self) -> tuple[float, ...]:
        """Lengths of the segments [m]."""
        return tuple(segment.length for segment in self.segment)

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the segments."""
        return tuple(f"segment-{k}" for k in range(1, 1 + len(self.segment)))


class Rectangle(SceneTable):
    """A rectangular section.

    Example:

        [body.rail.section]
        type = "rectangle"
        width = "20 mm"
        height = "30 mm"
    """

    type: Literal["rectangle"]  # Kind of section.
    # Extents along y and z [m].
    width: PositiveLength
    height: PositiveLength


class Box(SceneTable):
    """A rectangular tube as a section.

    Example:

        [body.rail.section]
        type = "box"
        width = "40 mm"
        height = "60 mm"
        wall = "4 mm"
    """

    type: Literal["box"]  # Kind of section.
    # Outer extents along y and z [m].
    width: PositiveLength
    height: PositiveLength
    wall: PositiveLength  # Thickness of the walls [m].

    def _check(self) -> None:
        if not 2 * self.wall < min(self.width, self.height):
            raise FaultError("must be below half of width and height", "wall")


class ISection(SceneTable):
    """An I-section, its web along z.

    Example:

        [body.rail.section]
        type = "I"
        width = "60 mm"
        height = "80 mm"
        web = "4 mm"
        flange = "5 mm"
    """

    type: Literal["I"]  # Kind of section.
    # Extents along y and z [m].
    width: PositiveLength
    height: PositiveLength
    # Thicknesses [m].
    web: PositiveLength
    flange: PositiveLength

    def _check(self) -> None:
        if not self.web < self.width:
            raise FaultError("must be below the width", "web")
        if not 2 * self.flange < self.height:
            raise FaultError("must be below half of the height", "flange")


class Profile(MeshedBeam):
    """A straight bar of one section of Timoshenko beams, along x from 0.

    Its faces are ``x-`` (where x is least), ``x+`` and its stations; its one part is ``profile``. Warping of the
    section is free: an I or a box that is clamped where it is twisted is stiffer.

    Example:

        [body.rail]
        shape = "profile"
        length = "2 m"
        section = { type = "I", width = "60 mm", height = "80 mm", web = "4 mm", flange = "5 mm" }
        E = "70 GPa"
        nu = 0.33
        rho = "2700 kg/m^3"
        mesh = { size = "50 mm" }
        modes = { count = 8 }
        marker = { root = { face = "x-" }, tip = { face = "x+" } }
    """

    parts: ClassVar[tuple[str, ...]] = ("profile",)
    shape: Literal["profile"]
    length: PositiveLength  # Extent along x [m].
    section: Annotated[Rectangle | Box | ISection, KindBy("type")]  # Its section, by ``type``.

    @property
    def section_tables(self) -> tuple[Rectangle | Box | ISection]:
        """Table of the one section."""
        return (self.section,)

    @property
    def lengths(self) -> tuple[float]:
        """Extent along x [m]."""
        return (self.length,)
