"""Scenes beside a scene: on a coarser or a finer mesh, with a richer basis, with other runs.

The error budget compares runs of neighbouring scenes, and a wanted accuracy is met by moving from one to the next.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from pipeline.scene import Flexible, Scene

_HALF = 0.5


def with_runs(scene: Scene, *runs: Any) -> Scene:
    """The scene, integrated by other runs."""
    return _changed(scene, {"simulation": scene.simulation.model_copy(update={"run": runs})})


def with_modes(scene: Scene, change: Callable[[Flexible], dict[str, Any]]) -> Scene:
    """The scene, each flexible body's table of modes changed by what ``change`` returns for it."""
    return _with_bodies(scene, lambda body: {"modes": body.modes.model_copy(update=change(body))})


def richer(scene: Scene) -> Scene:
    """The scene with two generations of load-dependent vectors beside each body's modes."""
    return with_modes(scene, lambda body: {"enrich": "ritz"})


def refined(scene: Scene, factor: float) -> Scene | None:
    """The scene on meshes with about ``factor`` times the elements each way; ``None`` if none of them changes."""
    found = _with_bodies(scene, lambda body: {"mesh": body.mesh.model_copy(update=_divided(body, factor))})
    return None if found.body == scene.body else found


def coarser(scene: Scene) -> Scene | None:
    """The scene on meshes with half of the elements each way; ``None`` if there are none."""
    return refined(scene, _HALF)


def ratio(body: Flexible, other: Flexible) -> float:
    """Mean ratio of the numbers of elements of two meshes in the directions in which they differ."""
    if body.shape == "bar" and body.mesh.size is not None:
        assert other.shape == "bar"
        assert other.mesh.size is not None
        return other.mesh.size / body.mesh.size
    pairs = [(a, b) for a, b in zip(_counts(body), _counts(other), strict=True) if a != b]
    return float(np.exp(np.mean(np.log([a / b for a, b in pairs])))) if pairs else 1.0


def _counts(body: Flexible) -> tuple[int, ...]:
    if body.shape == "bar":
        return body.mesh.divisions or ()
    if body.shape == "mesh":
        return ()
    return (*body.mesh.sleeve, *body.mesh.joint, *body.mesh.blade)


def _divided(body: Flexible, factor: float) -> dict[str, Any]:
    """What changes in a body's table of the mesh."""

    def times(count: int) -> int:
        return max(1, int(np.floor(count * factor + 0.5)))

    if body.shape == "bar":
        if body.mesh.size is not None:
            return {"size": body.mesh.size / factor}
        assert body.mesh.divisions is not None
        return {"divisions": tuple(times(count) for count in body.mesh.divisions)}
    if body.shape == "mesh":  # a file's mesh is what it is
        return {}
    (around, axial, radial), (chordwise, across, outwards) = body.mesh.sleeve, body.mesh.joint
    across = times(across)
    per_blade = max(times(around // body.blades), across + 1)
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
