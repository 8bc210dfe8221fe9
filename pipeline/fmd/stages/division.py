"""Parts as they are reduced, whole or in pieces, and the scene in which pieces are bodies welded to one another.

The names of the user's scene stay: its joints, drives and force elements act on the piece that holds their marker.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.recovery.stress import StressHistory
from fmd.reduction.inertia import add_normal_blocks
from fmd.scene.any_body import Flexible
from fmd.scene.bodies import Solid
from fmd.scene.joints.any_joint import Joint
from fmd.scene.joints.fixed import Fixed
from fmd.scene.places import MARKER_WAYS, MarkerPlace, NamedElement
from fmd.scene.scene import Scene
from fmd.stages.part import FlexiblePart
from fmd.stages.piece_mesh import Cut, CutPart, face_of, link_name
from fmd.stages.pieces_at_rest import PiecesAtRest, deflection_error, frequency_error, measure_part, put_together

if TYPE_CHECKING:
    from fmd.dynamics.mechanism import Mechanism
    from fmd.recovery.motion import Motion
    from fmd.reduction.body import FlexibleBody


def piece_name(body: str, number: int) -> str:
    """Return the name of a body's piece, numbered from 0; no body of a scene can have it."""
    return f"{body}:{number + 1}"


def part_of(body: str) -> str:
    """Return the name of the part that a body is a piece of; empty if it is whole."""
    return body.partition(":")[0] if ":" in body else ""


def find_place(place: str, cuts: Mapping[str, CutPart]) -> str:
    """Return ``"body.marker"`` with the name of the piece that holds the marker; other places as they are."""
    body, _, marker = place.partition(".")
    return f"{piece_name(body, cuts[body].holds(marker))}.{marker}" if body in cuts else place


def divide_scene(scene: Scene, cuts: Mapping[str, CutPart], elements: Mapping[str, Mapping[str, int]]) -> Scene:
    """Replace each body that is cut by its pieces, and weld these; its named elements have numbers in its mesh."""
    loaded = scene.loaded_places
    bodies: dict[str, Any] = {}
    for name, body in scene.body.items():
        if name not in cuts:
            bodies[name] = body
            continue
        for k in range(len(cuts[name].pieces)):
            bodies[piece_name(name, k)] = _piece(scene.flexible[name], name, k, cuts[name], elements[name], loaded)
    joints: dict[str, Joint] = {}
    for closes in (False, True):
        for name, part in cuts.items():
            for cut in part.cuts:
                if cut.closes != closes:
                    continue
                first, second = piece_name(name, cut.first), piece_name(name, cut.second)
                weld = Fixed(type="fixed", parent=f"{first}.{cut.of_first}", child=f"{second}.{cut.of_second}")
                joints[f"{first}-{second}:{cut.of_first.rpartition('-')[2]}" if closes else second] = weld
        if not closes:  # welds of the tree come before the user's joints, which close loops if they hold a piece too
            joints |= {name: _moved(joint, cuts, "parent", "child") for name, joint in scene.joint.items()}
    changes: dict[str, Any] = {"body": bodies, "joint": joints}
    changes["drive"] = {
        name: _moved(drive, cuts, "marker") if hasattr(drive, "marker") else drive
        for name, drive in scene.drive.items()
    }
    for table, named in scene.elements.items():
        changes[table] = {
            name: element.model_copy(update={"between": tuple(find_place(at, cuts) for at in element.between)})
            for name, element in named.items()
        }
    if scene.simulation_table is not None:
        changes["simulation_table"] = _moved(scene.simulation_table, cuts, "tip")
    return scene.model_copy(update=changes)


def _moved(table: Any, cuts: Mapping[str, CutPart], *keys: str) -> Any:
    """Return a table with the places under some of its keys on the pieces that hold them."""
    return table.model_copy(update={key: find_place(getattr(table, key), cuts) for key in keys})


def _piece(body: Flexible, name: str, k: int, cut: CutPart, elements: Mapping[str, int], loaded: set[str]) -> Flexible:
    """Return the table of one piece: its markers on its own mesh, fixed-interface modes."""
    piece = cut.pieces[k]
    assert isinstance(body, Solid)
    attachment: Literal["averaged", "rigid"] = "rigid" if body.sections == "rigid" else "averaged"
    markers = {at: MarkerPlace(face=face_of(at), attachment=attachment) for at in piece.cut_markers}
    for at in piece.own_markers:
        given = body.marker[at]
        place: dict[str, Any] = dict.fromkeys(MARKER_WAYS)
        if given.link is not None:
            place["link"] = given.link
        elif given.is_face:
            place["face"] = face_of(at)
        else:
            place["at"] = tuple(piece.given[at].position.tolist())
        markers[at] = given.model_copy(update=place)
    requested = body.modes.interface
    interface = [*piece.cut_markers]
    interface += [at for at in piece.own_markers if (at in requested if requested else f"{name}.{at}" in loaded)]
    numbers = {int(cell): place for place, cell in enumerate(piece.cells)}
    centres = piece.mesh.points[piece.mesh.cells].mean(axis=1)
    own = {
        element: NamedElement.model_construct(at=tuple(centres[numbers[cell]].tolist()))
        for element, cell in elements.items()
        if cell in numbers
    }
    modes = body.modes.model_copy(update={"boundary": "interface", "interface": tuple(interface)})
    links = {
        at: link.model_copy(
            update={
                "face": face_of(link_name(at)),
                "near": None,
                "plane": None,
                "at": _place_in_piece(link.at, piece.offset),
            }
        )
        for at, link in body.link.items()
        if face_of(link_name(at)) in piece.mesh.faces
    }
    hung = {at.casefold() for at in (*links, *(piece.mesh.connections.names if piece.mesh.connections else ()))}
    masses = {
        at: mass.model_copy(update={"centre": _place_in_piece(mass.centre, piece.offset)})
        for at, mass in body.mass.items()
        if mass.at.casefold() in hung
    }
    changes = {"marker": markers, "modes": modes, "element": own, "support": body.support if k == 0 else ()}
    changes |= {"link": links, "mass": masses}
    return body.model_copy(update=changes)


def _place_in_piece(place: tuple[float, float, float] | None, offset: Array) -> tuple[float, ...] | None:
    """Return a place of the whole part in the coordinates of a piece [m]."""
    return None if place is None else tuple((np.array(place) - offset).tolist())


@dataclass(frozen=True)
class DividedPart:
    """A part in pieces, shown as one."""

    whole: FlexiblePart  # the part as the scene has it
    cut: CutPart
    pieces: tuple[FlexiblePart, ...]  # the pieces, the first at the part's joint
    ports: tuple[str, ...]  # names of the markers at which joints and loads act

    @cached_property
    def nodes(self) -> tuple[IntArray, ...]:
        """For each piece the numbers of its nodes in the whole, shape (n_nodes_of_piece,) each."""
        from scipy.spatial import cKDTree

        tree = cKDTree(self.whole.space.x)
        return tuple(
            np.asarray(tree.query(part.space.x + piece.offset)[1])
            for part, piece in zip(self.pieces, self.cut.pieces, strict=True)
        )

    def find_node(self, node: int) -> tuple[FlexiblePart, int]:
        """Return the first piece that holds a node of the whole, and the node's number there."""
        places = zip(self.pieces, (np.flatnonzero(nodes == node) for nodes in self.nodes), strict=True)
        return next((part, int(found[0])) for part, found in places if len(found))

    @property
    def unwarped_cuts(self) -> list[Cut]:
        """Cuts for which ``sections = "warping"`` has found too few motions."""
        if self.whole.shape.sections != "warping":  # type: ignore[union-attr]
            return []
        cuts = self.cut.cuts  # those that are welded once
        return [one for one in cuts if sum(np.array_equal(one.facets, each.facets) for each in cuts) == 1]

    @cached_property
    def at_rest(self) -> PiecesAtRest:
        """The pieces together at rest, free but for the supports, as the part's own modes are by default."""
        bodies = [part.for_any_motion(part.body) for part in self.pieces]
        return put_together(bodies, self.cut, bool(self.whole.shape.support))

    @property
    def frequencies_hz(self) -> Array:
        """Frequencies of the pieces together at rest [Hz]: as many as each has modes requested."""
        return self.at_rest.frequencies_hz[: self.whole.shape.modes.count]

    @cached_property
    def errors(self) -> dict[str, float]:
        """Relative errors of the lowest frequencies and of deflections under loads against the part in one piece."""
        whole = measure_part(self.whole, self.ports)
        return {
            "lowest frequencies": frequency_error(self.at_rest, self.whole, whole),
            "deflections": deflection_error(self.at_rest, self.whole, whole, self.ports),
        }

    def deform(self, motion: Motion, bodies: Mapping[str, FlexibleBody], frames: Sequence[int] | IntArray) -> Array:
        """Return the displacement of all nodes in the frame of the first piece, shape (n_frames, n_nodes, 3) [m].

        Nodes on a cut, which two pieces move, have the mean of both.
        """
        first, x = self.pieces[0].name, self.whole.space.x
        origin = bodies[first].origin + self.cut.pieces[0].offset
        total, count = np.zeros((len(frames), len(x), 3)), np.zeros(len(x))
        for part, nodes in zip(self.pieces, self.nodes, strict=True):
            body, q = bodies[part.name], motion.modal(part.name)
            count[nodes] += 1
            for row, k in enumerate(frames):
                moved = body.x[: len(nodes)] + body.shapes[: len(nodes)] @ q[k]
                placed = motion.placed(part.name, moved, int(k))
                total[row, nodes] += motion.seen_from(first, placed, int(k)) + origin - x[nodes]
        return np.asarray(total / count[:, None])

    def nodal_stress_at(self, motion: Motion, frame: int) -> NDArray[np.float32]:
        """Return the stress at all nodes at an output time, (n_nodes, 6) [Pa]; on a cut the mean of both sides."""
        total = np.zeros((len(self.whole.space.x), 6), dtype=np.float32)
        count = np.zeros(len(total), dtype=np.float32)
        for part, nodes in zip(self.pieces, self.nodes, strict=True):
            count[nodes] += 1
            total[nodes] += part.nodal_stress @ motion.modal(part.name)[frame].astype(np.float32)
        return np.asarray(total / count[:, None])

    def stress(self, motion: Motion) -> StressHistory:
        """Return the stress on the surface of the whole over a motion, nodes on a cut with the mean of both pieces."""
        surface, ends = self.whole.surface.nodes, np.cumsum([0, *(len(part.body.omega) for part in self.pieces)])
        place = np.full(len(self.whole.space.x), -1)
        place[surface] = np.arange(len(surface))
        modal, count = np.zeros((len(surface), 6, int(ends[-1]))), np.zeros(len(surface))
        for k, (part, nodes) in enumerate(zip(self.pieces, self.nodes, strict=True)):
            rows = place[nodes[part.surface.nodes]]  # of a cut's inner nodes there are none
            on_surface = np.flatnonzero(rows >= 0)
            count[rows[on_surface]] += 1
            modal[rows[on_surface], :, ends[k] : ends[k + 1]] = part.surface_stress[on_surface]
        q = np.concatenate([motion.modal(part.name) for part in self.pieces], axis=1)
        return StressHistory(surface, modal / count[:, None, None], motion.times, q)


@dataclass(frozen=True)
class Division:
    """The parts of a scene as they are reduced."""

    scene: Scene  # the scene with pieces as bodies of their own
    parts: Mapping[str, FlexiblePart]  # parts and pieces by name
    # The parts in pieces by name; empty in most scenes.
    divided: Mapping[str, DividedPart] = field(default_factory=dict)

    def with_parts(self, parts: Mapping[str, FlexiblePart]) -> Division:
        """Return the division with other parts and pieces of the same names."""
        divided = {
            name: replace(each, pieces=tuple(parts[piece.name] for piece in each.pieces))
            for name, each in self.divided.items()
        }
        return Division(self.scene, parts, divided)

    def find_place(self, place: str) -> str:
        """Return ``"body.marker"`` with the name of the piece that holds the marker."""
        return find_place(place, {name: part.cut for name, part in self.divided.items()})


def _attach_as_wholes(scene: Scene, wholes: Mapping[str, FlexiblePart]) -> Scene:
    """Return the scene with the attachment that each face's marker has on the whole part; pieces can't tell."""
    bodies = dict(scene.body)
    for name, whole in wholes.items():
        markers = dict(scene.flexible[name].marker)
        for at, given in markers.items():
            if isinstance(given, MarkerPlace) and given.is_face:
                kind = "rigid" if whole.markers[at].rigid else "averaged"
                markers[at] = given.model_copy(update={"attachment": kind})
        bodies[name] = scene.flexible[name].model_copy(update={"marker": markers})
    return scene.model_copy(update={"body": bodies})


def divide_parts(scene: Scene, wholes: Mapping[str, FlexiblePart], like: Division | None = None) -> Division:
    """Divide the parts of a scene that are to be in pieces, with results that a division of another has in common.

    Raises
    ------
    InputError
        The number of pieces is still open, or a part can't be cut; as `cut_part`.
    """
    from fmd.stages.cut_sections import mark_pieces
    from fmd.stages.pieces import cut_part

    for name, count in scene.pieces.items():
        if count == "auto":
            problem = "is still open here; `fmd run` finds the number, and then names it"
            raise InputError(scene.file, f"body.{name}.pieces", count, problem)
    loaded = scene.loaded_places
    cuts, ports = {}, {}
    for name, count in scene.pieces.items():
        whole = wholes[name]
        ports[name] = tuple(
            whole.shape.modes.interface or (at for at in whole.shape.marker if f"{name}.{at}" in loaded)
        )
        cuts[name] = mark_pieces(whole, cut_part(whole, int(count)), ports[name])
    if not cuts:
        return Division(scene, wholes)
    attached = _attach_as_wholes(scene, {name: wholes[name] for name in cuts})
    found = divide_scene(attached, cuts, {name: wholes[name].elements for name in cuts})
    parts: dict[str, FlexiblePart] = {}
    divided = {}
    for name, whole in wholes.items():
        if name not in cuts:
            parts[name] = FlexiblePart(found, name, whole.store, like=whole)
            continue
        shared: dict[str, FlexiblePart] = {}
        for k, piece in enumerate(cuts[name].pieces):
            own = piece_name(name, k)
            before = None if like is None else like.parts.get(own)
            part = FlexiblePart(found, own, whole.store, like=before, piece=piece)
            if not part.shape.element:
                part.results = shared.setdefault(part.key("body"), part).results  # equal pieces are reduced once
            parts[own] = part
        names = [piece_name(name, k) for k in range(len(cuts[name].pieces))]
        divided[name] = DividedPart(whole, cuts[name], tuple(parts[own] for own in names), ports[name])
    return Division(found, parts, divided)


def complete_inertia(
    bodies: Mapping[str, FlexibleBody], along_normal: Callable[[str], Array], mechanism: Mechanism
) -> Mechanism:
    """Add to bodies of a mechanism the inertia that their motion doesn't take, but their joints' reactions do.

    That is the momentum of displacements of second order in a frame that isn't accelerated, and the blocks along the
    one axis that a body turns about, found by name.
    """
    links = []
    for link in mechanism.links:
        integrals = link.integrals
        if link.name in bodies:
            integrals = replace(integrals, displacement2=bodies[link.name].integrals.displacement2)
        if integrals.normal >= 0:
            integrals = add_normal_blocks(integrals, along_normal(link.name))
        links.append(replace(link, integrals=integrals))
    return replace(mechanism, links=links)
