"""A scene with the bodies that have pieces replaced by chains of welded bodies.

The names of the user's scene stay: its joints, drives and force elements act on the piece that holds their marker.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from fmd.scene.any_body import Flexible
from fmd.scene.bodies import Solid
from fmd.scene.joints.any_joint import Joint
from fmd.scene.joints.fixed import Fixed
from fmd.scene.places import MARKER_WAYS, MarkerPlace, NamedElement
from fmd.scene.scene import Scene
from fmd.stages.piece_mesh import CutPart, face_of


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
    """Replace each body that is cut by its pieces, and weld these.

    Parameters
    ----------
    scene : Scene
        The user's scene.
    cuts : mapping of str to CutPart
        The bodies that are cut.
    elements : mapping of str to mapping
        Numbers of the named elements in the mesh of each of them.
    """
    loaded = loaded_places(scene)
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
                joints[f"{first}-{second}:{cut.of_first[-1]}" if closes else second] = weld
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


def loaded_places(scene: Scene) -> set[str]:
    """Return the places, ``"body.marker"``, at which joints, loads and force elements act."""
    return set(_iterate_loaded(scene))


def _iterate_loaded(scene: Scene) -> Iterator[str]:
    for joint in scene.joint.values():
        yield joint.parent
        yield joint.child
    for drive in scene.drive.values():
        if drive.type in ("point force", "point torque"):
            yield drive.marker
    for table in scene.elements.values():
        for element in table.values():
            yield from element.between


def _piece(body: Flexible, name: str, k: int, cut: CutPart, elements: Mapping[str, int], loaded: set[str]) -> Flexible:
    """Return the table of one piece: its markers on its own mesh, modes fixed at its interface."""
    piece = cut.pieces[k]
    assert isinstance(body, Solid)
    attachment: Literal["averaged", "rigid"] = "rigid" if body.sections == "rigid" else "averaged"
    markers = {at: MarkerPlace(face=face_of(at), attachment=attachment) for at in piece.cut_markers}
    for at in piece.own_markers:
        given = body.marker[at]
        place: dict[str, Any] = dict.fromkeys(MARKER_WAYS)
        if given.is_face:
            place["face"] = face_of(at)
        else:
            place["at"] = tuple(piece.given[at].position.tolist())
        markers[at] = given.model_copy(update=place)
    wanted = body.modes.interface
    interface = [*piece.cut_markers]
    interface += [at for at in piece.own_markers if (at in wanted if wanted else f"{name}.{at}" in loaded)]
    numbers = {int(cell): place for place, cell in enumerate(piece.cells)}
    centres = piece.mesh.points[piece.mesh.cells].mean(axis=1)
    own = {
        element: NamedElement.model_construct(at=tuple(centres[numbers[cell]].tolist()))
        for element, cell in elements.items()
        if cell in numbers
    }
    modes = body.modes.model_copy(update={"boundary": "interface", "interface": tuple(interface)})
    changes = {"marker": markers, "modes": modes, "element": own, "support": body.support if k == 0 else ()}
    return body.model_copy(update=changes)
