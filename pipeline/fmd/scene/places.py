"""Places in a scene file: markers, supports and named elements of a flexible body, and places on the ground."""

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from fmd.core.units import QuantityReader
from fmd.scene.orientation import Orientation
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import FaceName, LinkName, PartName, Plane, Point, Turn, Words

MARKER_WAYS = ("face", "near", "plane", "edge", "at", "node", "nodes", "link")


def _read_edge(edge: object, info: ValidationInfo) -> object:
    """Read two points, or the names of two faces."""
    if isinstance(edge, list | tuple) and len(edge) == 2 and edge[0] != edge[1]:
        if all(isinstance(face, str) for face in edge):
            return tuple(edge)
        if all(isinstance(end, list | tuple) and len(end) == 3 for end in edge):
            length = QuantityReader("length")
            return tuple(tuple(length(x, info) for x in end) for end in edge)
    raise ValueError("must be two different points, or the names of two faces that meet in it")


Edge = Annotated[tuple[Any, Any], BeforeValidator(_read_edge), Words("list of 2 points or of 2 names of faces")]


def _refuse_number(value: object) -> object:
    if isinstance(value, int) and not isinstance(value, bool):
        raise ValueError(
            f"must be a place, e.g. ['10 mm', '0 mm', '0 mm']; a point of a deck's links is link = {value}"
        )
    return value


class MarkerPlace(Orientation):
    """A named place on a flexible body, where joints and loads act and motion is recorded, with axes of its own.

    Exactly one of ``face``, ``near``, ``plane``, ``edge``, ``at``, ``node``, ``nodes`` and ``link`` says where it is. A
    force at a point or on an edge has no finite deflection under it: on finer meshes it grows, and so does the stress
    around it, which is left out of the largest stress. Take faces for joints and loads, points for results.

    Example:

        [body.bracket.marker]
        bore = { face = "bore" }
        lid = { face = ["lid-left", "lid-right"], attachment = "rigid" }
        corner = { near = ["31 mm", "20 mm", "4 mm"] }
        wall = { plane = "x = 0" }
        rim = { edge = ["lid-left", "bore"] }
        sensor = { at = ["12 mm", "4 mm", "4 mm"], rotate = ["0 deg", "0 deg", "30 deg"] }
    """

    # One face of the shape, or several that make one marker. The faces of each shape are listed with it; those of a
    # mesh or CAD file are printed by ``fmd mesh``.
    face: FaceName | Annotated[tuple[FaceName, ...], Field(min_length=1, max_length=100)] | None = None
    near: Point | None = None  # A point [m]; the marker is the smooth face nearest to it, up to edges sharper than 40°.
    plane: Plane | None = None  # Plane; all of the surface in it is the marker.
    edge: Edge | None = None  # Two ends of a straight edge [m], or the names of two faces that meet in an edge.
    # A point in or on the body [m]; the marker moves and turns as the material there, by interpolation.
    at: Point | None = None
    # A point [m]; the marker is the node nearest to it.
    node: Annotated[Point | None, BeforeValidator(_refuse_number)] = None
    nodes: tuple[int, ...] | None = None  # Numbers of the nodes in the file, for a body that is given by its matrices.
    # Name of a link of the body; the marker is its reference point. Of a deck's links the number of a point, or the
    # name of a set that holds it alone.
    link: LinkName | None = None
    # How the marker follows its nodes: their mean motion (``"averaged"``, RBE3), which leaves the face free to deform,
    # or as a rigid face (``"rigid"``, RBE2). Points and edges have no other than ``"averaged"``. By default a face by
    # which a fixed joint clamps a body that touches no other is rigid if it is broad, of more than a quarter of the
    # body's reach from it, or of several beams; all others are averaged.
    attachment: Literal["averaged", "rigid"] | None = None

    @property
    def faces(self) -> tuple[str, ...]:
        """Names of its faces; empty if another key says where it is."""
        return (self.face,) if isinstance(self.face, str) else self.face or ()

    @property
    def is_face(self) -> bool:
        """True if the marker is on faces; else it is at a point, a node or an edge."""
        return self.face is not None or self.near is not None or self.plane is not None

    @property
    def where(self) -> dict[str, object]:
        """The one key that says where the marker is, with its value, for hashing."""
        return self.model_dump(mode="json", include=set(MARKER_WAYS), exclude_none=True)

    def _check(self) -> None:
        ways = [way for way in MARKER_WAYS if getattr(self, way) is not None]
        if not ways:
            raise FaultError("is missing: a face's name; or give near, a point, or plane, e.g. 'x = 0'", "face")
        if len(ways) > 1:
            raise FaultError(f"can't stand beside {ways[0]}: a marker's place is told in one way", ways[1])
        if ways[0] in ("edge", "at", "node", "link") and self.attachment == "rigid":
            raise FaultError("needs a face; a marker at a point, on an edge or on a link is averaged", "attachment")

    @property
    def edge_faces(self) -> tuple[str, ...]:
        """Names of the two faces that meet in the marker's edge; empty if it has none, or one given by its ends."""
        return self.edge if self.edge is not None and isinstance(self.edge[0], str) else ()


class Support(SceneTable):
    """Nodes of a flexible body that can't move in the body's frame.

    Exactly one of ``face``, ``plane``, ``edge`` and ``point`` says which nodes.

    Example:

        [[body.plate.support]]
        face = ["x-", "z-"]
        fixed = ["y", "z"]

        [[body.plate.support]]
        point = ["0 m", "0 m", "0 m"]
    """

    # One face, or the nodes that several faces have in common: two meet in an edge, three in a corner. A node set of a
    # file holds all of its nodes.
    face: FaceName | Annotated[tuple[FaceName, ...], Field(min_length=1, max_length=10)] = ()
    plane: Plane | None = None  # Plane; all of the surface in it is held.
    edge: tuple[Point, Point] | None = None  # Two ends of a straight line of nodes [m].
    point: Point | None = None  # A point [m]; the node nearest to it is held.
    # Directions in which the nodes are held.
    fixed: Annotated[tuple[Literal["x", "y", "z"], ...], Field(min_length=1)] = ("x", "y", "z")

    @property
    def faces(self) -> tuple[str, ...]:
        """Names of its faces, one or several; empty if another key says where it is."""
        return (self.face,) if isinstance(self.face, str) else self.face

    def _check(self) -> None:
        given = [key for key in ("face", "plane", "edge", "point") if getattr(self, key)]
        if not given:
            raise FaultError("is missing: a face, e.g. 'x-', or a plane, e.g. 'x = 0', an edge or a point", "face")
        if len(given) > 1:
            raise FaultError(f"can't stand beside {given[0]}: give one of them", given[1])
        if self.edge is not None and self.edge[0] == self.edge[1]:
            raise FaultError("has no length; a single place is a point", "edge")


class NamedElement(SceneTable):
    """A finite element of a flexible body, named so that a chart can draw its stress over time.

    Example:

        [body.propeller.element]
        joint = { part = "joints", at = ["86 mm", "4 mm", "5 mm"] }
    """

    # A point of the body's frame [m]; the element whose middle is nearest to it is meant, of a shell its nearer face.
    at: Point
    part: PartName | None = None  # Part of the mesh that the element is looked for in, e.g. ``"joints"``.


class GroundPlace(Orientation):
    """A named place on the ground, which stands still; joints hang on it as on a marker, ``"ground.NAME"``.

    Its axes are those of space, or turned against them; a joint's axis, and the body that it carries, are in them.

    Example:

        [ground.bearing]
        at = ["1 m", "0 m", "0 m"]
        rotate = ["0 deg", "0 deg", "90 deg"]
    """

    at: Point  # Position in space [m].
    rotation: Turn | None = None  # Older name of ``rotate`` [rad].

    @model_validator(mode="after")
    def _read_the_older_name(self) -> Self:
        if self.rotation is None:
            return self
        if self.is_turned:
            raise FaultError("can't stand beside rotate or axes: give one of them", "rotation")
        return self.model_copy(update={"rotate": self.rotation, "rotation": None})
