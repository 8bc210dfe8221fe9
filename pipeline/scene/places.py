"""Places on a flexible body: its markers, its supports and the elements that are named for their stress."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pipeline.core.units import Length
from pipeline.scene.reading import FaultError, SceneTable
from pipeline.scene.values import Place, Plane, Point


class MarkerPlace(SceneTable):
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
    def _told_one_way(self) -> MarkerPlace:
        ways = [way for way in ("face", "near", "plane", "nodes") if getattr(self, way) is not None]
        if not ways:
            raise FaultError("is missing: a face's name; or give near, a point, or plane, e.g. 'x = 0'", "face")
        if len(ways) > 1:
            raise FaultError(f"can't stand beside {ways[0]}: a marker's face is told in one way", ways[1])
        return self


class Support(SceneTable):
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


class NamedElement(SceneTable):
    """A finite element, named for its stress: the one whose middle is nearest to ``at`` [m], in ``part`` if given."""

    at: tuple[Length, Length, Length]
    part: Place | None = None
