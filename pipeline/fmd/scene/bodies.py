"""Flexible bodies in a scene file: material, modes, sectors and places of each, and what is linked to it."""

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field

from fmd.core.limits.scene import MOST_CUT_PIECES, MOST_SECTORS
from fmd.core.units import PositiveDensity, PositiveLength, PositiveMass, PositiveStress
from fmd.scene.modes import ModeSettings, RayleighDamping
from fmd.scene.places import MarkerPlace, NamedElement, Support
from fmd.scene.reading import FaultError, SceneTable, UnknownNameError
from fmd.scene.rigid_bodies import Moment, require_possible_moments
from fmd.scene.values import FaceName, Formulation, LinkName, Name, Plane, Point, Poisson, Text, Words


class FaceLink(SceneTable):
    """A reference point, as the middle of a bearing, that moves a face rigidly or follows it in the mean.

    Exactly one of ``face``, ``near`` and ``plane`` says which face, as for a marker. Other parts hang on the reference
    by a marker ``{ link = "NAME" }``, and a lumped mass by its ``at``.

    Example:

        [body.bracket.link]
        bearing = { face = "bore", type = "rigid", at = ["42 mm", "0 mm", "30 mm"] }
    """

    # One face of the shape, or several that make one.
    face: FaceName | Annotated[tuple[FaceName, ...], Field(min_length=1, max_length=100)] | None = None
    near: Point | None = None  # A point [m]; the smooth face nearest to it is meant.
    plane: Plane | None = None  # Plane; all of the surface in it is the face.
    # ``"rigid"`` (RBE2): the face moves as a rigid piece; ``"average"`` (RBE3): the reference moves as the face does in
    # the mean, each part of it weighted by its area, and leaves it free to deform.
    type: Literal["rigid", "average"]
    at: Point | None = None  # The reference point [m]; the middle of the face by default.

    @property
    def faces(self) -> tuple[str, ...]:
        """Names of its faces; empty if another key says where it is."""
        return (self.face,) if isinstance(self.face, str) else self.face or ()

    def _check(self) -> None:
        given = [key for key in ("face", "near", "plane") if getattr(self, key) is not None]
        if not given:
            raise FaultError("is missing: a face's name; or give near, a point, or plane, e.g. 'x = 0'", "face")
        if len(given) > 1:
            raise FaultError(f"can't stand beside {given[0]}: a link's face is given in one way", given[1])


class MassOnLink(SceneTable):
    """A rigid body on the reference point of a link: a motor, a wheel, what is bolted on.

    Example:

        [body.bracket.mass]
        motor = { at = "bearing", mass = "0.4 kg", inertia = ["1e-4 kg m^2", "1e-4 kg m^2", "2e-4 kg m^2"] }
    """

    at: LinkName  # Name of the link, or number or set of a point of the deck's links.
    mass: PositiveMass  # [kg]
    centre: Point | None = None  # Centre of mass in the part's coordinates [m]; the reference point by default.
    # Moments about the centre of mass, along the part's x, y and z [kg m²].
    inertia: tuple[Moment, Moment, Moment] = (0.0, 0.0, 0.0)

    def _check(self) -> None:
        require_possible_moments(self.inertia)


class TiedFace(SceneTable):
    """A face that stays together with another, of a part whose mesh has no nodes in common with its own.

    Example:

        [[body.box.mesh.tie]]
        face = "lid-rim"
        onto = "box-rim"
    """

    face: FaceName  # The face that follows: that of the finer mesh, on which no rigid link or rigid attachment is.
    onto: FaceName  # The face that it follows.
    # How far apart both may be [m]; by default a tenth of a facet's size, of edges of shells half of both thicknesses.
    within: PositiveLength | None = None


def _read_pieces(value: object) -> object:
    if value == "auto" or (isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= MOST_CUT_PIECES):
        return value
    raise ValueError(f"must be a whole number from 1 to {MOST_CUT_PIECES}, or 'auto'")


Pieces = Annotated[
    int | Literal["auto"], BeforeValidator(_read_pieces), Words(f'whole number, 1 to {MOST_CUT_PIECES}, or ``"auto"``')
]


class Deformable(SceneTable):
    """Every flexible body: how its mesh can be changed, which is not at all where a file holds the mesh.

    Changes are values of the table's keys.
    """

    # Table that names the files that the body comes from, and the keys there; empty if it comes from none.
    file_keys: ClassVar[tuple[str, ...]] = ()

    @property
    def may_have_stress(self) -> bool:
        """False if no element and no file can tell its stress."""
        return True

    def of_order(self, order: int) -> dict[str, Any]:
        """Return the changes for elements of another order."""
        return {}

    def resized(self, factor: float) -> dict[str, Any]:
        """Return the changes for a mesh with about ``factor`` times the elements each way."""
        return {}

    def divided_more(self) -> dict[str, Any]:
        """Return the changes for more elements where there are so few from side to side that fewer tell nothing."""
        return {}

    def halved(self) -> dict[str, Any]:
        """Return the changes for half the size of elements that a file has, where they can be divided."""
        return {}

    def with_elements_of(self, first: Self) -> Self:
        """Return the body with the elements of another one, which differs in its dimensions."""
        return self

    @property
    def kept_elements(self) -> str:
        """Key and value, ``mesh.made_at=...``, that keep its elements at other dimensions; empty if none has to."""
        return ""

    @property
    def divided_directions(self) -> int:
        """Number of directions with more than one element, which a coarser mesh has fewer in."""
        return 3


def scale_count(count: int, factor: float) -> int:
    """Return about ``factor`` times a number of elements, an even number if they are more."""
    return max(1, int(count * factor)) if factor < 1 else 2 * round(count * factor / 2)


class Solid(Deformable):
    """Keys of every flexible body that has a mesh, whatever its shape."""

    deck_may_have_links: ClassVar[bool] = False

    E: PositiveStress  # Young's modulus [Pa].
    nu: Poisson  # Poisson's ratio.
    rho: PositiveDensity  # Density [kg/m³].
    modes: ModeSettings  # Modes that describe the deformation.
    marker: dict[Name, MarkerPlace] = Field(default_factory=dict)  # Places for joints, loads and results, by name.
    support: tuple[Support, ...] = ()  # Nodes that can't move in the body's frame.
    # Elements whose stress is wanted over time, by name.
    element: dict[Name, NamedElement] = Field(default_factory=dict)
    link: dict[Name, FaceLink] = Field(default_factory=dict)  # Reference points that faces are linked to, by name.
    mass: dict[Name, MassOnLink] = Field(default_factory=dict)  # Rigid bodies on links, by name.
    # Number of pieces that the body is cut into for large deflections. Each has a frame of its own, ``modes.count``
    # modes fixed at its cuts, and static deflections by these. ``"auto"`` doubles it until deflections within the
    # pieces are small enough for the scene's accuracy, or 1 % without one.
    pieces: Pieces = 1
    # How pieces are welded at a cut: by the motion on which the tractions of the part's own static deflections do work
    # (``"tractions"``), which leaves its flexibility as it is, by six motions more, on which tractions of its lowest
    # modes do work (``"warping"``), where walls are thin, by the section's mean motion (``"averaged"``), too soft in
    # torsion and shear, or as a rigid section (``"rigid"``), which also holds its contraction and warping.
    sections: Literal["tractions", "warping", "averaged", "rigid"] = "tractions"

    @property
    def is_beam(self) -> bool:
        """True if it is a line of beams."""
        return False

    @property
    def faces(self) -> tuple[str, ...] | None:
        """Names of the shape's faces; ``None`` if they are known only once there is a mesh."""
        raise NotImplementedError

    @property
    def parts(self) -> tuple[str, ...] | None:
        """Names of the mesh's parts; ``None`` if they are known only once there is a mesh."""
        raise NotImplementedError

    def _check(self) -> None:
        self._check_places()
        self._check_links()
        self._check_pieces()

    def _check_places(self) -> None:
        """Raise the fault of a marker, support, interface or element that the shape doesn't have."""
        for name, marker in self.marker.items():
            if marker.nodes is not None:
                raise FaultError("belong to a body that is given by its matrices", "marker", name, "nodes")
            self._check_faces(marker.faces, "marker", name, "face")
            self._check_faces(marker.edge_faces, "marker", name, "edge")
        for number, support in enumerate(self.support):
            self._check_faces(support.faces, "support", number, "face")
        require_interface(self)
        if self.modes.boundary == "interface" and not self.marker:
            raise FaultError("has no marker to be an interface; give the body one", "modes", "boundary")
        if self.modes.boundary == "joint" and self.support:
            raise FaultError("can't stand beside supports, which hold the body at its joint", "modes", "boundary")
        for name, element in self.element.items():
            if self.parts is not None and element.part not in (None, *self.parts):
                raise UnknownNameError("part", str(element.part), self.parts, "the parts", "element", name, "part")

    def _check_links(self) -> None:
        """Raise the fault of a link, or of a name of one."""
        for name, link in self.link.items():
            self._check_faces(link.faces, "link", name, "face")
        at = {("mass", name, "at"): mass.at for name, mass in self.mass.items()}
        at |= {("marker", name, "link"): marker.link for name, marker in self.marker.items() if marker.link}
        for path, name in at.items():
            if name not in self.link and not self.deck_may_have_links:
                raise UnknownNameError("link", name, self.link, "the body's links", *path)

    def _check_pieces(self) -> None:
        """Raise the fault of a body that can't be cut into its pieces."""
        if self.pieces == 1:
            if "sections" in self.model_fields_set:
                raise FaultError("belongs to a body in pieces, e.g. pieces = 6", "sections")
            return
        if self.is_beam:
            raise FaultError(
                "is of solids and shells: beams aren't cut yet; join several bodies by fixed joints", "pieces"
            )
        if self.sections == "warping" and self.modes.family != "any":
            raise FaultError('"warping" is of modes of every family, which modes.family = "any" has', "sections")
        if self.modes.boundary == "joint":
            raise FaultError("is that of a body in one piece; pieces are fixed at their cuts", "modes", "boundary")
        damping = self.modes.damping
        if damping and not (isinstance(damping, RayleighDamping) and not damping.alpha):
            problem = (
                "is of the modes of a body in one piece; pieces take a factor of the stiffness, "
                "{ beta = '1 ms' }, which is 2 ζ/ω for a ratio ζ at a frequency ω in rad/s"
            )
            raise FaultError(problem, "modes", "damping")

    def _check_faces(self, given: tuple[str, ...], *path: str | int) -> None:
        """Raise the fault of the first face that the shape doesn't have, if its faces are known."""
        known = self.faces
        for face in given:
            if known is not None and face not in known:
                raise UnknownNameError("face", face, known, "the faces", *path)


def require_interface(body: Any) -> None:
    """Raise ``UnknownNameError`` if a body's modes name a marker that it doesn't have."""
    for number, name in enumerate(body.modes.interface):
        if name not in body.marker:
            raise UnknownNameError("marker", name, body.marker, "the markers", "modes", "interface", number)


class DividedMesh(SceneTable):
    """Keys of meshes that may have hexahedra."""

    # Strain of linear hexahedra: enhanced by terms that let them bend (``"enhanced"``), or that of the displacement
    # alone (``"plain"``), which is too stiff in bending.
    formulation: Formulation = "enhanced"

    def _check(self) -> None:
        other = getattr(self, "order", None) == 2 or getattr(self, "element", "hexahedron") != "hexahedron"
        if self.formulation == "plain" and other:
            raise FaultError("belongs to hexahedra of order 1; other elements have no such choice", "formulation")


class SectorMesh(SceneTable):
    """Keys of a mesh that may be that of one sector of a cyclic body, about the z axis."""

    # Number of sectors, 3 or more: the file has one of them, which is repeated.
    cyclic: Annotated[int, Field(strict=True, ge=3, le=MOST_SECTORS)] | None = None
    # The sector's two faces that one turn carries into each other; a mesh has nodes at the same places of both.
    cuts: tuple[Text, Text] | None = None

    def _check(self) -> None:
        if (self.cyclic is None) != (self.cuts is None):
            raise FaultError("belong together: cyclic = 6, cuts = ['low', 'high']", "cyclic")
