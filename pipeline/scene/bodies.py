"""Flexible bodies in a scene file: their shape, material, elements, modes and markers."""

from __future__ import annotations

import re
from math import pi
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from pipeline.core.units import Angle, Length, PositiveDensity, PositiveLength, PositiveStress, to_si
from pipeline.scene.reading import FaultError, Table, among


def _name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,39}", name) or name == "ground":
        raise ValueError("a name is a letter and up to 39 letters, digits, '_' or '-'; 'ground' is taken")
    return name


def _poisson(nu: float) -> float:
    if not nu > -1:
        raise ValueError("must be above -1; most metals have about 0.3")
    if not nu < 0.5:
        raise ValueError("must be below 0.5 (0.5 is incompressible); 0.499 works")
    return nu


def _direction(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(axis):
        raise ValueError("has no direction; [0, 0, 1] is the z axis")
    return axis


def _plane(text: object) -> tuple[int, float]:
    match = re.fullmatch(r"\s*([xyz])\s*=\s*(.+?)\s*", text) if isinstance(text, str) and len(text) < 100 else None
    if match is None:
        raise ValueError("must look like 'x = 0' or 'z = 12 mm'")
    return "xyz".index(match[1]), 0.0 if re.fullmatch(r"[+-]?0+(\.0*)?", match[2]) else to_si(match[2], "length")


Name = Annotated[str, AfterValidator(_name)]
Poisson = Annotated[Annotated[float, Field(strict=True)], AfterValidator(_poisson)]
Plane = Annotated[tuple[int, float], BeforeValidator(_plane)]
Place = Annotated[str, Field(max_length=100)]
Number = Annotated[float, Field(strict=True)]
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Point = tuple[Length, Length, Length]
Axis = Annotated[tuple[Number, Number, Number], AfterValidator(_direction)]


class Mesh(Table):
    """How a body is divided into elements.

    Parameters
    ----------
    element : str
        The elements' shape.
    order : int
        Polynomial order of the displacement in an element.
    divisions : tuple of int, optional
        Elements along x, y and z; for hexahedra.
    size : float, optional
        Edge length of an element [m]; for tetrahedra.
    """

    element: Literal["hexahedron", "tetrahedron"] = "hexahedron"
    order: Annotated[int, Field(strict=True, ge=1, le=2)] = 2
    divisions: tuple[Count, Count, Count] | None = None
    size: PositiveLength | None = None

    @model_validator(mode="after")
    def _divided_one_way(self) -> Mesh:
        if self.element == "hexahedron":
            if self.size is not None:
                raise FaultError("belongs to tetrahedra; hexahedra take divisions, e.g. [48, 4, 2]", "size")
            if self.divisions is None:
                raise FaultError("is missing: hexahedra along x, y and z, e.g. [48, 4, 2]", "divisions")
        else:
            if self.divisions is not None:
                raise FaultError("belongs to hexahedra; tetrahedra take a size, e.g. '5 mm'", "divisions")
            if self.size is None:
                raise FaultError("is missing: the edge length of a tetrahedron, e.g. '5 mm'", "size")
        return self


class Modes(Table):
    """Which modes describe a body's deformation.

    Parameters
    ----------
    count : int
        How many, above the rigid-body modes.
    family : str
        The kind of motion that they are chosen from.
    boundary : str
        How the body is held while it vibrates, besides its supports: not at all, at the marker of the joint that
        carries it, or at its interface, whose static deflections are added (Craig & Bampton).
    interface : tuple of str
        The markers of the interface; all, if none is named.
    enrich : str
        What is added: the static responses to inertia loads and joint forces (``"inertia"``), or four generations of
        load-dependent vectors, each the responses to the inertia of the one before (``"ritz"``).
    damping : float
        Damping ratio of every mode.
    solver : str
        What factorises: the fastest that is installed, CHOLMOD, SciPy's SuperLU, or PETSc over several processes.
    ranks : int, optional
        How many processes, with ``slepc``.
    """

    count: Count
    family: Literal["any", "in-plane bending", "out-of-plane bending", "torsion", "axial"] = "any"
    boundary: Literal["free", "joint", "interface"] = "free"
    interface: tuple[Place, ...] = ()
    enrich: Literal["none", "inertia", "ritz"] = "none"
    damping: Annotated[Number, Field(ge=0.0, lt=1.0)] = 0.0
    solver: Literal["auto", "cholesky", "superlu", "slepc"] = "auto"
    ranks: Annotated[int, Field(strict=True, ge=1, le=100_000)] | None = None

    @model_validator(mode="after")
    def _ranks_of_slepc(self) -> Modes:
        if self.ranks is not None and self.solver != "slepc":
            raise FaultError("belongs to solver = 'slepc'; the others are one process", "ranks")
        return self

    @model_validator(mode="after")
    def _of_an_interface(self) -> Modes:
        if self.boundary != "interface" and self.interface:
            raise FaultError('belongs to boundary = "interface"', "interface")
        if self.boundary == "interface" and self.family != "any":
            raise FaultError("can't be chosen: deflections by an interface are of every kind", "family")
        return self


class Marker(Table):
    """A face of a flexible body, named for joints, loads and results; the face is told in one way.

    Parameters
    ----------
    face : str or tuple of str, optional
        One or several of the shape's faces.
    near : tuple of float, optional
        A point [m]: the smooth face nearest to it, up to edges sharper than 40°.
    plane : tuple, optional
        All of the surface in a plane: number of its axis and place on it [m]; written ``"x = 0"``.
    nodes : tuple of int, optional
        Nodes of a body that is given by its matrices, by their numbers there.
    attachment : str
        Whether the marker follows the face in the mean (RBE3) or holds it rigid (RBE2).
    """

    face: Place | Annotated[tuple[Place, ...], Field(min_length=1, max_length=100)] | None = None
    near: tuple[Length, Length, Length] | None = None
    plane: Plane | None = None
    nodes: tuple[int, ...] | None = None
    attachment: Literal["averaged", "rigid"] = "averaged"

    @property
    def faces(self) -> tuple[str, ...]:
        """Names of its faces; none if it is told by its place."""
        return (self.face,) if isinstance(self.face, str) else self.face or ()

    @property
    def where(self) -> dict[str, object]:
        """What tells its face, for hashing."""
        return self.model_dump(mode="json", include={"face", "near", "plane", "nodes"}, exclude_none=True)

    @model_validator(mode="after")
    def _told_one_way(self) -> Marker:
        ways = [way for way in ("face", "near", "plane", "nodes") if getattr(self, way) is not None]
        if not ways:
            raise FaultError("is missing: a face's name; or give near, a point, or plane, e.g. 'x = 0'", "face")
        if len(ways) > 1:
            raise FaultError(f"can't stand beside {ways[0]}: a marker's face is told in one way", ways[1])
        return self


class Support(Table):
    """Nodes that can't move in the body's frame: of faces, of a straight edge, or the one nearest to a point.

    Parameters
    ----------
    face : str or tuple of str
        One of the shape's faces, or what several have in common: two meet in an edge, three in a corner.
    edge : tuple, optional
        Two ends of a straight line [m].
    point : tuple of float, optional
        A place [m].
    fixed : tuple of str
        The directions in which the nodes are held.
    """

    face: Place | Annotated[tuple[Place, ...], Field(min_length=1, max_length=10)] = ()
    edge: tuple[Point, Point] | None = None
    point: Point | None = None
    fixed: Annotated[tuple[Literal["x", "y", "z"], ...], Field(min_length=1)] = ("x", "y", "z")

    @property
    def faces(self) -> tuple[str, ...]:
        """The faces, be it one or several."""
        return (self.face,) if isinstance(self.face, str) else self.face

    @model_validator(mode="after")
    def _somewhere(self) -> Support:
        given = [key for key in ("face", "edge", "point") if getattr(self, key)]
        if not given:
            raise FaultError("is missing: a face, e.g. 'x-', or an edge or a point", "face")
        if len(given) > 1:
            raise FaultError(f"can't stand beside {given[0]}: give one of them", given[1])
        if self.edge is not None and self.edge[0] == self.edge[1]:
            raise FaultError("has no length; a single place is a point", "edge")
        return self


class Element(Table):
    """A finite element, named for its stress: the one whose middle is nearest to ``at`` [m], in ``part`` if given."""

    at: tuple[Length, Length, Length]
    part: Place | None = None


class Solid(Table):
    """What every flexible body has, whatever its shape.

    Parameters
    ----------
    E : float
        Young's modulus [Pa].
    nu : float
        Poisson's ratio.
    rho : float
        Density [kg/m³].
    modes, marker, element
        Its modes, and its markers and named elements by name.
    support : tuple of Support
        What of it can't move in its frame.
    """

    E: PositiveStress
    nu: Poisson
    rho: PositiveDensity
    modes: Modes
    marker: dict[Name, Marker] = Field(default_factory=dict)
    support: tuple[Support, ...] = ()
    element: dict[Name, Element] = Field(default_factory=dict)

    @property
    def faces(self) -> tuple[str, ...] | None:
        """Names of the shape's faces; ``None`` if they are known only once there is a mesh."""
        raise NotImplementedError

    @property
    def parts(self) -> tuple[str, ...] | None:
        """Names of its mesh's parts; ``None`` likewise."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _on_a_mesh(self) -> Solid:
        for name, marker in self.marker.items():
            if marker.nodes is not None:
                raise FaultError("belong to a body that is given by its matrices", "marker", name, "nodes")
        return self

    @model_validator(mode="after")
    def _on_its_faces(self) -> Solid:
        faces, parts = self.faces, self.parts
        for name, marker in self.marker.items():
            unknown = [face for face in marker.faces if faces is not None and face not in faces]
            if unknown:
                message = f"no such face; {among(unknown[0], faces or (), 'the faces')}"
                raise FaultError(message, "marker", name, "face")
        for number, support in enumerate(self.support):
            for face in support.faces:
                if faces is not None and face not in faces:
                    raise FaultError(f"no such face; {among(face, faces, 'the faces')}", "support", number, "face")
        for number, name in enumerate(self.modes.interface):
            if name not in self.marker:
                message = f"no such marker; {among(name, self.marker, 'the markers')}"
                raise FaultError(message, "modes", "interface", number)
        if self.modes.boundary == "interface" and not self.marker:
            raise FaultError("has no marker to be an interface; give the body one", "modes", "boundary")
        if self.modes.boundary == "joint" and self.support:
            raise FaultError("can't stand beside supports, which hold the body at its joint", "modes", "boundary")
        for name, element in self.element.items():
            if parts is not None and element.part not in (None, *parts):
                message = f"no such part; {among(str(element.part), parts, 'the parts')}"
                raise FaultError(message, "element", name, "part")
        return self


class Bar(Solid):
    """A straight bar with a rectangular section.

    Parameters
    ----------
    length, depth, width : float
        Extent along x, y and z [m].
    mesh
        Its elements.
    """

    shape: Literal["bar"]
    length: PositiveLength
    depth: PositiveLength
    width: PositiveLength
    mesh: Mesh

    @property
    def faces(self) -> tuple[str, ...]:
        """``"x-"`` is where x is least."""
        return ("x-", "x+", "y-", "y+", "z-", "z+")

    @property
    def parts(self) -> tuple[str, ...]:
        """The whole."""
        return ("bar",)


class PropellerMesh(Table):
    """How a propeller is divided.

    Parameters
    ----------
    element : str
        ``tetrahedron`` puts six of them in place of each hexahedron.
    order : int
        Polynomial order of the displacement in an element; elements of order 2 have curved edges.
    sleeve : tuple of int
        Elements around, along the axis and along the radius.
    joint, blade : tuple of int
        Elements along the chord, which is the sleeve's axis at the root, across the thickness and along the radius; of
        each joint and each blade.
    growth : float
        Radial extent of a blade's elements at its tip over that at its root.
    """

    element: Literal["hexahedron", "tetrahedron"] = "hexahedron"
    order: Annotated[int, Field(strict=True, ge=1, le=2)] = 2
    sleeve: tuple[Count, Count, Count] = (66, 10, 3)
    joint: tuple[Count, Count, Count] = (10, 8, 12)
    blade: tuple[Count, Count, Count] = (10, 8, 27)
    growth: Annotated[Number, Field(ge=0.05, le=20.0)] = 4.0


class Propeller(Solid):
    """A propeller about the z axis: a sleeve, and blades that grow out of it through joints.

    Parameters
    ----------
    blades : int
        How many; the first is on the x axis.
    bore, hub, root, diameter : float
        Diameters [m]: of the sleeve's bore, of the sleeve, of the circle where joints become blades, of the whole.
    length : float
        Extent of the sleeve along z [m].
    chord, thickness : tuple of float
        Of the blade's section [m], at equal distances from root to tip.
    pitch : tuple of float
        Angle of the blade's section against the plane of rotation [rad], likewise.
    camber : float
        Rise of a section's middle line over its chord.
    edge : float
        Thickness of a section's edges over that of its middle.
    seat : float, optional
        Angle that each joint takes of the sleeve [rad]; by default its share of the elements around.
    mesh
        Its elements.
    """

    shape: Literal["propeller"]
    blades: Annotated[int, Field(strict=True, ge=2, le=24)]
    bore: PositiveLength
    hub: PositiveLength
    root: PositiveLength
    diameter: PositiveLength
    length: PositiveLength
    chord: Annotated[tuple[PositiveLength, ...], Field(min_length=1, max_length=20)]
    thickness: Annotated[tuple[PositiveLength, ...], Field(min_length=1, max_length=20)]
    pitch: Annotated[tuple[Angle, ...], Field(min_length=1, max_length=20)]
    camber: Annotated[Number, Field(ge=-0.2, le=0.2)] = 0.0
    edge: Annotated[Number, Field(ge=0.05, le=1.0)] = 0.3
    seat: Annotated[Angle, Field(gt=0)] | None = None
    mesh: PropellerMesh

    @property
    def faces(self) -> tuple[str, ...]:
        """The bore, the sleeve's ends at the least and the greatest z, and three faces of each blade."""
        of_blades = (f"{face}-{k + 1}" for k in range(self.blades) for face in ("tip", "pressure", "suction"))
        return ("bore", "back", "front", *of_blades)

    @property
    def parts(self) -> tuple[str, ...]:
        """The sleeve, all joints and all blades."""
        return ("sleeve", "joints", "blades")

    @model_validator(mode="after")
    def _grows_outwards(self) -> Propeller:
        inner = "bore"
        for outer in ("hub", "root", "diameter"):
            if not getattr(self, inner) < getattr(self, outer):
                raise FaultError(f"must be more than {inner}, {getattr(self, inner):g} m", outer)
            inner = outer
        return self

    @model_validator(mode="after")
    def _conforms(self) -> Propeller:
        """One mesh: the sleeve's cells come in equal sectors, and joints and blades go on from them."""
        (around, axial, _), (chordwise, across, _) = self.mesh.sleeve, self.mesh.joint
        per_blade = max(round(around / self.blades), 2)
        if around != per_blade * self.blades:
            message = f"can't be shared by {self.blades} blades; the nearest that can is {per_blade * self.blades}"
            raise FaultError(message, "mesh", "sleeve", 0)
        if chordwise != axial:
            raise FaultError(f"must be the sleeve's number along the axis, {axial}", "mesh", "joint", 0)
        if across >= per_blade:
            message = f"leaves no gap between blades; at most {per_blade - 1} of the {per_blade} around fit"
            raise FaultError(message, "mesh", "joint", 1)
        for k in (0, 1):
            if self.mesh.blade[k] != self.mesh.joint[k]:
                raise FaultError(f"must be the joint's, {self.mesh.joint[k]}", "mesh", "blade", k)
        return self

    @model_validator(mode="after")
    def _leaves_gaps(self) -> Propeller:
        if self.seat is not None and not self.seat < 2 * pi / self.blades:
            raise FaultError(f"leaves no gap between blades; must be less than {360 / self.blades:g} deg", "seat")
        return self
