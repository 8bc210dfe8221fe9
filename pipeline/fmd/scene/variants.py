"""Variants of a scene: the same scene on coarser or finer meshes, with more shapes or with other runs.

The error budget compares a run with those of variants, and a wanted accuracy is met by going from one variant to the
next. A variant keeps the file of its scene.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from fmd.core.errors import InputError
from fmd.core.joint_kinds import JOINT_CONSTANTS
from fmd.scene.any_body import Flexible
from fmd.scene.force_elements import BearingTable
from fmd.scene.joints.fixed import Fixed
from fmd.scene.joints.free import Free
from fmd.scene.loads import Drive, PointForce
from fmd.scene.modes import ModeSettings
from fmd.scene.runs import AutoRun
from fmd.scene.scene import Scene
from fmd.scene.simulation import Simulation

# Factors to coarsen a mesh by. The largest shows most of the error, but not every part can be meshed so coarsely.
COARSENING_FACTORS = (2.0, 1.5, 1.25)


def change_simulation(scene: Scene, **values: Any) -> Scene:
    """Return the scene with other values of its simulation's keys."""
    return scene.model_copy(update={"simulation_table": scene.simulation.model_copy(update=values)})


def with_first_run(scene: Scene) -> Scene:
    """Return the scene with the first of its runs, whose motion results by their names are of."""
    if not scene.moves or scene.refines_contacts:  # which has one
        return scene
    return change_simulation(scene, run=scene.simulation.run[:1])


def without_joint_numbers(scene: Scene) -> Scene:
    """Return the scene without springs, rests and dampers of joints with one coordinate."""
    joints = {
        name: joint.model_copy(update=dict.fromkeys(JOINT_CONSTANTS, 0.0)) if joint.kind.unit else joint
        for name, joint in scene.joint.items()
    }
    return scene.model_copy(update={"joint": joints})


def change_modes(scene: Scene, change: Callable[[Flexible], dict[str, Any]]) -> Scene:
    """Return the scene with the mode settings of each flexible body changed by what ``change`` returns for it."""
    return _change_bodies(scene, lambda body: {"modes": body.modes.model_copy(update=change(body))})


def enrich_bases(scene: Scene) -> Scene:
    """Return the scene with load-dependent vectors added to each body's modes; a body that has them gets more modes."""

    def change(body: Flexible) -> dict[str, Any]:
        has_them = body.modes.enrich == "ritz"
        return {"enrich": "ritz", "count": body.modes.count + has_them * (body.modes.count // 2 + 1)}

    return change_modes(scene, change)


def correct_statically(scene: Scene, drives: Sequence[Drive]) -> Scene:
    """Return the scene with loads added whose static responses, and those to inertia loads, join each body's modes.

    Without them the modes that a body leaves out would lack in the sum of its flexibility, and zeros of transfer
    functions would be at the wrong frequencies (MacNeal, Computers & Structures 1, 1971).
    """
    more = {f"input {k + 1}": drive for k, drive in enumerate(drives)}
    scene = scene.model_copy(update={"drive": {**scene.drive, **more}})
    return change_modes(scene, lambda body: {"enrich": "residual"} if isinstance(body.modes, ModeSettings) else {})


def open_to_space(scene: Scene) -> Scene:
    """Return the scene with forces of no size in all directions where flexible bodies hang or carry others.

    So their shapes answer to motions across a plane, too, to which the scene's own joints and loads keep; but not those
    of a body whose modes are of a family that the scene chooses.
    """
    chosen = {name for name, body in scene.flexible.items() if getattr(body.modes, "family", "any") != "any"}
    held = {joint.child for joint in scene.joint.values()} | {joint.parent for joint in scene.joint.values()}
    places = sorted(place for place in held if place.partition(".")[0] in scene.flexible.keys() - chosen)
    drives: dict[str, Drive] = {
        f"space {k} {way}": PointForce.model_validate(
            {"type": "point force", "marker": place, "force": "0 N", "direction": direction}
        )
        for k, place in enumerate(places, 1)
        for way, direction in zip("xyz", ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), strict=True)
    }
    return scene.model_copy(update={"drive": {**scene.drive, **drives}})


def complete_for_linear_answers(scene: Scene) -> Scene:
    """Return a scene of parts alone with what linear answers need beside them: a simulation, and joints to the ground.

    A body that hangs on no joint is held where its supports or its modes say so, at its first marker, and else free.

    Raises
    ------
    InputError
        A body without a joint has no marker.
    """
    if scene.moves:
        return scene
    joints = dict(scene.joint)
    for name, body in scene.body.items():
        if not body.marker:
            raise InputError(
                scene.file, f"body.{name}.marker", None, "is missing: a place where forces act or are seen"
            )
        if name not in scene.carrying:
            held = isinstance(body, Flexible) and (body.support or body.modes.boundary == "joint")
            given = {"parent": "ground", "child": f"{name}.{next(iter(body.marker))}"}
            kind: type[Fixed] | type[Free] = Fixed if held else Free
            joints[f"{name}-ground"] = kind.model_validate({"type": "fixed" if held else "free", **given})
    name, body = next(iter((scene.flexible or scene.body).items()))
    tip = f"{name}.{list(body.marker)[-1]}"
    simulation = Simulation(duration=1.0, output_step=1.0, tip=tip, run=(AutoRun(integrator="auto"),))
    return scene.model_copy(update={"joint": joints, "simulation_table": simulation})


def change_bearings(scene: Scene, change: Callable[[BearingTable], BearingTable | float]) -> Scene:
    """Return the scene with its bearings' tables over the frequency of whirl changed; itself if there are none."""
    bearings = {
        name: bearing.model_copy(update={key: change(table) for key, table in bearing.whirl_tables.items()})
        for name, bearing in scene.bearing.items()
        if bearing.whirl_tables
    }
    return scene.model_copy(update={"bearing": {**scene.bearing, **bearings}}) if bearings else scene


def damp_bodies(scene: Scene, damping: float) -> Scene | None:
    """Return the scene with damping for the bodies that have none; ``None`` if all have some, or one is in pieces."""
    if all(body.modes.damping for body in scene.flexible.values()):
        return None
    if scene.pieces:
        return None  # a ratio of a piece's modes is none of the part's
    return change_modes(scene, lambda body: {"damping": body.modes.damping or damping})


def set_pieces(scene: Scene, counts: Mapping[str, int]) -> Scene:
    """Return the scene with other numbers of pieces for some flexible bodies, by name."""
    bodies = {name: scene.flexible[name].model_copy(update={"pieces": count}) for name, count in counts.items()}
    return scene.model_copy(update={"body": {**scene.body, **bodies}})


def attach_roots_rigidly(scene: Scene, roots: Mapping[str, str]) -> Scene | None:
    """Return the scene with rigid attachment of named markers, by body; ``None`` if they all have it or are points."""
    bodies = {}
    for name, root in roots.items():
        body = scene.flexible[name]
        marker = body.marker[root]
        several = getattr(marker, "face", None) is not None or len(getattr(marker, "nodes", None) or ()) > 1
        if marker.attachment == "rigid" or not several:
            continue
        markers = {**body.marker, root: marker.model_copy(update={"attachment": "rigid"})}
        bodies[name] = body.model_copy(update={"marker": markers})
    return scene.model_copy(update={"body": {**scene.body, **bodies}}) if bodies else None


def replace_order(scene: Scene, order: int) -> Scene:
    """Return the scene with elements of another order, except in bodies whose files say what their elements are."""
    return _change_bodies(scene, lambda body: body.of_order(order))


def refine_meshes(scene: Scene, factor: float) -> Scene | None:
    """Return the scene on meshes with about ``factor`` times the elements each way; ``None`` if no mesh changes.

    Numbers of elements on finer meshes are even, so that a coarser mesh can have exactly half of them.
    """
    found = _change_bodies(scene, lambda body: body.resized(factor))
    return None if found.body == scene.body else found


def coarsen_meshes(scene: Scene, times: float = COARSENING_FACTORS[0]) -> Scene | None:
    """Return the scene on meshes with ``times`` fewer elements each way; ``None`` if one can't be coarser."""
    found = refine_meshes(scene, 1 / times)
    return None if found is None or any(found.body[name] == body for name, body in scene.flexible.items()) else found


def halve_elements(scene: Scene) -> Scene | None:
    """Return the scene with each element of files divided; ``None`` if one can't be."""
    found = _change_bodies(scene, lambda body: body.halved())
    return None if any(found.body[name] == body for name, body in scene.flexible.items()) else found


def divide_few_elements(scene: Scene) -> Scene | None:
    """Return the scene with more elements where a bar or shell has so few from side to side that fewer tell nothing.

    These are one quadratic or two linear elements, which bend a section alike; ``None`` if no body has them.
    """
    found = _change_bodies(scene, lambda body: body.divided_more())
    return None if all(found.body[name] == body for name, body in scene.flexible.items()) else found


def compare_element_sizes(body: Flexible, elements: int, fewer: int) -> float:
    """Return the ratio of element sizes of a coarser mesh and a body's own, from both numbers of elements.

    A direction with one element has no fewer and doesn't count.
    """
    return float((elements / fewer) ** (1 / body.divided_directions))


def _change_bodies(scene: Scene, change: Callable[[Flexible], dict[str, Any]]) -> Scene:
    bodies = {name: body.model_copy(update=change(body)) for name, body in scene.flexible.items()}
    return scene.model_copy(update={"body": {**scene.body, **bodies}})
