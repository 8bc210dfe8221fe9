"""Markers, links and supports of a flexible body on its mesh or on the nodes of its matrices."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError, as_input_error
from fmd.core.limits.mesh import BROAD_CLAMP
from fmd.fem.deck_links import find_deck_links
from fmd.fem.formats.matrices import node_marker, nodes_in_plane
from fmd.fem.formats.matrix_model import MatrixModel
from fmd.fem.joined import AnySpace, JoinedSpace
from fmd.fem.links import Linked, LinkedFace, LinkedModel, LumpedMass, link_points
from fmd.fem.local_markers import edge_marker, point_marker, single_node_marker
from fmd.fem.markers import Marker, face_marker, facets_on_face
from fmd.fem.model import FEModel
from fmd.fem.selection import facets_in_plane, facets_near, node_at, nodes_on_edge, nodes_on_faces, points_of_nodes
from fmd.fem.space import Discretisation
from fmd.scene.any_body import Flexible
from fmd.scene.bodies import FaceLink
from fmd.scene.places import MarkerPlace
from fmd.stages.meshing.bodies import find_name

T = TypeVar("T")


def place_markers(
    shape: Flexible, space: AnySpace, file: str, body: str, given: Mapping[str, Marker] | None = None
) -> dict[str, Marker]:
    """Place a body's markers on the surface of its mesh, but for those that are given, as those of links are.

    Raises
    ------
    InputError
        A face isn't there, or no part of the surface is.
    """

    def place(name: str, marker: MarkerPlace) -> Marker:
        if given is not None and name in given:
            return given[name]
        rigid = marker.attachment == "rigid"
        if marker.at is not None:
            return point_marker(space, np.array(marker.at))
        if marker.node is not None:
            return single_node_marker(space, int(node_at(space, np.array(marker.node))[0]))
        if marker.edge is not None and not marker.edge_faces:
            nodes = nodes_on_edge(space, np.array(marker.edge))
            if space.mesh.midsurface is not None:
                return face_marker(space, points_of_nodes(space, nodes))
            return edge_marker(_alone(space, "an edge"), nodes)
        if marker.edge_faces:
            key = f"body.{body}.marker.{name}.edge"
            names = [find_name(space.mesh.faces, face, file, key) for face in marker.edge_faces]
            nodes = nodes_on_faces(space, [space.mesh.faces[face] for face in names])
            return edge_marker(_alone(space, "an edge"), nodes)
        faces = _faces(shape, space, marker, file, f"body.{body}.marker.{name}")
        return face_marker(space, faces, rigid, _centre_by_geometry(space, faces))

    return _placed(shape, place, file, body)


def clamp_broad(marker: Marker, space: AnySpace, others: Mapping[str, Marker]) -> Marker:
    """Return the marker of a clamped face, rigid if the face is broad beside the body's reach from it.

    Averaged, a broad face warps and bends, and ends of several beams turn each by itself, which no clamp allows. Where
    nodes of another rigid face are on it, it stays averaged, and so does one section of a beam, which moves as a whole.
    """
    nodes = [other.nodes for other in others.values() if other.rigid]
    if nodes and np.isin(marker.nodes, np.concatenate(nodes)).any():
        return marker
    if (line := space.mesh.midsurface) is not None and line.has_sections:
        return replace(marker, rigid=len(np.unique(line.owner[marker.nodes])) > 1)
    away = np.linalg.norm(space.x - marker.position, axis=1)
    broad = 2 * away[marker.nodes].max() > BROAD_CLAMP * away.max()
    return replace(marker, rigid=True) if broad else marker


def place_link_markers(shape: Flexible, model: Callable[[], FEModel], file: str, body: str) -> dict[str, Marker]:
    """Place those of a body's markers that are on its links; the model is made only if there are any.

    Raises
    ------
    InputError
        There is no such link in the deck.
    """
    links = {name: at.link for name, at in shape.marker.items() if isinstance(at, MarkerPlace) and at.link is not None}
    if not links:
        return {}
    fe = model()
    if not isinstance(fe, LinkedModel):
        name, link = next(iter(links.items()))
        raise InputError(file, f"body.{body}.marker.{name}.link", link, "is of a deck without links")
    return {
        name: fe.marker(find_name(fe.references, link, file, f"body.{body}.marker.{name}.link", "link"))
        for name, link in links.items()
    }


def add_links(shape: Flexible, fe: FEModel, file: str, body: str) -> FEModel:
    """Return the model of a body with its links and lumped masses and those of its deck; itself if there are none.

    Raises
    ------
    InputError
        A face isn't there, two rigid links share nodes, or a connection of the deck can't be used.
    """
    space = fe.discretisation
    deck = space.mesh.connections
    if not shape.link and deck is None:
        return fe
    with_nodes = isinstance(space, JoinedSpace) or (deck is not None and len(deck.all) > len(deck.ties))
    if with_nodes and space.order != space.mesh.order:
        raise InputError(file, f"body.{body}.mesh.order", space.order, "adds nodes that the deck's links don't have")
    with as_input_error(file, f"body.{body}.mesh.file"):
        linked = Linked() if deck is None else find_deck_links(deck, fe)
    links = dict(linked.links)
    for name, given in shape.link.items():
        key = f"body.{body}.link.{name}"
        with as_input_error(file, key, given.face or given.plane or given.near):
            marker = face_marker(space, _faces(shape, space, given, file, key), given.type == "rigid")
        links[name] = LinkedFace(marker, marker.position if given.at is None else np.array(given.at))
    at = {name: (name, link.at) for name, link in links.items()} | dict(linked.places)
    masses = list(linked.masses)
    for name, own in shape.mass.items():
        link, place = at[find_name(at, own.at, file, f"body.{body}.mass.{name}.at", "link")]
        masses.append(
            LumpedMass(link, own.mass, place if own.centre is None else np.array(own.centre), np.diag(own.inertia))
        )
    with as_input_error(file, f"body.{body}.{'link' if shape.link else 'mesh.file'}"):
        return link_points(fe, replace(linked, links=links, masses=masses))


def find_marker_facets(shape: Flexible, space: AnySpace, file: str, body: str) -> dict[str, IntArray]:
    """Find the boundary facets of each marker of a body that is on a face; raises as `place_markers`."""

    def find(name: str, marker: MarkerPlace) -> IntArray:
        faces = _faces(shape, space, marker, file, f"body.{body}.marker.{name}")
        alone = _alone(space, "contact and pieces")
        facets = np.unique(np.concatenate([facets_on_face(alone, face) for face in faces]))
        if not facets.size:
            raise ValueError("no boundary facet of the mesh lies on the face")
        return facets

    on_faces = {name: at for name, at in shape.marker.items() if isinstance(at, MarkerPlace) and at.is_face}
    return _placed(shape.model_copy(update={"marker": on_faces}), find, file, body)


def find_link_facets(shape: Flexible, space: Discretisation, file: str, body: str) -> dict[str, IntArray]:
    """Find the boundary facets of each link of a body."""
    faces = {name: _faces(shape, space, link, file, f"body.{body}.link.{name}") for name, link in shape.link.items()}
    return {
        name: np.unique(np.concatenate([facets_on_face(space, own) for own in face])) for name, face in faces.items()
    }


def _faces(shape: Flexible, space: AnySpace, place: MarkerPlace | FaceLink, file: str, key: str) -> list[IntArray]:
    """Return the faces that a marker or a link is on, as `face_marker` takes them."""
    if place.plane is not None:
        return [facets_in_plane(space, *place.plane)]
    if place.near is not None:
        return [facets_near(space, np.array(place.near), _cad_faces(shape, space))]
    return [space.mesh.faces[find_name(space.mesh.faces, face, file, f"{key}.face")] for face in place.faces]


def _centre_by_geometry(space: AnySpace, faces: Sequence[IntArray]) -> Array | None:
    """Return the centre (3,) [m] of faces together by the geometry that CAD has of each; ``None`` without."""
    names = [name for face in faces for name, corners in space.mesh.faces.items() if corners is face]
    if len(names) < len(faces) or not {*names} <= space.mesh.centres.keys():
        return None
    areas, places = np.split(np.array([space.mesh.centres[name] for name in names]), [1], axis=1)
    return np.asarray((areas * places).sum(axis=0) / areas.sum())


def place_node_markers(shape: Flexible, model: MatrixModel, file: str, body: str) -> dict[str, Marker]:
    """Place the markers of a body that is given by its matrices on its nodes; raises as `place_markers`."""

    def place(name: str, marker: MarkerPlace) -> Marker:
        nodes = nodes_in_plane(model, *marker.plane) if marker.plane else np.array(marker.nodes)
        return node_marker(model, nodes, marker.attachment == "rigid")

    return _placed(shape, place, file, body)


def fixed_unknowns(shape: Flexible, space: AnySpace, file: str, body: str) -> IntArray:
    """Return the unknowns that a body's supports fix, shape (n_fixed,).

    Raises
    ------
    InputError
        A face isn't there, or no node lies where a support is to be.
    """
    fixed = []
    for number, support in enumerate(shape.support):
        key = f"body.{body}.support.{number}"
        with as_input_error(file, key, support.edge or support.plane or support.faces):
            if support.edge is not None:
                nodes = nodes_on_edge(space, np.array(support.edge))
            elif support.point is not None:
                nodes = node_at(space, np.array(support.point))
            elif support.plane is not None:
                nodes = nodes_on_faces(space, [facets_in_plane(space, *support.plane)])
            else:
                names = [find_name(space.mesh.faces, face, file, f"{key}.face") for face in support.faces]
                nodes = _supported_nodes(space, [space.mesh.faces[name] for name in names])
        fixed += [3 * nodes + "xyz".index(axis) for axis in support.fixed]
    return np.unique(np.concatenate(fixed))


def _supported_nodes(space: AnySpace, faces: Sequence[IntArray]) -> IntArray:
    """Return the nodes of a support; a set of nodes holds all of its own, on facets or not, as a deck means it."""
    one = faces[0]
    if len(faces) > 1 or one.ndim == 2 or space.mesh.midsurface is not None:
        return nodes_on_faces(space, faces)
    on_facets = any(len(facets_on_face(own.space, own.own_points(one))) for own in space.members)
    return np.union1d(nodes_on_faces(space, faces), one) if on_facets else one


def _placed(shape: Flexible, place: Callable[[str, MarkerPlace], T], file: str, body: str) -> dict[str, T]:
    markers = {}
    for name, marker in shape.marker.items():
        assert isinstance(marker, MarkerPlace)
        try:
            markers[name] = place(name, marker)
        except ValueError as error:
            given = next(iter(marker.where.values()))
            raise InputError(file, f"body.{body}.marker.{name}", given, str(error)) from error
    return markers


def _alone(space: AnySpace, what: str) -> Discretisation:
    """Return a space of elements of one kind; refuses ``what`` for solids beside shells or beams."""
    if isinstance(space, JoinedSpace):
        raise ValueError(f"{what} of solids beside shells or beams isn't there yet; name a face, or a node")
    return space


def _cad_faces(shape: Flexible, space: AnySpace) -> list[IntArray]:
    """Return the faces that CAD itself keeps apart; fillets, which have no sharp edges, are among them."""
    if shape.shape != "cad":
        return []
    return [face for name, face in space.mesh.faces.items() if re.fullmatch(r"face-\d+", name)]
