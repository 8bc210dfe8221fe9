"""Flexible bodies in a scene file: material, modes and places of each, and the shape of a bar."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from fmd.core.limits.scene import MOST_CUT_PIECES
from fmd.core.units import PositiveDensity, PositiveLength, PositiveStress
from fmd.scene.damping import Damping, RayleighDamping
from fmd.scene.places import MarkerPlace, NamedElement, Support
from fmd.scene.reading import FaultError, SceneTable, UnknownNameError
from fmd.scene.values import Count, Formulation, Name, Number, Order, Text, Words


def _check_poisson(nu: float) -> float:
    if not nu > -1:
        raise ValueError("must be above -1; most metals have about 0.3")
    if not nu < 0.5:
        raise ValueError("must be below 0.5 (0.5 is incompressible); 0.499 works")
    return nu


Poisson = Annotated[Number, AfterValidator(_check_poisson), Words("number above -1 and below 0.5")]


def _check_pieces(value: object) -> object:
    if value == "auto" or (isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= MOST_CUT_PIECES):
        return value
    raise ValueError(f"must be a whole number from 1 to {MOST_CUT_PIECES}, or 'auto'")


Pieces = Annotated[
    int | Literal["auto"], BeforeValidator(_check_pieces), Words(f'whole number, 1 to {MOST_CUT_PIECES}, or ``"auto"``')
]


class ModeSettings(SceneTable):
    """The shapes that describe a flexible body's deformation, and how they are computed.

    Parameters
    ----------
    count : int
        Number of modes, above those of rigid motion. If the highest is one of a pair of equal frequency, the other is
        taken, too.
    family : str
        Kind of motion that the modes are chosen from; the lowest ``count`` of that kind are taken.
    boundary : str
        How the body is held while it vibrates: only by its supports (``"free"``), also at the marker of the joint that
        carries it (``"joint"``), or at its interface, whose static deflections are then added to the modes
        (``"interface"``; Craig & Bampton).
    interface : tuple of str
        Markers that make up the interface; all of the body's markers, if none is named.
    enrich : str
        Shapes that are added to the modes: none, the static responses to inertia loads and joint forces
        (``"inertia"``), which stress needs, or four generations of load-dependent vectors (``"ritz"``), each the
        responses to the inertia of the one before. ``"residual"`` are all static responses, however little of them lies
        outside the modes, as linear answers take them; so stiff shapes need short steps.
    damping : float, tuple of float or RayleighDamping
        Damping ratio of every mode, 1 being critical; or a list of ratios, of the modes of the body on its joint, the
        lowest first, whose last holds for all further ones; or factors of mass and stiffness.
    solver : str
        Program that factorises the stiffness: the fastest that is installed (``"auto"``), CHOLMOD, SciPy's SuperLU, or
        PETSc and SLEPc over several processes.
    ranks : int, optional
        Number of processes for ``solver = "slepc"``; 2 if it is left out.

    Examples
    --------
    ::

        [body.beam.modes]
        count = 5
        family = "in-plane bending"
        enrich = "inertia"
        damping = 0.01
    """

    count: Count
    family: Literal["any", "in-plane bending", "out-of-plane bending", "torsion", "axial"] = "any"
    boundary: Literal["free", "joint", "interface"] = "free"
    interface: tuple[Annotated[Text, Words("name of a marker")], ...] = ()
    enrich: Literal["none", "inertia", "ritz", "residual"] = "none"
    damping: Damping = 0.0
    solver: Literal["auto", "cholesky", "superlu", "slepc"] = "auto"
    ranks: Annotated[int, Field(strict=True, ge=1, le=100_000)] | None = None

    @model_validator(mode="after")
    def _ranks_of_slepc(self) -> ModeSettings:
        if self.ranks is not None and self.solver != "slepc":
            raise FaultError("belongs to solver = 'slepc'; the others are one process", "ranks")
        return self

    @model_validator(mode="after")
    def _of_an_interface(self) -> ModeSettings:
        if self.boundary != "interface" and self.interface:
            raise FaultError('belongs to boundary = "interface"', "interface")
        if self.boundary == "interface" and self.family != "any":
            raise FaultError("can't be chosen: deflections by an interface are of every kind", "family")
        return self


class Deformable(SceneTable):
    """Every flexible body: how its mesh can be changed, which is not at all where a file holds the mesh.

    Changes are values of the table's keys.
    """

    def of_order(self, order: int) -> dict[str, Any]:
        """Return the changes for elements of another order."""
        return {}

    def resized(self, factor: float) -> dict[str, Any]:
        """Return the changes for a mesh with about ``factor`` times the elements each way."""
        return {}

    def divided_more(self) -> dict[str, Any]:
        """Return the changes for more elements where there are so few from side to side that fewer tell nothing."""
        return {}

    @property
    def divided_directions(self) -> int:
        """Number of directions with more than one element, which a coarser mesh has fewer in."""
        return 3


def scale_count(count: int, factor: float) -> int:
    """Return about ``factor`` times a number of elements, an even number if they are more."""
    return max(1, int(count * factor)) if factor < 1 else 2 * round(count * factor / 2)


class Solid(Deformable):
    """Keys of every flexible body that has a mesh, whatever its shape.

    Parameters
    ----------
    E : float
        Young's modulus [Pa].
    nu : float
        Poisson's ratio.
    rho : float
        Density [kg/m³].
    modes : ModeSettings
        Modes that describe the deformation.
    marker : dict of str to MarkerPlace
        Places for joints, loads and results, by name.
    support : tuple of Support
        Nodes that can't move in the body's frame.
    element : dict of str to NamedElement
        Elements whose stress is wanted over time, by name.
    pieces : int or str
        Number of pieces that the body is cut into for large deflections. Each has a frame of its own, ``modes.count``
        modes fixed at its cuts, and static deflections by these. ``"auto"`` doubles it until deflections within the
        pieces are small enough for the scene's accuracy, or 1 % without one.
    sections : str
        How pieces are welded at a cut: by the motion on which the tractions of the part's own static deflections do
        work (``"tractions"``), which leaves its flexibility as it is, by the section's mean motion (``"averaged"``),
        too soft in torsion and shear, or as a rigid section (``"rigid"``), which also holds its contraction and
        warping.
    """

    E: PositiveStress
    nu: Poisson
    rho: PositiveDensity
    modes: ModeSettings
    marker: dict[Name, MarkerPlace] = Field(default_factory=dict)
    support: tuple[Support, ...] = ()
    element: dict[Name, NamedElement] = Field(default_factory=dict)
    pieces: Pieces = 1
    sections: Literal["tractions", "averaged", "rigid"] = "tractions"

    @property
    def faces(self) -> tuple[str, ...] | None:
        """Names of the shape's faces; ``None`` if they are known only once there is a mesh."""
        raise NotImplementedError

    @property
    def parts(self) -> tuple[str, ...] | None:
        """Names of the mesh's parts; ``None`` if they are known only once there is a mesh."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _on_a_mesh(self) -> Solid:
        for name, marker in self.marker.items():
            if marker.nodes is not None:
                raise FaultError("belong to a body that is given by its matrices", "marker", name, "nodes")
        return self

    @model_validator(mode="after")
    def _on_its_faces(self) -> Solid:
        for name, marker in self.marker.items():
            self._check_faces(marker.faces, "marker", name, "face")
            self._check_faces(marker.edge_faces, "marker", name, "edge")
        for number, support in enumerate(self.support):
            self._check_faces(support.faces, "support", number, "face")
        for number, name in enumerate(self.modes.interface):
            if name not in self.marker:
                raise UnknownNameError("marker", name, self.marker, "the markers", "modes", "interface", number)
        if self.modes.boundary == "interface" and not self.marker:
            raise FaultError("has no marker to be an interface; give the body one", "modes", "boundary")
        if self.modes.boundary == "joint" and self.support:
            raise FaultError("can't stand beside supports, which hold the body at its joint", "modes", "boundary")
        for name, element in self.element.items():
            if self.parts is not None and element.part not in (None, *self.parts):
                raise UnknownNameError("part", str(element.part), self.parts, "the parts", "element", name, "part")
        return self

    @model_validator(mode="after")
    def _in_pieces(self) -> Solid:
        if self.pieces == 1:
            if "sections" in self.model_fields_set:
                raise FaultError("belongs to a body in pieces, e.g. pieces = 6", "sections")
            return self
        if self.modes.boundary == "joint":
            raise FaultError("is that of a body in one piece; pieces are fixed at their cuts", "modes", "boundary")
        damping = self.modes.damping
        if damping and not (isinstance(damping, RayleighDamping) and not damping.alpha):
            problem = (
                "is of the modes of a body in one piece; pieces take a factor of the stiffness, "
                "{ beta = '1 ms' }, which is 2 ζ/ω for a ratio ζ at a frequency ω in rad/s"
            )
            raise FaultError(problem, "modes", "damping")
        return self

    def _check_faces(self, given: tuple[str, ...], *path: str | int) -> None:
        """Raise the fault of the first face that the shape doesn't have, if its faces are known."""
        known = self.faces
        for face in given:
            if known is not None and face not in known:
                raise UnknownNameError("face", face, known, "the faces", *path)


def check_formulation(formulation: Formulation, order: int | None, element: str = "hexahedron") -> None:
    """Raise the fault of a formulation that elements of this order and shape don't have."""
    if formulation == "plain" and (order == 2 or element != "hexahedron"):
        raise FaultError("belongs to hexahedra of order 1; other elements have no such choice", "formulation")


class BarMesh(SceneTable):
    """Division of a bar into elements: hexahedra by their numbers, tetrahedra by their size.

    Parameters
    ----------
    element : str
        Shape of the elements.
    order : int
        Polynomial order of the displacement in an element; linear tetrahedra are too stiff in bending.
    formulation : str
        Strain of linear hexahedra: enhanced by terms that let them bend (``"enhanced"``), or that of the displacement
        alone (``"plain"``), which is too stiff in bending.
    divisions : tuple of int, optional
        Numbers of hexahedra along x, y and z; required for hexahedra.
    size : float, optional
        Edge length of a tetrahedron [m]; required for tetrahedra.

    Examples
    --------
    ::

        [body.beam.mesh]
        element = "hexahedron"
        divisions = [30, 3, 1]
    """

    element: Literal["hexahedron", "tetrahedron"] = "hexahedron"
    order: Order = 2
    formulation: Formulation = "enhanced"
    divisions: tuple[Count, Count, Count] | None = None
    size: PositiveLength | None = None

    @model_validator(mode="after")
    def _divided_one_way(self) -> BarMesh:
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

    @model_validator(mode="after")
    def _plain_if_linear(self) -> BarMesh:
        check_formulation(self.formulation, self.order, self.element)
        return self


class Bar(Solid):
    """A straight bar with a rectangular section, along x, centred on the x axis.

    Its faces are ``x-`` (where x is least), ``x+``, ``y-``, ``y+``, ``z-`` and ``z+``; its one part is ``bar``.

    Parameters
    ----------
    length : float
        Extent along x [m].
    depth : float
        Extent along y [m].
    width : float
        Extent along z [m].
    mesh : BarMesh
        Division into elements.

    Examples
    --------
    ::

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

    shape: Literal["bar"]
    length: PositiveLength
    depth: PositiveLength
    width: PositiveLength
    mesh: BarMesh

    @property
    def faces(self) -> tuple[str, ...]:
        """Names of the six faces; ``"x-"`` is where x is least."""
        return ("x-", "x+", "y-", "y+", "z-", "z+")

    @property
    def parts(self) -> tuple[str, ...]:
        """Name of the one part that the mesh of a bar has."""
        return ("bar",)

    def of_order(self, order: int) -> dict[str, Any]:
        """Return the changes for elements of another order."""
        return {"mesh": self.mesh.model_copy(update={"order": order})}

    def resized(self, factor: float) -> dict[str, Any]:
        """Return the changes for a mesh with about ``factor`` times the elements each way."""
        if self.mesh.divisions is None:
            assert self.mesh.size is not None
            return {"mesh": self.mesh.model_copy(update={"size": self.mesh.size / factor})}
        return self._divided(tuple(scale_count(count, factor) for count in self.mesh.divisions))

    def divided_more(self) -> dict[str, Any]:
        """Return the changes for two elements in place of one quadratic, or of two linear ones, which bend alike."""
        order = self.mesh.order
        if self.mesh.divisions is None:
            return {}
        return self._divided(tuple(4 // order if count * order <= 2 else count for count in self.mesh.divisions))

    @property
    def divided_directions(self) -> int:
        """Number of directions with more than one element."""
        return 3 if self.mesh.divisions is None else max(1, sum(count > 1 for count in self.mesh.divisions))

    def _divided(self, divisions: tuple[int, ...]) -> dict[str, Any]:
        return {"mesh": self.mesh.model_copy(update={"divisions": divisions})}
