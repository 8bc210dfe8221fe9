"""Scenes beside a scene: on a coarser or a finer mesh, with a richer basis, with other runs.

The error budget compares runs of neighbouring scenes, and a wanted accuracy is met by moving from one to the next.
"""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Any

from pipeline.scene.imported_bodies import MatrixPart, MeshedPart

if TYPE_CHECKING:
    from collections.abc import Callable

    from pipeline.scene.any_body import Flexible
    from pipeline.scene.bodies import Bar
    from pipeline.scene.imported_bodies import CadPart
    from pipeline.scene.propeller import Propeller
    from pipeline.scene.scene import Scene

COARSENING_FACTORS = (2.0, 1.5, 1.25)  # times fewer elements each way: the most that can be meshed tells the most


def replace_runs(scene: Scene, *runs: Any) -> Scene:
    """The scene, integrated by other runs."""
    return _changed(scene, {"simulation_table": scene.simulation.model_copy(update={"run": runs})})


def change_modes(scene: Scene, change: Callable[[Flexible], dict[str, Any]]) -> Scene:
    """The scene, each flexible body's table of modes changed by what ``change`` returns for it."""
    return _with_bodies(scene, lambda body: {"modes": body.modes.model_copy(update=change(body))})


def replace_error(scene: Scene, error: float) -> Scene:
    """The scene with another wanted error of what is integrated automatically."""
    return _changed(scene, {"simulation_table": scene.simulation.model_copy(update={"error": error})})


def replace_order(scene: Scene, order: int) -> Scene:
    """The scene with elements of another order."""

    def change(body: Flexible) -> dict[str, Any]:
        if isinstance(body, MeshedPart | MatrixPart):
            return {}
        return {"mesh": body.mesh.model_copy(update={"order": order})}

    return _with_bodies(scene, change)


def enrich_modes(scene: Scene) -> Scene:
    """The scene with load-dependent vectors beside each body's modes; where it has them, with half more modes."""

    def change(body: Flexible) -> dict[str, Any]:
        has_them = body.modes.enrich == "ritz"
        return {"enrich": "ritz", "count": body.modes.count + has_them * (body.modes.count // 2 + 1)}

    return change_modes(scene, change)


def refine_meshes(scene: Scene, factor: float) -> Scene | None:
    """The scene on meshes with about ``factor`` times the elements each way; ``None`` if none of them changes.

    Finer meshes have even numbers of them, so that a coarser one has just half.
    """
    found = _with_bodies(scene, lambda body: _divided(body, factor))
    return None if found.body == scene.body else found


def coarsen_meshes(scene: Scene, times: float = COARSENING_FACTORS[0]) -> Scene | None:
    """The scene on meshes with so many ``times`` fewer elements each way; ``None`` if a body's can't be coarser."""
    found = refine_meshes(scene, 1 / times)
    return None if found is None or any(found.body[name] == body for name, body in scene.flexible.items()) else found


def compare_element_sizes(body: Flexible, elements: int, fewer: int) -> float:
    """How many times smaller each way a body's elements are than those of its coarser mesh, from both numbers of them.

    A direction with one element has no fewer.
    """
    divisions = body.mesh.divisions if body.shape == "bar" else None
    directions = 3 if divisions is None else max(1, sum(count > 1 for count in divisions))
    return float((elements / fewer) ** (1 / directions))


def _divided(body: Flexible, factor: float) -> dict[str, Any]:
    """A body's table of another mesh; empty where files say what it is."""
    if isinstance(body, MeshedPart | MatrixPart):
        return {}
    mesh = {"mesh": body.mesh.model_copy(update=_divisions(body, factor))}
    if body.shape != "propeller":
        return mesh
    # The joints stay as wide, whatever the numbers of elements.
    return mesh | {"seat": body.seat or 2 * pi * body.mesh.joint[1] / body.mesh.sleeve[0]}


def _divisions(body: Bar | Propeller | CadPart, factor: float) -> dict[str, Any]:
    """What changes in a body's table of the mesh."""

    def times(count: int) -> int:
        return max(1, int(count * factor)) if factor < 1 else 2 * round(count * factor / 2)

    if body.shape == "bar":
        if body.mesh.size is not None:
            return {"size": body.mesh.size / factor}
        assert body.mesh.divisions is not None
        return {"divisions": tuple(times(count) for count in body.mesh.divisions)}
    if body.shape == "cad":
        return {"size": body.mesh.size / factor}
    (around, axial, radial), (chordwise, across, outwards) = body.mesh.sleeve, body.mesh.joint
    # Between two joints there are cells of their own; as many of them as before, or they would be thin ones.
    between = around // body.blades - across
    across = times(across)
    per_blade = across + times(between)
    return {
        "sleeve": (per_blade * body.blades, times(axial), times(radial)),
        "joint": (times(chordwise), across, times(outwards)),
        "blade": (times(chordwise), across, times(body.mesh.blade[2])),
    }


def _with_bodies(scene: Scene, change: Callable[[Flexible], dict[str, Any]]) -> Scene:
    bodies = {name: body.model_copy(update=change(body)) for name, body in scene.flexible.items()}
    return _changed(scene, {"body": {**scene.body, **bodies}})


def _changed(scene: Scene, values: dict[str, Any]) -> Scene:
    """A copy that has been changed; it stays the same file's."""
    return scene.model_copy(update=values)
