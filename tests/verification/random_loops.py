"""Random loops of rigid bodies, as mechanisms and as the reference in absolute coordinates."""

from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.closures import close_joint, fixed_place
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.reduction.body import MarkerShapes
from fmd.scene.joints.any_joint import JOINTS
from fmd.scene.joints.revolute import REVOLUTE
from fmd.scene.joints.spherical import SPHERICAL
from tests.verification.absolute_coordinates import AbsoluteBodies, Gap
from tests.verification.loop_mechanisms import place_on

_KINDS = {"revolute": REVOLUTE, "spherical": SPHERICAL}
_ENDS = {joint.kind.name: joint.kind for joint in JOINTS}
_FREEDOMS = {"revolute": 1, "universal": 2, "cylindrical": 2, "spherical": 3, "point-on-line": 4}


class Loop(NamedTuple):
    """A loop both ways, with the places of its joints at the start (n + 1, 3) [m]."""

    mechanism: Mechanism
    reference: AbsoluteBodies
    places: Array


def random_loop(seed: int, spatial: bool) -> Loop:
    """Make a chain of three to five bodies from the ground back to the ground that has a freedom or more left.

    In the plane all joints are hinges across it, two of three constraints of each are redundant in space.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 6))
    places = rng.uniform(-0.5, 0.5, (n + 1, 3))
    axes, kinds = rng.normal(size=(n + 1, 3)), ["revolute"] * (n + 1)
    if spatial:
        while sum(_FREEDOMS[kind] for kind in kinds) < 7:
            kinds = [str(kind) for kind in rng.choice(list(_KINDS), n)] + [str(rng.choice(list(_FREEDOMS)))]
    else:
        places[:, 2], axes[:] = 0.0, [0.0, 0.0, 1.0]
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    other = np.cross(axes[n], rng.normal(size=3)) if kinds[n] == "universal" else axes[n]
    other = other / np.linalg.norm(other)
    masses, centres = rng.uniform(0.5, 2.0, n), rng.uniform(-0.2, 0.2, (n, 3))
    inertias = [np.diag(rng.uniform(0.02, 0.03, 3)) for _ in range(n)]
    gravity = rng.normal(size=3) * 9.81
    steps = np.diff(places, axis=0)
    links = [
        Link(
            f"body{k}",
            rigid_integrals(masses[k], centres[k], inertias[k]),
            _KINDS[kinds[k]],
            k - 1,
            MarkerShapes(at),
            axes[k],
        )
        for k, at in enumerate([places[0], *steps[:-1]])
    ]
    end = close_joint(
        _ENDS[kinds[n]], "end", place_on(f"body{n - 1}", steps[-1]), fixed_place(places[n]), axes[n], other
    )
    reference = AbsoluteBodies(masses, list(centres), inertias, _gaps(kinds, axes, other, places), gravity)
    return Loop(Mechanism(links, gravity=gravity, closures=[end]), reference, places)


def _gaps(kinds: list[str], axes: Array, other: Array, places: Array) -> Gap:
    """Write each joint's equations between the frames that it joins; frames sit at the places, the ground's at 0."""
    n, steps = len(places) - 1, np.diff(places, axis=0)
    planes = [np.linalg.svd(axis[None])[2][1:] for axis in axes]

    def gaps(x: Array, R: Array) -> list[complex]:
        found: list[complex] = []
        for k, kind in enumerate(kinds):
            at = places[0] if k == 0 else x[k - 1] + R[k - 1] @ steps[k - 1]
            carrier = np.eye(3) if k == 0 else R[k - 1]
            carried, to = (np.eye(3), places[n]) if k == n else (R[k], x[k])
            axis = carrier @ axes[k]
            across = [carrier @ one for one in planes[k]]
            apart = to - at
            found += [one @ apart for one in across] if kind in ("cylindrical", "point-on-line") else list(apart)
            if kind in ("revolute", "cylindrical"):
                found += [one @ (carried @ axes[k]) for one in across]
            if kind == "universal":
                found.append(axis @ (carried @ other))
        return found

    return gaps
