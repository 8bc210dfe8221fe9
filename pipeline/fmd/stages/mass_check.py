"""Check that every motion of a scene's joints has inertia."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.mechanism import NO_INERTIA

if TYPE_CHECKING:
    from fmd.dynamics.compiled_system.system import CompiledSystem
    from fmd.dynamics.mechanism import Mechanism
    from fmd.scene.scene import Scene


def require_inertia(scene: Scene, system: CompiledSystem) -> None:
    """Raise ``InputError`` if a joint has a motion that nothing resists: no mass moves in it.

    A rod or a point mass on a ball joint, for one, turns about its own axis without any inertia.
    """
    M, _, _ = system.linear_matrices
    if not len(M):
        return
    sizes = np.sqrt(np.maximum(M.diagonal(), 0.0))
    sizes[sizes == 0.0] = 1.0
    least, ways = np.linalg.eigh(M / np.outer(sizes, sizes))
    if least[0] > NO_INERTIA * len(M):
        return
    joint, motion = _describe_rate(system.mechanism, ways[:, 0] / sizes)
    raise InputError(
        scene.file,
        f"joint.{joint}",
        None,
        f"nothing has inertia against its {motion}; give what it carries an extent (shape 'rigid' with inertias above "
        "0 or 'rod' across the axis), or take a joint without this motion",
    )


def _describe_rate(mechanism: Mechanism, way: Array) -> tuple[str, str]:
    """Return the joint that moves most in a combination of rates (n,), and its motion in words."""
    parts = [way[at : at + link.n_rates] for at, link in zip(mechanism.layout.rate, mechanism.links, strict=True)]
    worst = int(np.argmax([np.abs(part).max(initial=0.0) for part in parts]))
    link, part = mechanism.links[worst], parts[worst]
    slides = link.n_slides
    turns = int(np.abs(part).argmax()) >= slides
    part = part[slides:] if turns else part[:slides]
    if len(part) == 1:
        return link.joint_name, "rotation" if turns else "displacement"
    direction = part / part[np.abs(part).argmax()]
    text = ", ".join(f"{x:.3g}" for x in np.where(np.abs(direction) < 1e-6, 0.0, direction) + 0.0)
    return link.joint_name, f"{'rotation about' if turns else 'displacement along'} [{text}] in the child's axes"
