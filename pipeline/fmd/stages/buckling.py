"""Buckling of bodies constrained by loops or force elements: by the stiffness of the mechanism, not of each body alone.

A column whose end is guided bears many times what it does with a free end. Of all small motions that keep the loops
closed, those count in which bodies deform, without what joints do alone. Their stiffness is that of modes, springs and
elements, with the geometric stiffness of each body under its loads, and the work that these do as a body turns::

    −F · (½ φ × (φ × r) + φ × u)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.limits.modes import GROWTH, MOMENTS, SUSPECT
from fmd.core.limits.rank import DEPENDENT_CONSTRAINT
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.transmitted_loads import ELEMENT, BodyLoads, geometric_stiffness_over, loaded_places
from fmd.stages.assembly import undeformed_positions
from fmd.stages.division import part_of

if TYPE_CHECKING:
    from fmd.scene.scene import Scene
    from fmd.stages.stiffening_check import StiffeningLoads


@dataclass(frozen=True)
class StiffnessChange:
    """Change of a stiffened body's stiffness by the loads through it."""

    parts: Array  # (n_times, n, n): what the loads change, in shapes whose own stiffness is 1
    buckles_at: float  # time at which they first pass the buckling load [s]; infinite if they never do
    growth: float  # logarithm of the factor by which a deflection grows while the load is beyond that
    # Largest load as a part of the buckling load of a body that loops or elements hold, too.
    constrained: float | None = None

    @property
    def largest(self) -> float:
        """Largest change of the stiffness of a shape, as a part of it."""
        return max(0.0, -self._extremes[0], self._extremes[1])

    @property
    def buckling(self) -> float:
        """Largest load as a part of the buckling load; 0 if nothing is compressed."""
        return max(0.0, -self._extremes[0]) if self.constrained is None else self.constrained

    @cached_property
    def _extremes(self) -> tuple[float, float]:
        lowest, highest = _extreme_parts(self.parts)
        return float(lowest.min()), float(highest.max())


@dataclass(frozen=True)
class ConstrainedStiffness:
    """Lowest stiffness of a mechanism's elastic motions under loads."""

    lowest: float  # lowest stiffness over mass [1/s²]
    buckling: float  # load as a part of the buckling load; 0 if nothing softens


def find_changes(mechanism: Mechanism, checks: Mapping[str, StiffeningLoads]) -> dict[str, StiffnessChange]:
    """Find the change of stiffness of each stiffened body of a mechanism by the loads through it."""
    changes, suspects = {}, list[str]()
    for name, check in checks.items():
        body = mechanism.number_of(name)
        omega = mechanism.links[body].omega
        if check.stiffened and len(omega):
            K = geometric_stiffness_over(mechanism, body, check.loads) / np.outer(omega, omega)
            compressed = np.flatnonzero(np.linalg.norm(K, axis=(1, 2)) > SUSPECT)  # as no eigenvalue is beyond the norm
            lowest = np.linalg.eigvalsh(K[compressed])[:, 0]
            beyond = compressed[lowest < -1.0]  # where the whole stiffness isn't definite
            whole = np.zeros(len(K))
            whole[beyond] = np.linalg.eigvalsh(K[beyond] * np.outer(omega, omega) + np.diag(omega**2))[:, 0]
            changes[name] = StiffnessChange(K, *_instability(check.times, whole))
            if (lowest < -SUSPECT).any() and not part_of(name):
                suspects.append(name)
    if suspects and (mechanism.closures or mechanism.elements):
        loads = {mechanism.number_of(name): checks[name].loads for name in changes}
        buckling, buckles_at, growth = _find_constrained_change(mechanism, loads, checks[suspects[0]])
        changes |= {
            name: replace(changes[name], constrained=buckling, buckles_at=buckles_at, growth=growth)
            for name in suspects
        }
    return changes


def _extreme_parts(K: Array) -> tuple[Array, Array]:
    """Return the lowest and highest eigenvalues of symmetric matrices (n, k, k); 0 of those that can't count.

    No eigenvalue is larger by size than its matrix's norm, the largest no smaller than that over the root of k, the
    lowest no higher than any entry of the diagonal: so these have none below -1, nor the lowest or the largest of all.
    """
    extremes, sizes = np.zeros((2, len(K))), np.linalg.norm(K, axis=(1, 2))
    lowest = float(np.einsum("tii->ti", K).min())
    may_count = sizes >= 0.99 * min(sizes.max() / np.sqrt(K.shape[1]), max(-lowest, 0.0), 1.0)
    extremes[:, may_count] = np.linalg.eigvalsh(K[may_count])[:, [0, -1]].T
    return extremes[0], extremes[1]


def _instability(times: Array, stiffness: Any) -> tuple[float, float]:
    """Return when the lowest stiffness over mass is first below 0 [s], and the logarithm of what grows by that."""
    lowest = np.asarray(stiffness, dtype=float)
    beyond = np.flatnonzero(lowest < 0.0)
    growth = float(np.trapezoid(np.sqrt(np.maximum(-lowest, 0.0)), times))
    return float(times[beyond[0]]) if beyond.size else np.inf, growth


def _find_constrained_change(
    mechanism: Mechanism, loads: Mapping[int, BodyLoads], at: StiffeningLoads
) -> tuple[float, float, float]:
    """Find buckling load, time and growth, as `StiffnessChange` has them, of bodies that loops or elements hold."""
    system = share_system(mechanism)
    moments = np.unique(np.linspace(0, len(at.times) - 1, MOMENTS).astype(int))
    constrained = [constrained_stiffness(system, loads, k, float(at.times[k]), at.positions[k]) for k in moments]
    buckling = max(each.buckling for each in constrained)
    buckles_at, growth = _instability(at.times[moments], [each.lowest for each in constrained])
    return buckling, buckles_at, growth


def require_unbuckled(scene: Scene, changes: Mapping[str, StiffnessChange]) -> None:
    """Raise ``InputError`` if a body would buckle for so long that its deflection grows beyond what is described.

    Pieces of a part describe what follows buckling.
    """
    for name, change in changes.items():
        if change.growth > GROWTH and not part_of(name):
            mend = (
                f"the body would buckle: from t = {change.buckles_at:.4g} s on the loads through it are up to "
                f"{change.buckling:.3g} times what it bears; reduce them, or make it stiffer"
            )
            raise InputError(scene.file, f"body.{name}", None, mend)


def constrained_stiffness(
    system: CompiledSystem, loads: Mapping[int, BodyLoads], k: int, t: float, rigid_positions: Array
) -> ConstrainedStiffness:
    """Find the lowest stiffness of a mechanism with loops or force elements at a moment of its rigid motion.

    The system's bodies are stiffened; loads on bodies over the motion are by their numbers. The moment is number k
    among theirs, at time t [s], with positions of `Mechanism.rigid`.
    """
    from scipy.linalg import eigh

    mechanism = system.mechanism
    q = undeformed_positions(mechanism, mechanism.rigid, rigid_positions)
    elastic, geometric = system.linear_forces.K, np.zeros((mechanism.n, mechanism.n))
    turns = _turns_at_unit_rates(mechanism, t, q)
    for body, own in loads.items():
        now = own.within(slice(k, k + 1))
        modes = mechanism.modes_of(body)
        if len(modes):
            geometric[np.ix_(modes, modes)] += geometric_stiffness_over(mechanism, body, now)[0]
        geometric += _work_of_turning(mechanism, body, now, turns[body])
    directions = _elastic_directions(system, t, q)
    if not directions.shape[1]:
        return ConstrainedStiffness(np.inf, 0.0)
    K, K_G, M = (directions.T @ A @ directions for A in (elastic, geometric, system.mass_matrix(q, t)))
    parts = eigh(K_G, K, eigvals_only=True)
    return ConstrainedStiffness(float(eigh(K + K_G, M, eigvals_only=True)[0]), float(max(-parts[0], 0.0)))


def _turns_at_unit_rates(mechanism: Mechanism, t: float, q: Array) -> list[Array]:
    """Return how each body's frame turns with each coordinate, in its own axes, shapes (3, n)."""
    n = mechanism.n
    rates = np.concatenate([np.eye(n), np.zeros((1, n))])
    motion = Kinematics(mechanism, np.full(n + 1, t), np.tile(q, (n + 1, 1)), rates)
    return [frame.rotation[0].T @ (frame.spin[:-1] - frame.spin[-1]).T for frame in motion.frames]


def _work_of_turning(mechanism: Mechanism, body: int, loads: BodyLoads, turns: Array) -> Array:
    """Return the stiffness (n, n) by loads that keep their direction in space while the body turns."""
    link, modes = mechanism.links[body], mechanism.modes_of(body)
    carried, points, closures, markers = loaded_places(mechanism, body)
    # A joint pulls on in its direction as the body turns; a force element turns with it.
    turning = (
        [False] * len(carried) + [at.following for at in points] + [key.startswith(ELEMENT) for key, *_ in closures]
    )
    forces = [
        (wrench[0, :3], at.position, at.translation, turns_too)
        for wrench, at, turns_too in zip(loads.wrenches, markers, turning, strict=True)
    ]
    forces.append((-loads.acceleration[0], link.integrals.S[:, 0], link.integrals.S[:, 1:], False))
    K = np.zeros((mechanism.n, mechanism.n))
    for F, r, shapes, following in forces:
        if following:
            continue
        K += turns.T @ ((F @ r) * np.eye(3) - 0.5 * (np.outer(F, r) + np.outer(r, F))) @ turns
        if shapes.size:
            coupling = turns.T @ np.cross(F, shapes, axisb=0, axisc=0)
            K[:, modes] += coupling
            K[modes] += coupling.T
    return K


def _elastic_directions(system: CompiledSystem, t: float, q: Array) -> Array:
    """Return a basis (n, k) of the motions that keep loops closed, less those in which joints alone move."""
    from scipy.linalg import null_space

    n = system.n
    J = system.compiled.constraint_jacobian(t, q) if system.compiled.rows else np.zeros((0, n))
    joints = np.setdiff1d(
        np.arange(n), np.concatenate([system.mechanism.modes_of(k) for k in range(len(system.mechanism.links))])
    )
    directions = null_space(J, rcond=DEPENDENT_CONSTRAINT) if len(J) else np.eye(n)
    alone = np.zeros((n, 0))
    if len(joints):
        of_joints = null_space(J[:, joints], rcond=DEPENDENT_CONSTRAINT) if len(J) else np.eye(len(joints))
        alone = np.zeros((n, of_joints.shape[1]))
        alone[joints] = of_joints
    if not alone.shape[1]:
        return np.asarray(directions)
    # Each of unit mass, since joints and modes have units of their own.
    M = system.mass_matrix(q, t)
    alone, directions = (each / np.sqrt(np.einsum("ik,ij,jk->k", each, M, each)) for each in (alone, directions))
    return np.asarray(directions @ null_space(alone.T @ M @ directions, rcond=DEPENDENT_CONSTRAINT))
